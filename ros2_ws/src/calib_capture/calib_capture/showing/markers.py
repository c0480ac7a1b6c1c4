# SPDX-License-Identifier: Apache-2.0
"""A measuring program and what comes of it, as shapes in the arm's base frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib_capture.measuring import TakenPose
from calib_capture.program import PlannedPose, Program
from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm, Gauge, Probe, known_centers
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import RigidTransform

Color = tuple[float, float, float, float]
SPHERES, LINES = 'spheres', 'lines'
GREY: Color = (0.6, 0.6, 0.6, 0.6)
BLUE: Color = (0.1, 0.4, 0.9, 1.0)
RED: Color = (0.9, 0.2, 0.1, 1.0)
GREEN: Color = (0.2, 0.7, 0.3, 0.8)
PALE: Color = (0.5, 0.75, 0.55, 0.35)
NEEDLE = 0.06  # m of every probing direction that is drawn
THIN = 0.001  # m


@dataclass(frozen=True)
class Marker:
    """Shapes of one kind: `points` (K, 3), m, are the centres of spheres of diameter `size` (m), or
    the ends, two by two, of lines of that width. `group` and `number` name it; RGBA from 0 to 1."""

    group: str
    number: int
    kind: str
    points: Array
    size: float
    color: Color


def gauge_markers(gauge: Gauge, placements: Mapping[int, RigidTransform]) -> list[Marker]:
    """The gauge's bar and spheres, grey, at each of its places."""
    markers: list[Marker] = []
    certified = np.array([center for _, center in gauge.spheres])
    for location, place in sorted(placements.items()):
        bar, diameter = frozen(place.apply(certified)), gauge.sphere_diameter
        markers.append(Marker('gauge', location, SPHERES, bar, diameter, GREY))
        ends = frozen(np.repeat(bar, 2, axis=0)[1:-1])
        markers.append(Marker('bar', location, LINES, ends, diameter / 4, GREY))
    return markers


def program_markers(
    program: Program,
    arm: Arm,
    probe: Probe,
    gauge: Gauge,
    placements: Mapping[int, RigidTransform],
) -> list[Marker]:
    """The gauge at each location of the program, its probed spheres (blue, red where out of
    reach), and a pale needle for each planned pose from where the probe comes."""
    locations = sorted({plan.location for plan in program.spheres})
    markers = gauge_markers(gauge, {number: placements[number] for number in locations})
    for location in locations:
        markers += _asked(program, gauge, location, placements[location])
        poses = [pose for pose in program.poses if pose.location == location]
        if poses:
            joints = np.array([pose.joints for pose in poses])
            seats = np.array([pose.p_probe_sphere for pose in poses])
            markers.append(_needles('poses', location, PALE, arm, probe, joints, seats))
    return markers


def _asked(program: Program, gauge: Gauge, location: int, place: RigidTransform) -> list[Marker]:
    """The spheres to be probed, a little larger than they are, so that they are seen."""
    unreached = set(program.unreached)
    asked = [plan.sphere for plan in program.spheres if plan.location == location]
    markers = []
    for group, color, missing in (('probed', BLUE, False), ('out_of_reach', RED, True)):
        numbers = [n for n in asked if ((location, n) in unreached) == missing]
        if numbers:
            centers = frozen(np.array([place.apply(gauge.center(n)) for n in numbers]))
            size = 1.2 * gauge.sphere_diameter
            markers.append(Marker(group, location, SPHERES, centers, size, color))
    return markers


def outcome_markers(
    taken: Sequence[TakenPose],
    refused: Sequence[PlannedPose],
    arm: Arm,
    probe: Probe,
    gauge: Gauge,
) -> list[Marker]:
    """What came of the poses so far, a needle each: green where it was taken, red where refused."""
    markers = []
    if taken:
        joints = np.array([pose.measured.joints for pose in taken])
        read = np.array([pose.measured.displacement for pose in taken])
        seats = known_centers(probe, read, gauge.sphere_diameter)
        where = np.nan_to_num(seats)  # of a reading that no sphere gives, in the probe's middle
        markers.append(_needles('taken', 0, GREEN, arm, probe, joints, where))
    if refused:
        joints = np.array([pose.joints for pose in refused])
        seats = np.array([pose.p_probe_sphere for pose in refused])
        markers.append(_needles('refused', 0, RED, arm, probe, joints, seats))
    return markers


def _needles(
    group: str, number: int, color: Color, arm: Arm, probe: Probe, joints: Array, seats: Array
) -> Marker:
    """From the sphere's centre back along the probe's axis, for postures (K, n) of the arm with
    the sphere at `seats` (K, 3) in the probe."""
    T = forward_kinematics(arm, joints) @ probe.flange_T_probe.matrix()
    centers = np.einsum('nij,nj->ni', T[:, :3, :3], seats) + T[:, :3, 3]
    ends = np.stack([centers, centers - NEEDLE * T[:, :3, 2]], axis=1).reshape(-1, 3)
    return Marker(group, number, LINES, frozen(ends), THIN, color)
