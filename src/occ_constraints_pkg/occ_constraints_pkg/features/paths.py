# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Field paths such as ``ranges[0:9]`` or ``position[name=elbow]``, in steps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

_STEP = re.compile(
    r'\.?([A-Za-z_]\w*)|\[(-?\d+)\]|\[(-?\d*):(-?\d*)\]|\[([A-Za-z_][\w.]*)=([^\[\]]+)\]'
)
# A number in a text, perhaps with a unit behind it, as diagnostics have them.
_NUMBER = re.compile(
    r'([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?inf|nan)\s*(?:[%°]?[^\W\d]*(?:/[^\W\d]+[2²]?)?)'
)
_WORDS = {'true': 1.0, 'false': 0.0}


@dataclass(frozen=True)
class Selector:
    """The element of an array that has a name.

    Attributes:
        key: path of the name: of a field of the elements, or of an array of names that lies in one
            of the messages around, where the name's place is the element's.
        text: the name; of a number, its digits.
    """

    key: tuple[str, ...]
    text: str

    def __str__(self) -> str:
        return f'{".".join(self.key)}={self.text}'

    def matches(self, name: Any) -> bool:
        """Tell whether a name is the one that is meant."""
        if isinstance(name, str):
            return name == self.text
        number = number_in(self.text)
        return number is not None and float(name) == number


Step = str | int | slice | Selector
Path = tuple[Step, ...]


def parse_path(field: str) -> Path:
    """Return the steps of a field path that the schema of maps allows."""
    steps: list[Step] = []
    for attribute, index, start, stop, key, text in _STEP.findall(field):
        if attribute:
            steps.append(attribute)
        elif index:
            steps.append(int(index))
        elif key:
            steps.append(Selector(tuple(key.split('.')), text))
        else:
            steps.append(slice(int(start) if start else None, int(stop) if stop else None))
    return tuple(steps)


def path_text(steps: Sequence[Step]) -> str:
    """Return a path as it is written."""
    return ''.join(map(_step_text, steps)).lstrip('.')


def _step_text(step: Step) -> str:
    if isinstance(step, str):
        return f'.{step}'
    if isinstance(step, slice):
        ends = ('' if end is None else end for end in (step.start, step.stop))
        return '[{}:{}]'.format(*ends)
    return f'[{step}]'


def number_in(text: str) -> float | None:
    """Return the number that a text holds, perhaps with a unit; None for any other text.

    Example:
        >>> number_in('12.5 V'), number_in('98 %'), number_in('True'), number_in('3 of 4')
        (12.5, 98.0, 1.0, None)
    """
    found = _NUMBER.fullmatch(text.strip())
    return float(found[1]) if found else _WORDS.get(text.strip().lower())
