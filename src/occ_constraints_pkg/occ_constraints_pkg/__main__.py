# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``python -m occ_constraints_pkg`` is the same as ``occ``."""

import sys

from occ_constraints_pkg.cli import main

if __name__ == '__main__':
    sys.exit(main())
