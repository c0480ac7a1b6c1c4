# SPDX-License-Identifier: Apache-2.0
"""The parts a report's page is made of: one file, no network, no script."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from html import escape

from calib_solver.report.charts import Chart
from calib_solver.report.style import STYLE
from calib_solver.report.svg import figure

MM, DEGREE = 1e3, 57.29577951308232
#: for people: the factor from SI and the unit's name
UNITS = {'m': (MM, 'mm'), 'rad': (DEGREE, '°'), 'rad/(N m)': (1e6, 'µrad/(N m)')}
NOTHING = '–'


def document(title: str, sections: Sequence[str]) -> str:
    """A whole HTML document."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<link rel="icon" href="data:,"><title>{escape(title)}</title>'
        f'<style>{STYLE}</style></head>\n<body><main>\n'
        + '\n'.join(sections)
        + '\n</main></body></html>\n'
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

    def cell(i: int, text: str, row: int) -> str:
        style = f' class="{styles[i]}"' if i in styles else ''
        if row < 0:
            return f'<th scope="col"{style}>{escape(text)}</th>'
        kind, scope = ('th', ' scope="row"') if i == 0 else ('td', '')
        return f'<{kind}{scope}{style}>{escape(text)}</{kind}>'

    def line(row: int, cells: Sequence[str]) -> str:
        if len(cells) == 1:
            span = f'<th scope="rowgroup" colspan="{len(header)}">{escape(cells[0])}</th>'
            return f'<tr class="part">{span}</tr>'
        return f'<tr>{"".join(cell(i, text, row) for i, text in enumerate(cells))}</tr>'

    body = ''.join(line(i, cells) for i, cells in enumerate(rows))
    label = escape(caption or ' '.join(filter(None, header)), quote=True)
    told = f'<caption>{escape(caption)}</caption>' if caption else ''
    head = f'<thead>{line(-1, header)}</thead>' if any(header) else ''
    # a table wider than its page is scrolled, by keyboard too
    return (
        f'<div class="scroll" role="region" tabindex="0" aria-label="{label}">'
        f'<table{f" class={name}" if name else ""}>{told}{head}<tbody>{body}</tbody></table></div>'
    )


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
