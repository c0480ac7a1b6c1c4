# SPDX-License-Identifier: Apache-2.0
"""Which sphere of which location the probe is on, from where the nominal arm sees it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.instruments import Arm, Gauge, Probe, known_centers
from calib_model.kinematics import points
from calib_model.transforms import RigidTransform

NEAR = 0.010  # m: how far off a sphere's nominal centre an arm not yet calibrated may see it
NOWHERE, UNTOUCHED = -1, -2  # instead of a sphere's row


class SphereFinder:
    """Knows the spheres of a gauge at its nominal places, `T_base_gauge` by location.

    `labels` are location and number of each; `numbers` empty takes in all of the certificate.
    """

    def __init__(
        self,
        arm: Arm,
        probe: Probe,
        gauge: Gauge,
        placements: Mapping[int, RigidTransform],
        numbers: Sequence[int] = (),
    ) -> None:
        self._arm, self._probe, self._gauge = arm, probe, gauge
        chosen = tuple(numbers) or gauge.numbers
        self.labels = [(location, number) for location in placements for number in chosen]
        self._centers = np.array(
            [placements[location].apply(gauge.center(number)) for location, number in self.labels]
        ).reshape(-1, 3)

    def rows(self, joints: Array, displacement: Array) -> NDArray[np.int64]:
        """Rows (N,) in `labels` of what was probed in postures (N, n) at readings (N, 3).

        `NOWHERE` where no sphere, or more than one, is near; `UNTOUCHED` where no sphere of the
        gauge's diameter gives the reading.
        """
        p_probe = known_centers(self._probe, displacement, self._gauge.sphere_diameter)
        touched = np.isfinite(p_probe).all(axis=1)
        rows = np.where(touched, NOWHERE, UNTOUCHED).astype(np.int64)
        if not touched.any() or not self.labels:
            return rows
        p_flange = self._probe.flange_T_probe.apply(p_probe[touched])
        p_base = points(self._arm, joints[touched], p_flange)
        near = np.linalg.norm(p_base[:, None] - self._centers[None], axis=2) <= NEAR
        found = np.where(near.sum(axis=1) == 1, near.argmax(axis=1), NOWHERE)
        rows[touched] = found
        return rows
