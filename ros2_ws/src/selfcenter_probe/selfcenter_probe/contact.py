# SPDX-License-Identifier: Apache-2.0
"""A gauge sphere against the probe: how far it pushes in each stylus, and where it does not."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from calib_model.probe import STYLI, ActiveProbe, PassiveProbe
from calib_model.rotation import Array


class Status(IntEnum):
    """The constants of calib_interfaces/msg/StylusDisplacements."""

    OK = 0
    NO_CONTACT = 1
    OVER_TRAVEL = 2
    WEAK_SIGNAL = 3


@dataclass(frozen=True)
class Contact:
    """Where the styli really are: displacements (N, 3), m, and `Status` (N, 3)."""

    displacement: Array
    status: NDArray[np.uint8]

    def repeated(self, times: int) -> Contact:
        """Each of the N contacts `times` times in a row."""
        return Contact(
            np.repeat(self.displacement, times, axis=0), np.repeat(self.status, times, axis=0)
        )


def touch(probe: ActiveProbe, p_probe_sphere: Array, sphere_diameter: float) -> Contact:
    """The styli of an active probe against spheres centred at `p_probe_sphere` (N, 3), m.

    A stylus without a sphere before it stands at the free end of its stroke, one pushed in too
    far at the blocked end: the end switches there tell which.
    """
    lower, upper = probe.stroke.T
    wanted = probe.displacements(p_probe_sphere, sphere_diameter)
    free = np.isnan(wanted) | _out_of_reach(probe, p_probe_sphere, sphere_diameter)
    wanted = np.where(free, -np.inf, wanted)
    past = _past_the_tips(probe, p_probe_sphere, np.clip(wanted, lower, upper))
    wanted = np.where(past[:, None] & ~free, np.inf, wanted)
    status = np.full(wanted.shape, Status.OK, dtype=np.uint8)
    status[wanted <= lower] = Status.NO_CONTACT
    status[wanted >= upper] = Status.OVER_TRAVEL
    return Contact(np.clip(wanted, lower, upper), status)


def _out_of_reach(
    probe: ActiveProbe, p_probe_sphere: Array, sphere_diameter: float
) -> NDArray[np.bool_]:
    """Spheres that a stylus cannot touch anywhere near its stroke, (N, 3).

    The line of a stylus goes on behind the housing, and a sphere there pushes nothing in.
    """
    origin, _ = _lines(probe)
    radius = sphere_diameter / 2 + np.array([stylus.tip_radius for stylus in probe.styli])
    distance = np.linalg.norm(p_probe_sphere[:, None, :] - origin, axis=2)
    # at an end of the stroke the tip's centre is that far from its origin: twice is well beyond
    far: NDArray[np.bool_] = distance > radius + 2 * np.abs(probe.stroke).max(axis=1)
    return far


def _past_the_tips(
    probe: ActiveProbe, p_probe_sphere: Array, displacement: Array
) -> NDArray[np.bool_]:
    """Spheres (N,) on the housing's side of the three tips.

    They would read like their mirror images outside; a real one has run into the housing.
    """
    origin, direction = _lines(probe)
    tips = origin + displacement[:, :, None] * direction
    normal = np.cross(tips[:, 1] - tips[:, 0], tips[:, 2] - tips[:, 0])
    height = np.einsum('nk,nk->n', p_probe_sphere - tips[:, 0], normal)
    past: NDArray[np.bool_] = height * np.sign(normal @ direction.sum(axis=0)) > 0
    return past


def _lines(probe: ActiveProbe) -> tuple[Array, Array]:
    """Origins (3, 3) and unit directions (3, 3) of the styli."""
    direction = np.array([stylus.direction for stylus in probe.styli])
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    return np.array([stylus.origin for stylus in probe.styli]), direction / length


def seat(probe: PassiveProbe, p_probe_sphere: Array, reach: float) -> Contact:
    """A kinematic seat: OK where the sphere is within `reach` (m) of it; it has nothing to read."""
    seated = np.linalg.norm(p_probe_sphere - probe.center, axis=1) <= reach
    status = np.where(seated, Status.OK, Status.NO_CONTACT).astype(np.uint8)
    return Contact(np.zeros((len(seated), STYLI)), np.repeat(status[:, None], STYLI, axis=1))
