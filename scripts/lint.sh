#!/usr/bin/env bash
# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
#
# Runs every linter, also after one has complained, and fails if any did.

set -euo pipefail
if (($#)); then
  echo 'usage: scripts/lint.sh (runs every linter; takes no arguments)' >&2
  [[ $1 == -h || $1 == --help ]] && exit 0
  exit 2
fi
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bin=$PWD/.venv/bin
failed=0

check() {
  local name=$1
  shift
  if "$@"; then
    echo "lint: $name: ok"
  else
    echo "lint: $name: FAILED"
    failed=1
  fi
}

check 'ruff check' "$bin/ruff" check --quiet
check 'ruff format' "$bin/ruff" format --check --quiet
check 'mypy' "$bin/mypy" --no-error-summary
check 'shellcheck' "$bin/shellcheck" scripts/*.sh docker/*.sh .ci/run
check 'hadolint' "$bin/hadolint" docker/Dockerfile.*
check 'yamllint' "$bin/yamllint" --strict docker/compose.yaml src/occ_constraints_pkg/config
exit "$failed"
