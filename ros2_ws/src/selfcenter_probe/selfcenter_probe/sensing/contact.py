# SPDX-License-Identifier: Apache-2.0
"""A gauge sphere against the probe: how far it pushes in each stylus, and where it does not."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.instruments import STYLI, ActiveProbe, PassiveProbe
from calib_model.transforms import cross


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
    offset = p_probe_sphere[:, None, :] - probe.origin
    reach = sphere_diameter / 2 + probe.tip_radius
    # The line of a stylus goes on behind the housing, and a sphere there pushes nothing in. At an
    # end of the stroke the tip's centre is that far from its origin: twice is well beyond.
    reach = reach + 2 * np.abs(probe.stroke).max(axis=1)
    free = np.isnan(wanted) | (np.einsum('nsk,nsk->ns', offset, offset) > reach**2)
    wanted = np.where(free, -np.inf, wanted)
    past = _past_the_tips(probe, offset, np.clip(wanted, lower, upper))
    wanted = np.where(past[:, None] & ~free, np.inf, wanted)
    status = np.full(wanted.shape, Status.OK, dtype=np.uint8)
    status[wanted <= lower] = Status.NO_CONTACT
    status[wanted >= upper] = Status.OVER_TRAVEL
    return Contact(np.clip(wanted, lower, upper), status)


def _past_the_tips(probe: ActiveProbe, offset: Array, displacement: Array) -> NDArray[np.bool_]:
    """Spheres (N,) on the housing's side of the three tips; `offset` (N, 3 styli, 3) from origins.

    They would read like their mirror images outside; a real one has run into the housing.
    """
    to_sphere = offset - displacement[:, :, None] * probe.direction  # from each tip's centre
    normal = cross(to_sphere[:, 0] - to_sphere[:, 1], to_sphere[:, 0] - to_sphere[:, 2])
    height = np.einsum('nk,nk->n', to_sphere[:, 0], normal)
    past: NDArray[np.bool_] = height * np.sign(normal @ probe.direction.sum(axis=0)) > 0
    return past


def seat(probe: PassiveProbe, p_probe_sphere: Array, reach: float) -> Contact:
    """A kinematic seat: OK where the sphere is within `reach` (m) of it; it has nothing to read."""
    seated = np.linalg.norm(p_probe_sphere - probe.center, axis=1) <= reach
    status = np.where(seated, Status.OK, Status.NO_CONTACT).astype(np.uint8)
    return Contact(np.zeros((len(seated), STYLI)), np.repeat(status[:, None], STYLI, axis=1))
