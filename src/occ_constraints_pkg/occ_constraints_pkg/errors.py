# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The one exception for mistakes that a user can mend."""


class OccError(Exception):
    """A user's mistake or a faulty input, told in one sentence.

    The sentence says what is wrong, where (file, key, topic), what was found there and what is
    allowed. The command line prints it without a traceback and exits with code 2.
    """
