# SPDX-License-Identifier: Apache-2.0
"""Small SVG charts for the report: they take the page's colours, in light and in dark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor, log10

import numpy as np

from calib_model.rotation import Array

WIDTH, HEIGHT = 460.0, 250.0
LEFT, RIGHT, TOP, BOTTOM = 58.0, 12.0, 10.0, 42.0


@dataclass(frozen=True)
class Series:
    """Points x (K,), y (K,) drawn with CSS class `style`; `joined` draws a line through them."""

    x: Array
    y: Array
    style: str
    label: str = ''
    joined: bool = False


class Axis:
    """From data to pixels along one axis, linear or logarithmic, with round ticks."""

    def __init__(self, values: Array, begin: float, end: float, logarithmic: bool) -> None:
        self.begin, self.end, self.logarithmic = begin, end, logarithmic
        self.low: float
        self.high: float
        values = values[np.isfinite(values)]
        if logarithmic:
            values = values[values > 0]
            low, high = (values.min(), values.max()) if len(values) else (0.1, 1.0)
            self.low, self.high = floor(log10(low)), max(ceil(log10(high)), floor(log10(low)) + 1)
            self.ticks = [10.0**k for k in range(int(self.low), int(self.high) + 1)]
        else:
            low, high = (values.min(), values.max()) if len(values) else (0.0, 1.0)
            step = _round_step((high - low) / 4 or abs(high) or 1.0)
            self.low, self.high = floor(low / step) * step, ceil(high / step) * step
            self.high += step if self.high <= self.low else 0.0
            count = round((self.high - self.low) / step)
            self.ticks = [self.low + step * k for k in range(count + 1)]

    def place(self, value: Array) -> Array:
        """Pixels of data values."""
        if self.logarithmic:
            value = np.log10(np.maximum(value, 10.0**self.low))
        share = (value - self.low) / (self.high - self.low)
        placed: Array = self.begin + share * (self.end - self.begin)
        return placed


def _round_step(size: float) -> float:
    power = 10.0 ** floor(log10(size))
    return float(next(power * k for k in (1, 2, 5, 10) if power * k >= size * 0.999))


def chart(
    series: Sequence[Series], title: str, x_label: str, y_label: str, logarithmic: bool = False
) -> str:
    """A chart of one or several series with its title as a figure."""
    x_axis = Axis(np.concatenate([s.x for s in series]), LEFT, WIDTH - RIGHT, False)
    y_values = np.concatenate([s.y for s in series])
    y_axis = Axis(y_values, HEIGHT - BOTTOM, TOP, logarithmic)
    parts = [_grid(x_axis, y_axis, x_label, y_label)]
    for one in series:
        parts.append(_drawn(one, x_axis, y_axis))
    legend = ''.join(
        f'<span class="key {s.style}">{escape(s.label)}</span>' for s in series if s.label
    )
    return (
        f'<figure><figcaption>{escape(title)} {legend}</figcaption>'
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" aria-label="{escape(title)}">'
        f'{"".join(parts)}</svg></figure>'
    )


def _grid(x_axis: Axis, y_axis: Axis, x_label: str, y_label: str) -> str:
    bottom = HEIGHT - BOTTOM
    parts = []
    for tick in x_axis.ticks:
        x = float(x_axis.place(np.array(tick)))
        parts.append(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{bottom}"/>')
        parts.append(f'<text x="{x:.1f}" y="{bottom + 15}" text-anchor="middle">{tick:.4g}</text>')
    for tick in y_axis.ticks:
        y = float(y_axis.place(np.array(tick)))
        line = f'x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}"'
        parts.append(f'<line class="grid" {line}/>')
        parts.append(f'<text x="{LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">{tick:.4g}</text>')
    middle = (LEFT + WIDTH - RIGHT) / 2
    place = f'x="{middle}" y="{HEIGHT - 8}" text-anchor="middle"'
    parts.append(f'<text {place}>{escape(x_label)}</text>')
    height = (TOP + bottom) / 2
    parts.append(
        f'<text transform="rotate(-90 12 {height})" x="12" y="{height}" text-anchor="middle">'
        f'{escape(y_label)}</text>'
    )
    return ''.join(parts)


def _drawn(one: Series, x_axis: Axis, y_axis: Axis) -> str:
    shown = np.isfinite(one.x) & np.isfinite(one.y)
    xs, ys = x_axis.place(one.x[shown]), y_axis.place(one.y[shown])
    if one.joined:
        points = ' '.join(f'{x:.1f},{y:.1f}' for x, y in zip(xs, ys, strict=True))
        return f'<polyline class="{one.style}" points="{points}"/>'
    # one path of round dots is a tenth of the size of a circle each
    dots = ''.join(f'M{x:.1f} {y:.1f}h0' for x, y in zip(xs, ys, strict=True))
    return f'<path class="dots {one.style}" d="{dots}"/>'
