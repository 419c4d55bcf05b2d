# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``python -m occ_constraints_pkg`` is the same as ``occ``."""

import os
import sys
from contextlib import nullcontext

from occ_constraints_pkg.stopping import stop_request

# Commands that go on until Ctrl-C, which ends them cleanly, also while they are being loaded.
_NODES = ('node', 'record', 'play', 'watch')
_STOPPED = 130


def main() -> int:
    """Run ``occ``; see :func:`occ_constraints_pkg.cli.main`."""
    is_node = len(sys.argv) > 1 and sys.argv[1] in _NODES
    with stop_request.ending_at_once(0) if is_node else nullcontext():
        from occ_constraints_pkg.cli import main as occ

        code = occ()
    if code == _STOPPED:
        # An interrupt that came while a text was executed, as when an import makes a dataclass, is
        # remembered by CPython though it was handled: at its end it would kill itself by SIGINT.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


if __name__ == '__main__':
    sys.exit(main())
