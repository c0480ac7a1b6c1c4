# SPDX-License-Identifier: Apache-2.0
"""Flange poses around a sphere: from where, turned how and with which offset in the probe."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib_capture.program.candidates import Hand
from calib_capture.program.orientations import (
    cap_directions,
    even_sequence,
    looking_along,
    sphere_directions,
)
from calib_capture.program.program import ProgramError, ProgramSettings
from calib_model.arrays import Array
from calib_model.instruments import ActiveProbe, Gauge, Probe
from calib_model.transforms import RigidTransform

# one number each for: direction (2), spin, offset (2), its length, redundant joint
CHOICES = 7
TRIES_PER_POSE = 40
BLOCK = 4096  # hands that are drawn together


class FlangePoses:
    """Even over the cap around each sphere, its offsets within the probe's range.

    `redundant` is the range (rad) of the joint that is swept where the arm has one to spare.

    Raises:
        ProgramError: the offsets asked for are beyond the styli's stroke.
    """

    def __init__(
        self,
        probe: Probe,
        gauge: Gauge,
        settings: ProgramSettings,
        redundant: tuple[float, float],
    ) -> None:
        self._probe = probe
        self._gauge = gauge
        self._settings = settings
        self._redundant = redundant
        self._T_probe_flange = np.linalg.inv(probe.flange_T_probe.matrix())
        self.seat = self._seat_of(probe)

    def _seat_of(self, probe: Probe) -> Array:
        """Where in the probe (3,) a sphere sits when the styli are halfway in."""
        if not isinstance(probe, ActiveProbe):
            return probe.center
        diameter = self._gauge.sphere_diameter
        middle = probe.stroke.mean(axis=1)
        seat: Array = probe.centers(middle[None], diameter)[0]
        even = even_sequence(200, 2, np.zeros(2))
        around = seat + self._settings.offset[1] * sphere_directions(even[:, 0], even[:, 1])
        if not probe.within_stroke(probe.displacements(around, diameter)).all():
            length = self._settings.offset[1] * 1e3
            raise ProgramError(f'{probe.name}: an offset of {length:g} mm is beyond its stroke')
        return seat

    def around(
        self,
        T_base_gauge: RigidTransform,
        sphere: int,
        key: tuple[int, ...],
        offset_share: float = 1.0,
    ) -> Iterator[Hand]:
        """Flange poses around a sphere of the gauge where it stands; another `key`, other ones.

        Raises:
            DataError: the gauge has no such sphere.
        """
        p_base_sphere = T_base_gauge.apply(self._gauge.center(sphere))
        lower, upper = self._redundant
        for even in self._even(key):
            cap = cap_directions(even[:, 0], even[:, 1], self._settings.cap)
            outward = cap @ T_base_gauge.rotation.T
            offsets = offset_share * self._offsets(even)
            for row, direction, offset in zip(even, outward, offsets, strict=True):
                T_base_probe = np.eye(4)
                T_base_probe[:3, :3] = looking_along(-direction, 2 * np.pi * row[2])
                p_probe_sphere = self.seat + offset
                T_base_probe[:3, 3] = p_base_sphere - T_base_probe[:3, :3] @ p_probe_sphere
                swept = float(lower + row[6] * (upper - lower))
                yield Hand(T_base_probe @ self._T_probe_flange, p_probe_sphere, swept)

    def _even(self, key: tuple[int, ...]) -> Iterator[Array]:
        settings = self._settings
        count = TRIES_PER_POSE * settings.pool * settings.poses_per_sphere
        start = np.random.default_rng(key).random(CHOICES)
        for begin in range(0, count, BLOCK):
            yield even_sequence(min(BLOCK, count - begin), CHOICES, start, begin)

    def _offsets(self, even: Array) -> Array:
        """Where the sphere is held off the seat (N, 3), m; nowhere in a passive probe."""
        if not isinstance(self._probe, ActiveProbe):
            return np.zeros((len(even), 3))
        shortest, longest = self._settings.offset
        length = shortest + (longest - shortest) * even[:, 5]
        offsets: Array = length[:, None] * sphere_directions(even[:, 3], even[:, 4])
        return offsets
