# SPDX-License-Identifier: Apache-2.0
"""A measuring program to look at before it runs, as shapes in the arm's base frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib_capture.program import Program
from calib_model.arm import Arm
from calib_model.gauge import Gauge
from calib_model.kinematics import forward
from calib_model.probe import Probe
from calib_model.rotation import Array, RigidTransform, frozen

Color = tuple[float, float, float, float]
SPHERES, LINES = 'spheres', 'lines'
GREY: Color = (0.6, 0.6, 0.6, 0.6)
BLUE: Color = (0.1, 0.4, 0.9, 1.0)
RED: Color = (0.9, 0.2, 0.1, 1.0)
GREEN: Color = (0.2, 0.7, 0.3, 0.8)
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


def program_markers(
    program: Program, arm: Arm, probe: Probe, gauge: Gauge,
    placements: Mapping[int, RigidTransform],
) -> list[Marker]:  # fmt: skip
    """The gauge at each location of the program, its probed spheres (blue, red where out of
    reach), and a needle for each pose from where the probe comes."""
    markers: list[Marker] = []
    unreached = set(program.unreached)
    certified = np.array([center for _, center in gauge.spheres])
    for location in sorted({plan.location for plan in program.spheres}):
        place = placements[location]
        bar = place.apply(certified)
        asked = [plan.sphere for plan in program.spheres if plan.location == location]
        rest = [number not in asked for number in gauge.numbers]
        diameter = gauge.sphere_diameter
        markers.append(Marker('gauge', location, SPHERES, frozen(bar[rest]), diameter, GREY))
        ends = np.repeat(bar, 2, axis=0)[1:-1]
        markers.append(Marker('bar', location, LINES, frozen(ends), diameter / 4, GREY))
        for group, color, missing in (('probed', BLUE, False), ('out_of_reach', RED, True)):
            numbers = [n for n in asked if ((location, n) in unreached) == missing]
            if numbers:
                centers = np.array([place.apply(gauge.center(n)) for n in numbers])
                shown = Marker(group, location, SPHERES, frozen(centers), 1.2 * diameter, color)
                markers.append(shown)
        needles = _needles(program, arm, probe, location)
        if len(needles):
            markers.append(Marker('poses', location, LINES, frozen(needles), THIN, GREEN))
    return markers


def _needles(program: Program, arm: Arm, probe: Probe, location: int) -> Array:
    """Two ends (2K, 3) for each pose: at the sphere's centre and back along the probe's axis."""
    poses = [pose for pose in program.poses if pose.location == location]
    if not poses:
        return np.empty((0, 3))
    T = forward(arm, np.array([pose.joints for pose in poses])) @ probe.flange_T_probe.matrix()
    seats = np.array([pose.p_probe_sphere for pose in poses])
    centers = np.einsum('nij,nj->ni', T[:, :3, :3], seats) + T[:, :3, 3]
    ends: Array = np.stack([centers, centers - NEEDLE * T[:, :3, 2]], axis=1).reshape(-1, 3)
    return ends
