#!/usr/bin/env bash
# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
#
# Builds the site of the documentation in site/, without a warning, or says why not. MkDocs is in an
# environment of its own.

set -euo pipefail

if (($# > 0)); then
  echo 'usage: scripts/site.sh (takes no arguments)' >&2
  exit 2
fi
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
tools=$root/.venv-site
"$root/scripts/setup.sh" --venv "$tools" --requirements "$root/requirements/site.txt"
cd "$root"
.venv/bin/python scripts/site_pages.py
# A warning, such as of a link that leads nowhere, is an error.
NO_MKDOCS_2_WARNING=1 "$tools/bin/mkdocs" build --strict --quiet
echo 'site: site/index.html'
