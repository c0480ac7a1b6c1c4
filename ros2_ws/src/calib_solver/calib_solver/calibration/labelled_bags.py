# SPDX-License-Identifier: Apache-2.0
"""Bags that hold no poses, among those that do: told apart, sorted, and their spheres numbered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_model import labelling
from calib_model.arrays import Array
from calib_model.bags import Told, listed_topics, read_messages, read_poses
from calib_model.errors import BagError
from calib_model.measurement import Measurement
from calib_model.topics import CAPTURE_POSES
from calib_solver.quality import ProbedSpheres


@dataclass(frozen=True)
class Part:
    """One bag: its measurement, and how it was sorted where it had no poses."""

    measured: Measurement
    raw: labelling.Sorted | None = None


def read_part(
    bag: str,
    given: labelling.Instruments,
    choice: labelling.RawSettings,
    anew: bool,
    told: Told | None = None,
) -> Part:
    """A bag's poses; with `anew`, or where it has none, those that its raw topics give.

    Raises:
        CalibrationError: the bag or a description cannot be read, or no pose comes of it.
    """
    if not anew and has_poses(bag):
        described, poses = read_poses(bag)
        if poses.untold.any():  # taken one by one, in sockets that nobody numbered
            raw = labelling.label_poses(bag, choice, given, described, poses)
            return Part(raw.measured, raw)
        arm, probe, gauge = (
            given.arm or described.arm(),
            given.probe or described.probe(),
            given.gauge or described.gauge(),
        )
        return Part(Measurement(arm, probe, gauge, poses, bag).checked())
    try:
        raw = labelling.label_bag(bag, choice, given, told)
    except BagError as error:
        if anew or 'no messages on' not in str(error):
            raise
        raise BagError(f'{error}; nor poses on {CAPTURE_POSES.name}') from error
    return Part(raw.measured, raw)


def has_poses(bag: str) -> bool:
    """Whether a bag has messages on /capture/poses.

    Raises:
        BagError: there is no bag, or it cannot be read.
    """
    topics = listed_topics(bag)
    if topics:
        return CAPTURE_POSES.name in topics
    return next(read_messages(bag, {CAPTURE_POSES.name}), None) is not None


@dataclass(frozen=True)
class RawSpheres:
    """The numbering of all raw bags of a measurement; `locations` (L,) are the numbers that their
    locations have there, `lines` what was done."""

    parts: tuple[labelling.Sorted, ...]
    numbering: labelling.Numbering
    locations: tuple[int, ...]
    lines: tuple[str, ...]

    @staticmethod
    def of(parts: Sequence[labelling.Sorted]) -> RawSpheres:
        """The spheres of bags just sorted, their locations not yet those of a measurement."""
        lines = [line for part in parts for line in part.lines]
        return RawSpheres(tuple(parts), labelling.numbering_of(parts), (), tuple(lines))

    def measurements(self) -> list[Measurement]:
        """Each raw bag's, with the certificate's numbers."""
        found, numbers = [], list(self.numbering.numbers)
        for part in self.parts:
            mine, numbers = numbers[: len(part.locations)], numbers[len(part.locations) :]
            found.append(labelling.with_numbers(part, mine))
        return found

    def told_by(self, spheres: ProbedSpheres) -> RawSpheres:
        """With the numbers that the distances between these centres tell, if they do."""
        row = {(int(one), int(two)): i for i, (one, two) in enumerate(spheres.keys)}
        seen: list[Array] = []
        variance: list[Array] = []
        for location, numbers in zip(self.locations, self.numbering.numbers, strict=True):
            rows = [row.get((location, number)) for number in numbers]
            seen.append(np.array([_center(spheres, one) for one in rows]))
            variance.append(np.array([_variance(spheres, one) for one in rows]))
        certificate = self.parts[0].certificate
        return replace(
            self, numbering=labelling.renumbered(self.numbering, certificate, seen, variance)
        )

    def relabelled(self, measured: Measurement, before: labelling.Numbering) -> Measurement:
        """A measurement numbered as `before`, numbered as now."""
        poses = measured.poses
        sphere = poses.sphere.copy()
        for location, old, new in zip(
            self.locations, before.numbers, self.numbering.numbers, strict=True
        ):
            there = poses.location == location
            for one, other in zip(old, new, strict=True):
                sphere[there & (poses.sphere == one)] = other
        return replace(measured, poses=replace(poses, sphere=sphere))


def _center(spheres: ProbedSpheres, row: int | None) -> Array:
    return np.full(3, np.nan) if row is None else spheres.center[row]


def _variance(spheres: ProbedSpheres, row: int | None) -> float:
    """Of a centre along any direction, m^2."""
    if row is None or not np.isfinite(spheres.two_sigma[row]).all():
        return 0.0
    return float(np.mean((spheres.two_sigma[row] / 2) ** 2) / spheres.poses[row])
