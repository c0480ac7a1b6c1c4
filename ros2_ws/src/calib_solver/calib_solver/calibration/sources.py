# SPDX-License-Identifier: Apache-2.0
"""Measurements from the bags and descriptions that a command line or a service request names."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_model.bags import (
    Temperature,
    cut_files,
    has_points,
    left_aside,
    listed_topics,
    read_temperature,
    together,
)
from calib_model.descriptions import (
    parse_arm,
    parse_gauge,
    parse_probe,
    read_description,
)
from calib_model.errors import DataError
from calib_model.instruments import Arm, Probe
from calib_model.kinematics import Correction
from calib_model.labelling import Instruments, RawSettings
from calib_model.measurement import Measurement, ProbingSet
from calib_model.progress import Pace, Progress
from calib_model.topics import ARM_DESCRIPTION, PROBE_DESCRIPTION
from calib_solver.calibration.duplicate_poses import find_duplicates
from calib_solver.calibration.labelled_bags import Part, RawSpheres, read_part
from calib_solver.held_out import refuse_other_instruments, refuse_other_probe
from calib_solver.problem import Problem
from calib_solver.quality import ProbedSpheres, assess


@dataclass(frozen=True)
class Sources:
    """Bags that make one measurement, and YAML files that take the place of their descriptions;
    `links` is a YAML or URDF file with what the arm's links weigh. Bags without poses are paired
    and sorted as `raw` says, `anew` those with poses, too. `temperature` is the gauge's, in place
    of what the bags' notes say, `instead` is taken for descriptions that a bag does not have."""

    bags: tuple[str, ...]
    arm: str = ''
    probe: str = ''
    gauge: str = ''
    links: str = ''
    raw: RawSettings = RawSettings()
    anew: bool = False
    temperature: Temperature | None = None
    instead: Instruments = Instruments()


def bag_list(text: str) -> tuple[str, ...]:
    """The bags a request names: one path, or several separated by ':'."""
    if not text or os.path.exists(text):
        return (text,) if text else ()
    return tuple(part for part in text.split(':') if part)


@dataclass(frozen=True)
class Loaded:
    """A measurement, and what its bags without poses say of the numbers of their spheres."""

    measured: Measurement
    raw: RawSpheres | None = None
    duplicates: int = 0  # poses that were left out: others are the same to the last digit

    def told_by(self, spheres: ProbedSpheres) -> Loaded:
        """Numbered as the distances between these centres tell, where they do so clearly."""
        if self.raw is None or not self.raw.numbering.open:
            return self
        told = self.raw.told_by(spheres)
        return replace(self, measured=told.relabelled(self.measured, self.raw.numbering), raw=told)

    def told_with(self, arm: Arm, probe: Probe, model: Correction | None = None) -> Loaded:
        """Numbered by the distances that this arm sees."""
        if self.raw is None or not self.raw.numbering.open:
            return self
        return self.told_by(assess(Problem.of(self.measured), arm, probe, model).spheres)

    @property
    def lines(self) -> tuple[str, ...]:
        """How bags without poses became a measurement."""
        return () if self.raw is None else (*self.raw.lines, self.raw.numbering.line())

    def without_duplicates(self) -> Loaded:
        """Each pose once."""
        poses = self.measured.poses
        copy = find_duplicates(poses)
        if not copy.any():
            return self
        measured = replace(self.measured, poses=poses.take(~copy))
        return replace(self, measured=measured, duplicates=int(copy.sum()))


def hold_points(sources: Sources) -> bool:
    """Whether these are bags of measured points.

    Raises:
        BagError: a bag is missing or cannot be read.
        DataError: some are and some are not.
    """
    found = {bag: has_points(bag) for bag in sources.bags}
    if len(set(found.values())) > 1:
        first = next(bag for bag, points in found.items() if points)
        other = next(bag for bag, points in found.items() if not points)
        raise DataError(
            f'{first}: holds measured points, {other} does not: they are no one measurement'
        )
    return bool(found) and all(found.values())


def load(sources: Sources) -> Measurement:
    """The measurement of one or several bags; each further bag's locations are its own.

    Raises:
        CalibrationError: a bag or a description cannot be read, or they do not go together.
    """
    loaded = load_all(sources)
    return loaded.told_with(loaded.measured.arm, loaded.measured.probe).measured


