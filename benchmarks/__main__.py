# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""``python -m benchmarks NAME``."""

import sys


def _main() -> int:
    try:
        from occ_constraints_pkg.cli import main
    except ModuleNotFoundError as error:
        if (error.name or '').partition('.')[0] != 'occ_constraints_pkg':
            raise
        print(
            'error: the package occ_constraints_pkg is not installed: run make setup and then '
            '.venv/bin/python -m benchmarks, or pip install ./src/occ_constraints_pkg',
            file=sys.stderr,
        )
        return 2
    return main(module='benchmarks.commands')


if __name__ == '__main__':
    sys.exit(_main())
