# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A page: a title, sections, and the data that its program works on, in one HTML file."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from occ_constraints_pkg import __version__
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.files import PAGE, write_text
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.web.assets import asset


@dataclass(frozen=True)
class Section:
    """A part of a page with a heading, listed in its table of contents.

    Attributes:
        title: the heading, plain text.
        body: HTML, see :func:`render`.
        id: its anchor; unique on the page.
    """

    title: str
    body: Markup
    id: str


@dataclass
class Page:
    """What is to be written into one HTML file.

    Attributes:
        title: plain text, also the title of the browser's window.
        summary: what matters most, one sentence in plain text.
        is_good: whether the summary is good news, bad news, or neither (``None``).
        sections: in order.
        data: plain values for the program of the page, by the name of the part that reads them.
    """

    title: str
    summary: str = ''
    is_good: bool | None = None
    sections: list[Section] = field(default_factory=list)
    data: dict[str, Any] = field(default_factory=dict)

    def add(self, section: Section) -> None:
        """Append a section.

        Raises:
            ConfigurationError: another one has its anchor.
        """
        if any(section.id == other.id for other in self.sections):
            raise ConfigurationError(f'two sections of a page have the anchor {section.id!r}')
        self.sections.append(section)

    def html(self) -> str:
        """Return the whole document; it loads nothing from elsewhere."""
        return str(
            render(
                'page.html.j2',
                page=self,
                style=Markup(asset('style.css') + _resource('page.css')),
                patterns=Markup(asset('patterns.svg').rstrip()),
                programs=[
                    Markup(asset('charts.js')),
                    *(Markup(_resource(name)) for name in ('judge.js', 'page.js')),
                ],
                data=_script_json(self.data),
                version=__version__,
                written=datetime.now(UTC).strftime('%Y-%m-%d %H:%M UTC'),
            )
        )


def write_page(page: Page, path: str | Path) -> None:
    """Write a page to a file.

    Raises:
        OccError: it cannot be written, or is no page and so would be lost.
    """
    write_text(path, PAGE, page.html())


def render(template: str, **values: Any) -> Markup:
    """Return a template of this package with its values, all of them escaped."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters['plain'] = lambda text: printable(str(text))
    return Markup(environment.from_string(_resource(template)).render(**values))


def table_section(
    title: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    *,
    id: str,
    intro: str = '',
    numbers: Iterable[int] = (),
) -> Section:
    """Return a section with a table.

    Args:
        title: the heading.
        columns: their titles.
        rows: of values; text is escaped, :class:`markupsafe.Markup` is not.
        id: the anchor.
        intro: a sentence before it.
        numbers: places of the columns that hold numbers, aligned to the right.
    """
    body = render(
        'table.html.j2',
        columns=columns,
        rows=[list(row) for row in rows],
        intro=intro,
        numbers=set(numbers),
    )
    return Section(title, body, id)


def facts_section(title: str, facts: Mapping[str, Any], *, id: str) -> Section:
    """Return a section that lists names and values, for example settings and versions."""
    return Section(title, render('facts.html.j2', facts=dict(_flat(facts))), id)


def _flat(facts: Mapping[str, Any], before: str = '') -> Iterator[tuple[str, str]]:
    """Yield names and values as people read them, those of nested documents one by one."""
    for key, value in facts.items():
        name = before + str(key).replace('_', ' ')
        if isinstance(value, Mapping):
            yield from _flat(value, f'{name}: ')
        elif isinstance(value, bool):
            yield name, 'yes' if value else 'no'
        elif isinstance(value, list | tuple):
            yield name, ', '.join(map(str, value)) or 'none'
        else:
            yield name, 'none' if value is None else str(value)


def picture_section(title: str, png: bytes, words: str, *, id: str) -> Section:
    """Return a section with a picture.

    Args:
        title: the heading.
        png: the picture.
        words: what it shows, for those who cannot see it, too.
        id: the anchor.
    """
    source = 'data:image/png;base64,' + base64.b64encode(png).decode('ascii')
    return Section(title, render('picture.html.j2', source=source, words=words), id)


def _script_json(value: Any) -> Markup:
    """Return JSON that neither ends its script element nor is taken for markup."""
    text = json.dumps(value, allow_nan=False, separators=(',', ':'), ensure_ascii=False)
    for sign in '<>&\u2028\u2029':
        text = text.replace(sign, f'\\u{ord(sign):04x}')
    return Markup(text)


def _resource(name: str) -> str:
    return asset(f'templates/{name}', __package__)
