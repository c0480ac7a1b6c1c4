# SPDX-License-Identifier: Apache-2.0
"""The parts a report's page is made of: one file, no network, no script."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cache
from html import escape
from math import floor, log10
from pathlib import Path

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup

from calib_solver.report.charts import Chart
from calib_solver.report.svg import figure

MM, DEGREE = 1e3, 57.29577951308232
#: for people: the factor from SI and the unit's name
UNITS = {
    'm': (MM, 'mm'),
    'rad': (DEGREE, '°'),
    'rad/(N m)': (1e6, 'µrad/(N m)'),
    'm/m': (1e6, 'µm/m'),
}
NOTHING = '–'


@cache
def _templates() -> Environment:
    loader = FileSystemLoader(Path(__file__).parent)
    return Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)


def rendered(template: str, **values: object) -> str:
    """A template of this folder with values; text among them is escaped, `Markup` is not."""
    return _templates().get_template(f'{template}.html.j2').render(values)


def document(title: str, sections: Sequence[str]) -> str:
    """A whole HTML document."""
    style = Path(__file__).with_name('style.css').read_text(encoding='utf-8')
    return rendered(
        'page', title=title, style=Markup(style), sections=[Markup(one) for one in sections]
    )


def section(title: str, *content: str) -> str:
    """A heading with what stands under it."""
    return f'<section><h2>{escape(title)}</h2>{"".join(content)}</section>'


def heading(title: str) -> str:
    """The heading of the page."""
    return f'<h1>{escape(title)}</h1>'


def verdict_box(verdict: str, text: str) -> str:
    """The verdict, set apart; green where it is `passed` or `within`, red otherwise."""
    good = verdict in ('passed', 'within')
    return f'<p class="verdict{"" if good else " bad"}" role="status">{escape(text)}</p>'


def part(title: str) -> str:
    """A heading within a section."""
    return f'<h3>{escape(title)}</h3>'


def paragraph(text: str, style: str = '') -> str:
    """A paragraph of plain text."""
    return f'<p class="{style}">{escape(text)}</p>' if style else f'<p>{escape(text)}</p>'


def warnings_box(lines: Sequence[str]) -> str:
    """What to doubt, set apart; nothing where there is nothing."""
    if not lines:
        return ''
    items = ''.join(f'<li class="warning">{escape(line)}</li>' for line in lines)
    name = 'Warning' if len(lines) == 1 else f'{len(lines)} warnings'
    return (
        f'<aside class="warnings" role="note" aria-label="Warnings"><h2>{name}</h2>'
        f'<ul>{items}</ul></aside>'
    )


def table(
    caption: str,
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    numbers: Collection[int] = (),
    styles: Mapping[int, str] | None = None,
    name: str = '',
) -> str:
    """A table whose rows begin with their own heading.

    The columns `numbers` are set right, `styles` gives columns a class, `name` the table one. A
    row of a single cell is a heading for the rows after it.
    """
    styles = dict(styles or {}) | dict.fromkeys(numbers, 'number')
    label = caption or ' '.join(filter(None, header))
    return rendered(
        'table',
        caption=caption,
        header=header,
        rows=rows,
        styles=styles,
        name=name,
        label=label,
    ).strip()


def facts(rows: Sequence[tuple[str, str]]) -> str:
    """Names with what there is to say of each."""
    return table('', ('', ''), rows, name='facts')


def side_by_side(shown: Sequence[Chart], columns: str = '') -> str:
    """Figures side by side where there is room; `columns` 'three' for small ones."""
    style = f'charts {columns}'.strip()
    return f'<div class="{style}">{"".join(map(figure, shown))}</div>' if shown else ''


def counted(count: int, name: str) -> str:
    """A number of things."""
    return f'{count} {name}{"" if count == 1 else "s"}'


def mm(value: float | None) -> str:
    """A length in m as mm."""
    if value is None:
        return NOTHING
    return f'{round(value * MM, 4) + 0.0:.4f}'.replace('-', '\u2212')  # + 0.0: no -0.0000


def decimals_of(uncertainty: float) -> int:
    """So many decimals give an uncertainty, in the unit it is shown in, two digits."""
    return min(max(1 - floor(log10(uncertainty)), 0), 9) if uncertainty > 0 else 5


def two_digits(uncertainty: float | None, factor: float = MM) -> str:
    """An uncertainty in SI to two digits in the unit that `factor` makes, mm if nothing is said."""
    if uncertainty is None:
        return NOTHING
    return number(uncertainty * factor, decimals_of(uncertainty * factor))


def number(value: float, decimals: int, sign: str = '') -> str:
    """A number with so many decimals and a minus that is one."""
    return format(value, f'{sign}.{decimals}f').replace('-', '\u2212')
