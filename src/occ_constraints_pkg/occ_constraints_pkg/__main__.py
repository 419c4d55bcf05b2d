# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``python -m occ_constraints_pkg`` is the same as ``occ``."""

import sys
from contextlib import nullcontext

from occ_constraints_pkg.stopping import stop_request

# Commands that run a node, which ends cleanly on Ctrl-C, also before it is one.
_NODES = ('node', 'record', 'play')


def main() -> int:
    """Run ``occ``; see :func:`occ_constraints_pkg.cli.main`."""
    is_node = len(sys.argv) > 1 and sys.argv[1] in _NODES
    with stop_request.ending_at_once(0) if is_node else nullcontext():
        from occ_constraints_pkg.cli import main as occ

        return occ()


if __name__ == '__main__':
    sys.exit(main())
