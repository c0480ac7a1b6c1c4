# SPDX-License-Identifier: Apache-2.0
"""Teaching a gauge location: two spheres probed by hand say where all of them are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.descriptions import parse_placements, placements_yaml, read_description
from calib_model.errors import CalibrationError
from calib_model.files import write_whole
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.kinematics import points
from calib_model.transforms import RigidTransform, rotation_matrix

TOLERANCE = 2e-3  # m: what an arm not yet calibrated may be off over the length of a bar
UPRIGHT = 1e-6  # sine of the angle to the vertical below which turning a bar lifts nothing


class TeachError(CalibrationError):
    """Two probed spheres that do not say where the gauge stands."""


@dataclass(frozen=True)
class TaughtSphere:
    """A sphere of the certificate and its centre (3,) as the arm measured it, m, base frame."""

    number: int
    p_base_sphere: Array


@dataclass(frozen=True)
class TaughtLocation:
    """Where a gauge stands: `T_base_gauge`, and both lengths between the taught spheres, m."""

    location: int
    T_base_gauge: RigidTransform
    measured_length: float
    certified_length: float

    def centers(self, gauge: Gauge) -> dict[int, Array]:
        """The nominal centre (3,) of every sphere by its number, m, base frame."""
        place = self.T_base_gauge
        return {number: frozen(place.apply(gauge.center(number))) for number in gauge.numbers}

    def yaml(self, base_frame: str = 'base_link') -> str:
        """The text that `calib_model.descriptions.placements.parse_placements` reads."""
        return placements_yaml({self.location: self.T_base_gauge}, base_frame)


@dataclass(frozen=True)
class TaughtBook:
    """The file that taught locations are kept in; with an empty path they are not."""

    path: str

    def read(self) -> dict[int, RigidTransform]:
        """`T_base_gauge` by location as taught before; empty where there is no file yet.

        Raises:
            DescriptionError: it cannot be read.
        """
        if not self.path or not Path(self.path).exists():
            return {}
        return read_description(self.path, parse_placements)

    def write(self, taught: Mapping[int, RigidTransform], base_frame: str) -> str:
        """Keep what is taught, whole or not at all; says in words where.

        Raises:
            TeachError: it cannot be written. What was kept before is still there.
        """
        if not self.path:
            return 'not kept in a file (parameter taught)'
        try:
            Path(self.path).parent.mkdir(parents=True, exist_ok=True)
            if taught:
                write_whole(self.path, placements_yaml(taught, base_frame))
            else:
                Path(self.path).unlink(missing_ok=True)
        except OSError as error:
            raise TeachError(
                f'taught, but {self.path} cannot be written: {error.strerror}'
            ) from error
        return f'kept in {self.path}'


def probed_sphere(
    arm: Arm, probe: Probe, gauge: Gauge, number: int, joints: Array, displacement: Array
) -> TaughtSphere:
    """Sphere `number` as probed in posture `joints` (n,) at stylus readings (3,).

    Raises:
        DataError: the certificate has no such sphere, or the joints are not the arm's.
        ContactError: no sphere of the gauge's diameter gives these readings.
    """
    gauge.center(number)  # refuses an unknown number
    p_probe = probe.centers(np.reshape(displacement, (1, 3)), gauge.sphere_diameter)
    p_base = points(arm, np.reshape(joints, (1, -1)), probe.flange_T_probe.apply(p_probe))
    return TaughtSphere(number, frozen(p_base[0]))


def taught_location(
    gauge: Gauge,
    location: int,
    first: TaughtSphere,
    last: TaughtSphere,
    tolerance: float = TOLERANCE,
) -> TaughtLocation:
    """The place of the gauge at which both spheres are nearest to where they were measured.

    Two points leave the turn about the line through them open: it is chosen so that the gauge's
    z axis, from whose side spheres are probed, points up as far as can be; of an upright bar it
    points to the arm. What the measured length is off the certified one is shared by both ends.

    Raises:
        TeachError: one sphere twice, or lengths that differ by more than `tolerance` (m).
        DataError: the certificate lacks one of the spheres.
    """
    if first.number == last.number:
        raise TeachError(f'location {location}: sphere {first.number} was taught twice')
    c_first, c_last = gauge.center(first.number), gauge.center(last.number)
    certified = float(np.linalg.norm(c_last - c_first))
    measured = float(np.linalg.norm(last.p_base_sphere - first.p_base_sphere))
    if not abs(measured - certified) <= tolerance:
        raise TeachError(
            f'location {location}: spheres {first.number} and {last.number} were measured '
            f'{measured * 1e3:.3f} mm apart, the certificate of {gauge.name} says '
            f'{certified * 1e3:.3f} mm: more than {tolerance * 1e3:g} mm off, '
            'is it these spheres and this gauge?'
        )
    middle = (first.p_base_sphere + last.p_base_sphere) / 2
    along = (last.p_base_sphere - first.p_base_sphere) / measured
    laid = _turned_onto((c_last - c_first) / certified, along)
    rotation = rotation_matrix(_spin(laid[:, 2], along, middle) * along) @ laid
    moved = np.eye(4)
    moved[:3, :3] = rotation
    moved[:3, 3] = middle - rotation @ ((c_first + c_last) / 2)
    return TaughtLocation(location, RigidTransform.from_matrix(moved), measured, certified)


def _turned_onto(before: Array, after: Array) -> Array:
    """A rotation (3, 3) that takes the unit vector `before` onto the unit vector `after`."""
    # a half turn about `before`, then one about the middle of both
    between = before + after
    if np.linalg.norm(between) < 1e-3:
        between = np.cross(before, np.eye(3)[int(np.argmin(np.abs(before)))])
        between /= np.linalg.norm(between)
        return 2 * np.outer(between, between) - np.eye(3)
    between /= np.linalg.norm(between)
    half_turn_before = 2 * np.outer(before, before) - np.eye(3)
    half_turn_between = 2 * np.outer(between, between) - np.eye(3)
    rotation: Array = half_turn_between @ half_turn_before
    return rotation


def _spin(z_gauge: Array, along: Array, middle: Array) -> float:
    """The turn (rad) about the bar that brings the gauge's z axis up."""
    up = np.array([0.0, 0.0, 1.0])
    if np.linalg.norm(np.cross(up, along)) < UPRIGHT:
        up = -middle
    across = z_gauge - (z_gauge @ along) * along
    return float(np.arctan2(up @ np.cross(along, across), up @ across))