def load_all(sources: Sources, progress: Progress | None = None) -> Loaded:
    """As `load`, with the numbers of a raw bag's spheres still open; tells how far reading is.

    Raises:
        CalibrationError: a bag or a description cannot be read, or they do not go together.
    """
    if not sources.bags:
        raise DataError('no bag given')
    given = Instruments(
        read_description(sources.arm, parse_arm) if sources.arm else None,
        read_description(sources.probe, parse_probe) if sources.probe else None,
        read_description(sources.gauge, parse_gauge) if sources.gauge else None,
    )
    found: list[Part] = []
    for bag in sources.bags:
        if has_points(bag):
            raise DataError(
                f'{bag}: holds measured points; the commands identify and evaluate take bags of '
                'these alone, all else takes probing poses'
            )
        pace = Pace(progress, f'reading {bag}', 'MB', 1e6)
        known = _completed(given, sources.instead, bag)
        found.append(read_part(bag, known, sources.raw, sources.anew, pace))
        pace.end()
    sorted_bags = [part.raw for part in found if part.raw is not None]
    if not sorted_bags:
        measured = _joined([part.measured for part in found])[0]
        return Loaded(_at_its_temperature(measured, sources)).without_duplicates()
    raw = RawSpheres.of(sorted_bags)
    numbered = iter(raw.measurements())
    parts = [part.measured if part.raw is None else next(numbered) for part in found]
    measured, shifts = _joined(parts)
    locations = tuple(
        number + shift
        for part, shift in zip(found, shifts, strict=True)
        if part.raw is not None
        for number in range(1, len(part.raw.locations) + 1)
    )
    measured = _at_its_temperature(measured, sources)
    return Loaded(measured, replace(raw, locations=locations)).without_duplicates()


def _completed(given: Instruments, instead: Instruments, bag: str) -> Instruments:
    """What was given, and what stands in for descriptions that are not in the bag."""
    topics = listed_topics(bag)
    if not topics:  # it may have them
        return given
    arm = None if ARM_DESCRIPTION.name in topics else instead.arm
    probe = None if PROBE_DESCRIPTION.name in topics else instead.probe
    return replace(given, arm=given.arm or arm, probe=given.probe or probe)


def _at_its_temperature(measured: Measurement, sources: Sources) -> Measurement:
    """With the gauge as long as it was, where its temperature is known."""
    if sources.temperature is not None:
        if not sources.temperature.plausible:
            raise DataError(f'{sources.temperature.celsius:g} deg C is no temperature of a gauge')
        found = [sources.temperature]
    elif measured.gauge.expansion is None:
        return measured
    else:
        told = (read_temperature(bag) for bag in sources.bags)
        found = [one for one in told if one is not None]
    if not found:
        return measured
    one = together(found)
    return replace(measured, gauge=measured.gauge.at(one.celsius, one.uncertainty))


def _joined(parts: Sequence[Measurement]) -> tuple[Measurement, list[int]]:
    """Bags of one arm as one measurement, and how far up the location numbers of each were moved
    so that none is used twice."""
    first = parts[0]
    if len(parts) == 1:
        return first, [0]
    sets: list[ProbingSet] = []
    used: set[int] = set()
    shifts: list[int] = []
    for part in parts:
        refuse_other_instruments(part, first)
        refuse_other_probe(part, first, '; --probe names one for all')
        if not np.array_equal(part.arm.geometry, first.arm.geometry):
            raise DataError(f'{part.source}: other nominal parameters than in {first.source}')
        if part.gauge != first.gauge:
            raise DataError(f'{part.source}: another gauge than in {first.source}')
        own = set(map(int, part.poses.location))
        shift = max(used) + 1 - min(own) if own & used else 0
        used |= {number + shift for number in own}
        shifts.append(shift)
        poses = part.poses
        sets.append(
            ProbingSet(
                np.asarray(poses.location) + shift,
                poses.sphere,
                poses.joints,
                poses.displacement,
                poses.stamp,
                poses.readings,
            )
        )
    source = ', '.join(part.source for part in parts)
    joined = ProbingSet.joined(sets)
    probe = replace(first.probe, simulated=any(part.probe.simulated for part in parts))
    return Measurement(first.arm, probe, first.gauge, joined, source), shifts


def unread_lines(bags: Sequence[str]) -> tuple[str, ...]:
    """A line for each file that ends before its end, and for what a bag's folder has besides."""
    aside = [(bag, left_aside(bag)) for bag in bags]
    return tuple(
        f'{bag}: {", ".join(file.name for file in files)} in its folder '
        f'{"is" if len(files) == 1 else "are"} not in its metadata.yaml and not read'
        for bag, files in aside
        if files
    ) + tuple(
        f'{file}: cut short, what was whole is used; ros2 run calib_capture recover says how much '
        'that is'
        for bag in bags
        for file in cut_files(bag)
    )
