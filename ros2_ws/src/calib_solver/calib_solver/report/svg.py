# SPDX-License-Identifier: Apache-2.0
"""A chart as SVG that takes the page's colours, in light and in dark."""

from __future__ import annotations

from html import escape

import numpy as np

from calib_model.arrays import Array
from calib_solver.report.charts import SHAPES, Band, Chart, Range, Series, ranges, tick_text

LEFT, RIGHT, TOP, BOTTOM = 64.0, 20.0, 12.0, 52.0
#: an axis name has room for a character every so many units, and so has a band's
CHARACTER = 6.2


class Frame:
    """The plot's outline within a chart and its axes: from data to drawing units."""

    def __init__(self, chart: Chart) -> None:
        self.width, self.height = SHAPES[chart.shape]
        self.right, self.bottom = self.width - RIGHT, self.height - BOTTOM
        self.x, self.y = ranges(chart, self.right - LEFT, self.bottom - TOP)

    def across(self, value: Array) -> Array:
        """Drawing units of values along x."""
        return _between(self.x, value, LEFT, self.right)

    def up(self, value: Array) -> Array:
        """Drawing units of values along y."""
        return _between(self.y, value, self.bottom, TOP)


def _between(axis: Range, value: Array, begin: float, end: float) -> Array:
    placed: Array = begin + axis.share(np.asarray(value, dtype=float)) * (end - begin)
    return placed


def figure(chart: Chart) -> str:
    """A chart with its title, its key and what it says, as a figure."""
    frame = Frame(chart)
    parts = [_y_axis(chart, frame), _x_axis(chart, frame)]
    parts += [_drawn(one, frame) for one in chart.series]
    parts += [
        f'<text class="note" x="{float(frame.across(np.array(note.x))):.1f}"'
        f' y="{float(frame.up(np.array(note.y))) + 4:.1f}" text-anchor="middle">'
        f'{escape(note.text)}</text>'
        for note in chart.notes
    ]
    label = escape(f'{chart.title}. {chart.says}'.strip(), quote=True)
    says = f'<p class="says">{escape(chart.says)}</p>' if chart.says else ''
    return (
        f'<figure class="{chart.shape}"><figcaption><b>{escape(chart.title)}</b>{_key(chart)}'
        f'</figcaption><svg viewBox="0 0 {frame.width:g} {frame.height:g}" role="img"'
        f' aria-label="{label}">{"".join(parts)}</svg>{says}</figure>'
    )


def _key(chart: Chart) -> str:
    named = {one.label: one.role for one in chart.series if one.label}
    if not named:
        return ''
    spans = (f'<span class="key {role}">{escape(label)}</span>' for label, role in named.items())
    return f'<span class="keys">{"".join(spans)}</span>'


def _y_axis(chart: Chart, frame: Frame) -> str:
    lines, texts = [], []
    for tick in frame.y.ticks:
        y = float(frame.up(np.array(tick)))
        lines.append(f'M{LEFT:g} {y:.1f}H{frame.right:g}')
        texts.append(_text(LEFT - 6, y + 4, tick_text(tick), 'end'))
    middle = (TOP + frame.bottom) / 2
    turned = f'transform="rotate(-90 11 {middle:g})"'
    name = _text(11, middle, chart.y_label, 'middle', turned)
    return f'<path class="grid" d="{"".join(lines)}"/>{"".join(texts)}{name}'


def _x_axis(chart: Chart, frame: Frame) -> str:
    lines, texts = [], []
    below = frame.bottom + 20
    if chart.bands:
        for band in chart.bands[1:]:
            x = float(frame.across(np.array(band.begin)))
            lines.append(f'M{x:.1f} {TOP:g}V{frame.bottom:g}')
        texts += [
            _text((left + right) / 2, below, name, 'middle')
            for left, right, name in _named(chart.bands, frame)
        ]
    else:
        for tick in frame.x.ticks:
            x = float(frame.across(np.array(tick)))
            lines.append(f'M{x:.1f} {TOP:g}V{frame.bottom:g}')
            texts.append(_text(x, below, tick_text(tick), 'middle'))
    name = _text((LEFT + frame.right) / 2, frame.height - 8, chart.x_label, 'middle')
    return f'<path class="grid" d="{"".join(lines)}"/>{"".join(texts)}{name}'


def _named(bands: tuple[Band, ...], frame: Frame) -> list[tuple[float, float, str]]:
    """The bands whose names have room beside the last one that was named."""
    found: list[tuple[float, float, str]] = []
    free = 0.0
    for band in bands:
        left, right = frame.across(np.array([band.begin, band.end]))
        half = len(band.name) * CHARACTER / 2
        middle = (left + right) / 2
        if middle - half >= free and middle + half <= frame.width:
            found.append((float(left), float(right), band.name))
            free = middle + half + 2
    return found


def _text(x: float, y: float, text: str, anchor: str, more: str = '') -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"'
    return f'<text {place}{" " if more else ""}{more}>{escape(text)}</text>'


def _drawn(one: Series, frame: Frame) -> str:
    shown = np.isfinite(one.x) & np.isfinite(one.y)
    xs, ys = frame.across(one.x[shown]), frame.up(one.y[shown])
    if one.joined:
        # a gap in the values is a gap in the line
        begins = np.diff(np.concatenate([[-2], np.flatnonzero(shown)])) > 1
        points = (
            f'{"M" if begin else "L"}{x:.1f} {y:.1f}'
            for begin, x, y in zip(begins, xs, ys, strict=True)
        )
        return f'<path class="line {one.role}" d="{"".join(points)}"/>'
    size = 'fine' if one.fine else 'marks'
    if one.role == 'z':
        marks = ''.join(f'M{x - 3:.1f} {y + 3:.1f}h6l-3 -5.6z' for x, y in zip(xs, ys, strict=True))
    else:  # a stroke of no length shows its round or square end: a tenth of a circle's text
        marks = ''.join(f'M{x:.1f} {y:.1f}h0' for x, y in zip(xs, ys, strict=True))
    drawn = f'<path class="{size} {one.role}" d="{marks}"/>'
    return drawn + _named_points(one, shown, xs, ys) if one.names else drawn


def _named_points(one: Series, shown: Array, xs: Array, ys: Array) -> str:
    """What a pointer finds over each point: a mark of its own that is not seen, with its name."""
    names = (name for name, there in zip(one.names, shown, strict=True) if there)
    points = (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4"><title>{escape(name)}</title></circle>'
        for x, y, name in zip(xs, ys, names, strict=True)
    )
    return f'<g class="names">{"".join(points)}</g>'
