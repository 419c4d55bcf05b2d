# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Elements of arrays that a map selects by name, in many serialized messages at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from occ_constraints_pkg.features.fields import FieldReader, NotNamedError
from occ_constraints_pkg.features.paths import Selector
from occ_constraints_pkg.rosbag.cdr import Group, Path, read_texts

# Lists of names that are remembered; robots have a few.
_MOST_LISTS = 1000


class NamedElements:
    """Finds numbers such as ``position[name=elbow]``, whose names are a sequence of strings.

    Recorders repeat the same names message after message, so each list of them is read once.

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
        # The lists of names that were met, and the number of each.
        self._lists: dict[bytes, list[str]] = {}
        self._numbers: dict[bytes, int] = {}
        # Where names lay when they were last looked up, and the number of each message's list.
        self._last: tuple[np.ndarray, np.ndarray] | None = None
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
        self, column: int, names: Group, arrays: Sequence[Group], data: bytes | memoryview
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (n,) float64 numbers, and (n,) which of the messages have the name.

        Args:
            column: which of the readers.
            names: where the names lie in the data.
            arrays: the arrays of which one element is meant.
            data: bytes in which the messages lie.

        Raises:
            UnreadableError: a message is damaged.
        """
        selector = self._selectors[column]
        lists = self._lists_of(names, data)
        places = [_index(selector, texts) for texts in self._lists.values()]
        indices = np.array(places, dtype=np.intp)[lists]
        values = np.full(len(indices), np.nan)
        for group in arrays:
            own = indices[group.rows]
            # An array may be shorter than its names, and is then not known.
            known = (own >= 0) & (own < group.values.shape[1])
            values[group.rows[known]] = group.values[known, own[known]]
        return values, indices >= 0

    def _lists_of(self, names: Group, data: bytes | memoryview) -> np.ndarray:
        """Return (n,) which of the lists of names each message has; readers share the answer."""
        if self._last is None or self._last[0] is not names.base:
            found = []
            if len(self._lists) > _MOST_LISTS:
                self._lists.clear()
                self._numbers.clear()
            for start, end in names.base.tolist():
                key = bytes(data[int(start) : int(end)])
                if key not in self._numbers:
                    self._numbers[key] = len(self._numbers)
                    self._lists[key] = read_texts(key)
                found.append(self._numbers[key])
            self._last = names.base, np.array(found, dtype=np.intp)
        return self._last[1]

    def error(self) -> NotNamedError:
        """Return the error that a name has not been in any message so far."""
        names = list(dict.fromkeys(name for names in self._lists.values() for name in names))
        column = next(
            (item for item, selector in self._selectors.items() if selector.text not in names),
            min(self._selectors),
        )
        return self._readers[column].not_named(self._selectors[column], names)


def _index(selector: Selector, texts: list[str]) -> int:
    return texts.index(selector.text) if selector.text in texts else -1


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
