# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``python -m occ_constraints_pkg`` is the same as ``occ``."""

import sys

from occ_constraints_pkg.stopping import stop_request


def main() -> int:
    """Run ``occ``, quiet on Ctrl-C from the start on; see :func:`occ_constraints_pkg.cli.main`."""
    # A node answers Ctrl-C by a clean end, also before it is one.
    ending = (0,) if sys.argv[1:2] == ['node'] else (130, 'stopped')
    with stop_request.ending_at_once(*ending):
        from occ_constraints_pkg.cli import main as occ
    return occ()


if __name__ == '__main__':
    sys.exit(main())
