# SPDX-License-Identifier: Apache-2.0
"""The page around the report: one file, no network, light and dark, fit to print."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

STYLE = """
:root { color-scheme: light dark; --paper: #fff; --ink: #1b1f24; --faint: #6a737d; --rule: #d9dde2;
  --before: #9a9a9a; --after: #0b62a4; --held: #b35900; --warn: #fff3cd; --warn-ink: #5c4400; }
@media (prefers-color-scheme: dark) { :root { --paper: #14171a; --ink: #e4e7ea; --faint: #98a2ac;
  --rule: #353b41; --before: #7d838a; --after: #58b0f2; --held: #f0a35a; --warn: #40340c;
  --warn-ink: #ffe9a8; } }
@media print { :root { --paper: #fff; --ink: #000; --faint: #444; --rule: #bbb; --before: #8a8a8a;
  --after: #0b62a4; --held: #b35900; --warn: #fff3cd; --warn-ink: #000; }
  figure, tr { break-inside: avoid; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.2rem; max-width: 64rem; background: var(--paper);
  color: var(--ink); font: 15px/1.45 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.5rem; margin: 0 0 .2rem; } h2 { font-size: 1.1rem; margin: 1.8rem 0 .5rem; }
p { margin: .4rem 0; } .faint { color: var(--faint); }
.warning { background: var(--warn); color: var(--warn-ink); padding: .5rem .8rem; margin: .4rem 0; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; padding: .25rem .6rem .25rem 0; border-bottom: 1px solid var(--rule);
  vertical-align: top; } td.number, th.number { text-align: right; white-space: nowrap;
  font-variant-numeric: tabular-nums; }
.charts { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 27rem), 1fr));
  gap: 1rem; } figure { margin: 0; } figcaption { font-size: .9rem; }
svg { width: 100%; height: auto; } svg text { fill: var(--faint); font-size: 11px; }
.grid { stroke: var(--rule); stroke-width: .6; }
.dots { fill: none; stroke-linecap: round; stroke-width: 3.2; stroke-opacity: .75; }
polyline { fill: none; stroke-width: 1.6; }
.before { stroke: var(--before); } .after { stroke: var(--after); } .held { stroke: var(--held); }
.key { margin-left: .7em; } .key::before { content: '\\25CF'; margin-right: .25em; }
.key.before::before { color: var(--before); } .key.after::before { color: var(--after); }
.key.held::before { color: var(--held); }
"""


def page(title: str, sections: Sequence[str]) -> str:
    """A whole HTML document."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<link rel="icon" href="data:,"><title>{escape(title)}</title>'
        f'<style>{STYLE}</style></head>\n<body>\n' + '\n'.join(sections) + '\n</body></html>\n'
    )


def section(title: str, *content: str) -> str:
    """A heading with what stands under it."""
    return f'<section><h2>{escape(title)}</h2>{"".join(content)}</section>'


def paragraph(text: str, style: str = '') -> str:
    """A paragraph of plain text."""
    return f'<p class="{style}">{escape(text)}</p>' if style else f'<p>{escape(text)}</p>'


def table(header: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A table; the columns `numbers` are set right."""

    def cells(row: Sequence[str], kind: str) -> str:
        marks = [' class="number"' if i in numbers else '' for i in range(len(row))]
        return ''.join(
            f'<{kind}{mark}>{escape(cell)}</{kind}>' for mark, cell in zip(marks, row, strict=True)
        )

    body = ''.join(f'<tr>{cells(row, "td")}</tr>' for row in rows)
    head = f'<thead><tr>{cells(header, "th")}</tr></thead>'
    return f'<div class="scroll"><table>{head}<tbody>{body}</tbody></table></div>'


def charts(figures: Sequence[str]) -> str:
    """Figures side by side where there is room."""
    return f'<div class="charts">{"".join(figures)}</div>'
