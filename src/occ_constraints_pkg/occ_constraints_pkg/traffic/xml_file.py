# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""XML files of strangers: parsed with the lines of their elements, for errors to name."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, NoReturn
from xml.parsers import expat

from occ_constraints_pkg.errors import DataError
from occ_constraints_pkg.files import open_regular
from occ_constraints_pkg.traffic.plausible import LARGEST


class XmlFile:
    """An XML file whose parts are asked for one by one; errors name file, line and element.

    Attributes:
        path: the file.
        root: its outermost element.

    Raises:
        OccError: the file cannot be read, is no well-formed XML, ends early, or declares entities,
            of which a few lines can stand for more data than fits in memory.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lines: dict[ET.Element, int] = {}
        builder, parser = ET.TreeBuilder(), expat.ParserCreate()
        parser.buffer_text = True

        def start(tag: str, attributes: dict[str, str]) -> None:
            self._lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

        def entity(*_: Any) -> NoReturn:
            raise DataError(
                f'{path}, line {parser.CurrentLineNumber}: got an entity declaration; '
                'allowed is plain XML without them'
            )

        parser.StartElementHandler, parser.EndElementHandler = start, builder.end
        parser.CharacterDataHandler, parser.EntityDeclHandler = builder.data, entity
        try:
            with open_regular(path) as stream:
                parser.ParseFile(stream)
        except OSError as error:
            raise DataError(f'cannot read {path}: {error.strerror}') from error
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            raise DataError(
                f'{path}, line {error.lineno}: it is not valid XML: {reason}'
            ) from error
        except DataError:
            raise
        except (ValueError, LookupError) as error:
            # An encoding that the parser does not know, or bytes that are none of it.
            raise DataError(f'{path} is not valid XML: {error}') from error
        self.root = builder.close()

    def fail(self, element: ET.Element, sentence: str) -> NoReturn:
        """Raise an error that names the element and its line.

        Raises:
            OccError: always.
        """
        raise DataError(f'{self.place_of(element, f"<{element.tag}>")} {sentence}')

    def place_of(self, element: ET.Element, name: str) -> str:
        """Return what errors call an element: file, line and a name."""
        return f'{self.path}, line {self._lines[element]}: {name}'

    def child(self, element: ET.Element, path: str) -> ET.Element:
        """Return the first element at a path such as ``shape/rectangle``.

        Raises:
            OccError: there is none.
        """
        found = element.find(path)
        if found is None:
            inside = ', '.join(dict.fromkeys(part.tag for part in element)) or 'nothing'
            self.fail(element, f'lacks <{path.replace("/", "><")}>; it has {inside}')
        return found

    def number(self, element: ET.Element, path: str) -> float:
        """Return the number that the element at a path holds.

        Raises:
            OccError: there is none, or it is not finite or absurdly large.
        """
        part = self.child(element, path)
        return self._number(part, part.text or '', 'holds')

    def text(self, element: ET.Element, path: str) -> str:
        """Return the text that the element at a path holds, without blanks around it.

        Raises:
            OccError: there is no such element.
        """
        return (self.child(element, path).text or '').strip()

    def attribute(self, element: ET.Element, name: str) -> str:
        """Return an attribute.

        Raises:
            OccError: the element lacks it.
        """
        if name not in element.attrib:
            self.fail(element, f'lacks the attribute {name!r}')
        return element.attrib[name]

    def number_attribute(self, element: ET.Element, name: str) -> float:
        """Return the number that an attribute holds.

        Raises:
            OccError: the element lacks it, or it is no finite number, or absurdly large.
        """
        return self._number(element, self.attribute(element, name), f'has {name}')

    def integer(self, element: ET.Element, name: str) -> int:
        """Return the whole number that an attribute holds.

        Raises:
            OccError: the element lacks it, or it is no whole number.
        """
        number = self.number_attribute(element, name)
        if number != int(number):
            self.fail(element, f'has {name} {number:g}; allowed is a whole number')
        return int(number)

    def _number(self, element: ET.Element, text: str, says: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not abs(number) <= LARGEST:
            shown = ' '.join(text.split())[:40]
            self.fail(element, f'{says} {shown!r}; allowed is a number of at most {LARGEST:g}')
        return number
