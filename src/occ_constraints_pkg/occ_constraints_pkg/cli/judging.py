# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that judge recordings: what counts as how long."""

from __future__ import annotations

import click

from occ_constraints_pkg.checking.timeline import BRIDGE_SECONDS, TIMEOUT_SECONDS
from occ_constraints_pkg.cli.common import Seconds
from occ_constraints_pkg.features.lateness import MAX_LAG_SECONDS

TIMEOUT = click.option(
    '--timeout',
    default=TIMEOUT_SECONDS,
    show_default=True,
    type=Seconds(),
    help='Seconds that a verdict is valid without new input; after that the time is UNKNOWN.',
)
MAX_LAG = click.option(
    '--max-lag',
    default=MAX_LAG_SECONDS,
    show_default=True,
    type=Seconds(above_zero=False),
    help='Largest lag of messages, by log times and stamps, beyond which the verdict is UNKNOWN; '
    '0: any.',
)
BRIDGE = click.option(
    '--bridge',
    default=BRIDGE_SECONDS,
    show_default=True,
    type=Seconds(above_zero=False),
    help='Violations of a rule that are at most as many seconds apart count as one.',
)
