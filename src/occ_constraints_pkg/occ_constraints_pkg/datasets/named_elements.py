# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Elements of arrays that a map selects by name, in many serialized messages at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from occ_constraints_pkg.features.fields import FieldReader, NotNamedError
from occ_constraints_pkg.features.paths import Selector
from occ_constraints_pkg.rosbag.cdr import Group, Path, read_texts

# Names that an error lists; those of a robot are fewer.
_MOST_NAMES = 1000


@dataclass(frozen=True)
class NameLists:
    """The lists of names in n messages, each different one once.

    Attributes:
        numbers: (n,) which of the lists a message has.
        lists: the names, in order.
    """

    numbers: np.ndarray
    lists: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, names: Group, data: bytes | memoryview) -> NameLists:
        """Read the lists; recorders repeat the same names message after message.

        Args:
            names: where the names lie in the data.
            data: bytes in which the messages lie.

        Raises:
            UnreadableError: a list is damaged.
        """
        found: dict[bytes, int] = {}
        numbers = [
            found.setdefault(bytes(data[start:end]), len(found))
            for start, end in names.base.tolist()
        ]
        return cls(np.array(numbers), tuple(tuple(read_texts(item)) for item in found))


class NamedElements:
    """Finds numbers such as ``position[name=elbow]``, whose names are a sequence of strings.

    Args:
        definitions: type name to its parsed definition.
        msgtype: the type's name.
        paths: of each reader; where a reader selects by name, its path becomes that of the whole
            array, and the paths of the names are appended.
        readers: what is read; those that select otherwise are left as they are.

    Attributes:
        columns: the readers that this class reads, to the place of their names among the paths.
    """

    def __init__(
        self,
        definitions: Mapping[str, Any],
        msgtype: str,
        paths: list[Path],
        readers: Sequence[FieldReader],
    ) -> None:
        self.columns: dict[int, int] = {}
        self._readers = readers
        self._selectors: dict[int, Selector] = {}
        self._seen: dict[str, None] = {}
        texts: dict[Path, int] = {}
        for column, reader in enumerate(readers):
            found = _array_and_names(definitions, msgtype, paths[column])
            if found is None or reader.reading.reduce is not None:
                continue
            paths[column], names, self._selectors[column] = found
            if names not in texts:
                texts[names] = len(paths)
                paths.append(names)
            self.columns[column] = texts[names]

    def read(
        self, column: int, names: NameLists, arrays: Sequence[Group]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (n,) float64 numbers, and (n,) which of the messages have the name.

        Args:
            column: which of the readers.
            names: of the messages.
            arrays: the arrays of which one element is meant.
        """
        text = self._selectors[column].text
        places = [item.index(text) if text in item else -1 for item in names.lists]
        indices = np.array(places)[names.numbers]
        if -1 in places and len(self._seen) < _MOST_NAMES:
            self._seen.update(dict.fromkeys(name for item in names.lists for name in item))
        values = np.full(len(indices), np.nan)
        for group in arrays:
            own = indices[group.rows]
            # An array may be shorter than its names, and is then not known.
            known = (own >= 0) & (own < group.values.shape[1])
            values[group.rows[known]] = group.values[known, own[known]]
        return values, indices >= 0

    def error(self) -> NotNamedError:
        """Return the error that a name has not been in any message so far."""
        names = list(self._seen)
        column = next(
            (item for item, selector in self._selectors.items() if selector.text not in names),
            min(self._selectors),
        )
        return self._readers[column].not_named(self._selectors[column], names)


def _array_and_names(
    definitions: Mapping[str, Any], msgtype: str, path: Path
) -> tuple[Path, Path, Selector] | None:
    """Return the paths of an array of numbers and of its names, and which name is meant.

    None where the path is not of this kind: a number in an array beside its names.
    """
    *steps, last = path
    if not isinstance(last, Selector) or not all(isinstance(step, str) for step in steps):
        return None
    # The messages around the array, from the outermost, as in `FieldReader`.
    around = [msgtype]
    for step in steps[:-1]:
        field = dict(_fields(definitions, around[-1])).get(step)
        if field is None or not isinstance(field[1], str):
            return None
        around.append(field[1])
    for depth in range(len(around) - 1, -1, -1):
        if last.key[0] in dict(_fields(definitions, around[depth])):
            return tuple(steps), (*steps[:depth], *last.key), last
    return None


def _fields(definitions: Mapping[str, Any], msgtype: str) -> list[tuple[str, Any]]:
    return list(definitions[msgtype][1]) if msgtype in definitions else []
