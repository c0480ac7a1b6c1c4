# SPDX-License-Identifier: Apache-2.0
"""What a chart of the report shows, apart from how it is drawn: once as SVG, once as PNG."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np

from calib_model.arrays import Array

#: outlines in drawing units: most charts, clouds, one per joint, views of the workspace
SHAPES = {
    'wide': (460.0, 280.0),
    'square': (300.0, 290.0),
    'small': (300.0, 200.0),
    'view': (460.0, 380.0),
}
#: superscripts
RAISED = str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹')


@dataclass(frozen=True)
class Series:
    """Points x (K,), y (K,); what they stand for, their role, decides colour and mark.

    Roles are those of `png.COLOURS` and of the page's style. `joined` draws a line through the
    points, `fine` makes dots small enough for thousands. `names` (K), where given, are what the
    pointer is told over each point.
    """

    x: Array
    y: Array
    role: str
    label: str = ''
    joined: bool = False
    fine: bool = False
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Band:
    """A stretch of the x axis with a name under it, as one gauge location's spheres."""

    begin: float
    end: float
    name: str


@dataclass(frozen=True)
class Note:
    """A short text, its middle at a point."""

    x: float
    y: float
    text: str


@dataclass(frozen=True)
class Chart:
    """One figure: `name` is its file's, `says` what is to be read from it, in a sentence or none.

    `bands` take the place of numbers along the x axis; `equal` gives both axes one scale.
    """

    name: str
    title: str
    says: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    shape: str = 'wide'
    logarithmic: bool = False
    equal: bool = False
    bands: tuple[Band, ...] = ()
    notes: tuple[Note, ...] = ()

    @property
    def x(self) -> Array:
        """Every finite x of the series and bands."""
        ends = [np.array([band.begin, band.end]) for band in self.bands]
        return _finite([*(one.x for one in self.series), *ends])

    @property
    def y(self) -> Array:
        """Every finite y of the series."""
        return _finite([one.y for one in self.series])


def _finite(parts: list[Array]) -> Array:
    values = np.concatenate([np.asarray(part, dtype=float) for part in parts])
    return values[np.isfinite(values)]


@dataclass(frozen=True)
class Range:
    """From where to where an axis goes, in its own or in decades, and where its ticks are."""

    low: float
    high: float
    ticks: tuple[float, ...]
    logarithmic: bool = False

    def share(self, value: Array) -> Array:
        """Where values are between the ends, 0 to 1."""
        if self.logarithmic:
            value = np.log10(np.maximum(value, 10.0**self.low))
        share: Array = (value - self.low) / (self.high - self.low)
        return share


def linear(values: Array, most: int = 5) -> Range:
    """Round ends around the values."""
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    step = round_step((high - low) / (most - 1) or abs(high) or 1.0)
    if np.array_equal(values, np.round(values)):
        step = max(step, 1.0)
    first, last = floor(low / step + 1e-9), ceil(high / step - 1e-9)
    if last <= first:  # a single value stands in the middle
        first, last = first - 1, first + 1
    ticks = tuple(step * k for k in range(first, last + 1))
    return Range(step * first, step * last, ticks)


def decades(values: Array) -> Range:
    """Whole decades around the values; where there is but one, 2 and 5 are marked, too."""
    values = values[values > 0]
    low, high = (values.min(), values.max()) if len(values) else (0.1, 1.0)
    first = floor(log10(low) + 1e-9)
    last = max(ceil(log10(high) - 1e-9), first + 1)
    marks = (1.0, 2.0, 5.0) if last - first == 1 else (1.0,)
    every = 1 + (last - first - 1) // 7
    ticks = [10.0**k * mark for k in range(first, last, every) for mark in marks]
    return Range(first, last, (*ticks, 10.0**last), True)


def spanning(low: float, high: float, most: int = 5) -> Range:
    """Exactly from `low` to `high`, with the round ticks that are between; a single value stands in
    the middle."""
    if not high > low:
        low, high = low - 0.5, high + 0.5
    step = round_step((high - low) / (most - 1))
    ticks = [step * k for k in range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)]
    return Range(low, high, tuple(ticks))


def ranges(chart: Chart, width: float, height: float) -> tuple[Range, Range]:
    """The axes of a chart whose plot is `width` by `height`."""
    if chart.equal:
        return _equal(chart, width, height)
    x = chart.x
    across = spanning(x.min(), x.max()) if chart.bands else linear(x)
    return across, decades(chart.y) if chart.logarithmic else linear(chart.y)


def _equal(chart: Chart, width: float, height: float) -> tuple[Range, Range]:
    x, y = chart.x, chart.y
    rounding = 1e-9 * max(np.abs(x).max(), np.abs(y).max()) / min(width, height)
    unit = max(1.08 * max(np.ptp(x) / width, np.ptp(y) / height), rounding) or 1.0
    found = []
    for values, size in ((x, width), (y, height)):
        middle = (values.min() + values.max()) / 2
        found.append(spanning(middle - unit * size / 2, middle + unit * size / 2))
    return found[0], found[1]


def round_step(size: float) -> float:
    """The next of 1, 2, 5 times a power of ten."""
    power = 10.0 ** floor(log10(size))
    return float(next(power * k for k in (1, 2, 5, 10) if power * k >= size * 0.999))


def tick_text(value: float) -> str:
    """A tick's number, short: far from one as a power of ten, which such ticks are."""
    if value and not 1e-4 < abs(value) < 1e5:
        power = round(log10(abs(value)))
        if abs(value) == 10.0**power:
            return f'10{str(power).translate(RAISED)}'
    return f'{0.0 if abs(value) < 1e-15 else value:.4g}'.replace('-', '\u2212')
