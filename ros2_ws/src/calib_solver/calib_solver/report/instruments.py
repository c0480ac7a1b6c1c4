# SPDX-License-Identifier: Apache-2.0
"""The report's account of what was measured with what and when, and from which files."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from calib_model.bags import bag_files
from calib_model.files import open_file
from calib_model.instruments import Gauge, PassiveProbe, Probe
from calib_model.measurement import ProbingSet
from calib_solver.held_out import HeldOut
from calib_solver.identified import Identification
from calib_solver.report.html import counted, mm, paragraph, part, table, two_digits
from calib_solver.results import reading_times, scale_words

#: what the packages are called together where they come as one wheel
TOGETHER = 'robot-arm-calibration'
PACKAGES = ('calib_solver', 'calib_model', 'numpy', 'mcap')


@dataclass(frozen=True)
class Inputs:
    """The files that a calibration was made from: bags to identify from, held-out ones, and
    descriptions (what of, path) that took the place of the bags' own."""

    bags: tuple[str, ...]
    test: tuple[str, ...] = ()
    descriptions: tuple[tuple[str, str], ...] = ()

    def files(self) -> Iterable[tuple[str, Path]]:
        """Every file with what it was used for."""
        for use, bags in (('identified from', self.bags), ('held out', self.test)):
            for bag in bags:
                yield from ((use, file) for file in bag_files(bag))
        for of, path in self.descriptions:
            yield f'{of} description', Path(path)


def instrument_rows(done: Identification, held_out: HeldOut | None) -> list[tuple[str, str]]:
    """Arm, probe, gauge with its certificate, and the poses taken."""
    measured = done.problem.measured
    arm, gauge = measured.arm, measured.gauge
    rows = [
        ('Arm', f'{arm.name}, {arm.n} joints: {", ".join(arm.joint_names)}'),
        ('Probe', _probe(measured.probe)),
        (
            'Gauge',
            f'{gauge.name}, {len(gauge.spheres)} spheres of {gauge.sphere_diameter * 1e3:g} '
            'mm diameter',
        ),
        (
            'Certificate',
            f'U (k = 2) of a distance L: {_distance_uncertainty(gauge)}; the centres '
            'are listed at the end',
        ),
        ('Temperature', f'{scale_words(gauge)}.'),
        ('Identified from', _taken(done.problem.measured.poses, len(done.rejected))),
    ]
    if held_out is not None:
        rows.append(('Held out', _taken(held_out.problem.measured.poses)))
    return rows


def _probe(probe: Probe) -> str:
    if isinstance(probe, PassiveProbe):
        return f'{probe.name}, passive: a seat that centres the sphere'
    low, high = probe.stroke.T * 1e3
    tips = ', '.join(f'{radius:g}' for radius in sorted({s.tip_radius * 1e3 for s in probe.styli}))
    return (
        f'{probe.name}, active: {len(probe.styli)} styli with tips of {tips} mm radius, read from '
        f'{low.max():g} to {high.min():g} mm'.replace(' -', ' \u2212')
    )


def _distance_uncertainty(gauge: Gauge) -> str:
    parts = []
    if gauge.constant or not gauge.proportional:
        parts.append(f'{gauge.constant * 1e6:g} µm')
    if gauge.proportional:
        parts.append(f'{gauge.proportional * 1e6:g} µm/m · L')
    return ' + '.join(parts)


def _taken(poses: ProbingSet, left_out: int = 0) -> str:
    spheres = len(np.unique(np.stack([poses.location, poses.sphere]), axis=1).T)
    locations = np.unique(poses.location)
    names = ', '.join(map(str, locations))
    readings = np.unique(poses.readings)
    text = (
        f'{counted(len(poses), "pose")} of {counted(spheres, "sphere")} at '
        f'{counted(len(locations), "location")} ({names}), '
        f'{_span(readings.tolist())} reading{"s" if readings.max() > 1 else ""} a pose'
    )
    if left_out:
        text += f'; {left_out} more left out, listed under Residuals'
    return f'{text}; {_when(poses)}.'


def _span(values: list[int]) -> str:
    return f'{values[0]}' if len(values) == 1 else f'{values[0]} to {values[-1]}'


def _when(poses: ProbingSet) -> str:
    """First and last reading by their stamps, as a time of day where they are one."""
    span = reading_times(poses)
    if span is None:
        return 'the readings have no date'
    begin, end = span
    until = f'{end:%H:%M:%S}' if begin.date() == end.date() else f'{end:%Y-%m-%d %H:%M:%S}'
    return f'readings stamped {begin:%Y-%m-%d %H:%M:%S} to {until} UTC'


def certificate_rows(gauge: Gauge) -> dict[str, list[Any]]:
    """The certified centres and distances, with their expanded uncertainty."""
    origin = gauge.numbers[0]
    rows = []
    for number, center in gauge.spheres:
        length = gauge.distance(origin, number)
        sure = '–' if number == origin else two_digits(gauge.distance_uncertainty(length), 1e6)
        rows.append([f'B{number}', *map(mm, center), mm(length), sure])
    header = ['sphere', 'X, mm', 'Y, mm', 'Z, mm', f'from B{origin}, mm', 'U (k = 2), µm']
    return {'header': header, 'rows': rows}


def file_rows(given: Inputs) -> list[list[str]]:
    """Every input file with its SHA-256."""
    return [[use, str(file), _sha256(file)] for use, file in given.files()]


def inputs(files: list[list[str]], used: list[str]) -> str:
    """The rows of `file_rows`, and the versions that it was computed with."""
    header = ['use', 'file', 'SHA-256']
    listed = table('', header, files, styles={1: 'mono', 2: 'mono'})
    return part('Files') + listed + paragraph(f'Computed with {", ".join(used)}.', 'faint')


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with open_file(path) as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ''


def versions() -> list[str]:
    """What the calibration was computed with."""
    found = []
    for package in PACKAGES:
        names = (package, TOGETHER) if package.startswith('calib_') else (package,)
        told = next(filter(None, map(_version, names)), '(not installed as a package)')
        found.append(f'{package} {told}')
    return [*found, f'{platform.python_implementation()} {platform.python_version()}']
