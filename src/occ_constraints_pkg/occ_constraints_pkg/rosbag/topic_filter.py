# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Which topics are meant: by name or pattern, less those excluded."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

from occ_constraints_pkg.errors import DataError


@dataclass(frozen=True)
class TopicFilter:
    """Chooses topics as ``ros2 bag record`` and ``ros2 bag play`` do.

    Attributes:
        names: topics that are meant.
        regex: topics in whose name this pattern is found are meant too; empty: none.
        exclude: topics that are not meant in any case.
        exclude_regex: nor are topics in whose name this pattern is found; empty: none.

    Without names and pattern all topics are meant but hidden ones, of whose name a part begins
    with an underscore.

    Raises:
        OccError: a pattern is no regular expression.
    """

    names: Collection[str] = ()
    regex: str = ''
    exclude: Collection[str] = ()
    exclude_regex: str = ''

    def __post_init__(self) -> None:
        for pattern in (self.regex, self.exclude_regex):
            try:
                re.compile(pattern)
            except re.error as error:
                raise DataError(
                    f'{pattern!r} chooses no topics: {error}; allowed is a regular expression'
                ) from error

    def with_names(self, full_name: Callable[[str], str]) -> TopicFilter:
        """Return the same choice with each name completed."""
        return replace(
            self, names=set(map(full_name, self.names)), exclude=set(map(full_name, self.exclude))
        )

    def allows(self, topic: str) -> bool:
        """Tell whether a topic is meant, by its full name with the leading slash."""
        if topic in self.exclude or _found(self.exclude_regex, topic):
            return False
        if self.names or self.regex:
            return topic in self.names or _found(self.regex, topic)
        return not any(part.startswith('_') for part in topic.split('/'))

    def __str__(self) -> str:
        meant = [*sorted(self.names), *([f'/{self.regex}/'] if self.regex else [])]
        left_out = [
            *sorted(self.exclude),
            *([f'/{self.exclude_regex}/'] if self.exclude_regex else []),
        ]
        text = ', '.join(meant) or 'all topics'
        return f'{text} but {", ".join(left_out)}' if left_out else text


def _found(pattern: str, topic: str) -> bool:
    return bool(pattern) and re.search(pattern, topic) is not None
