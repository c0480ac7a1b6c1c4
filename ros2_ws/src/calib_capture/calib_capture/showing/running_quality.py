# SPDX-License-Identifier: Apache-2.0
"""How good the poses of a run are so far: each sphere's 2 sigma, nominal and as if identified.

The identification knows no joint errors and leaves nothing out: enough to see an arm come right
while it is measured, and no calibration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm, Gauge, Probe, known_centers
from calib_model.kinematics import DEFAULT_SIGMA, ParameterTable, probing_jacobian

NOISE = 1e-5  # m: what nothing explains of a sphere's place in one pose
FEWEST = 2  # poses of a sphere that have a scatter
TIMES = 2  # as many coordinates as parameters, before an identification says anything
STEPS = 2  # of Gauss-Newton from the nominal arm
MOST = 600  # poses that are looked at, evenly taken from all
Key = tuple[int, int]  # location, sphere
UNKNOWN = frozen(np.full(3, np.nan))


@dataclass(frozen=True)
class SphereScatter:
    """2 sigma (3,), m, of a sphere's place by its poses, in the base frame; NaN where there are too
    few."""

    nominal: Array = field(default_factory=lambda: UNKNOWN)
    identified: Array = field(default_factory=lambda: UNKNOWN)


class RunningQuality:
    """Takes poses one by one, and tells of all of them when asked."""

    def __init__(self, arm: Arm, probe: Probe, gauge: Gauge) -> None:
        self._arm, self._probe, self._diameter = arm, probe, gauge.sphere_diameter
        self._table = ParameterTable.of(arm, probe)
        self._sigma = np.array([DEFAULT_SIGMA[one.kind] for one in self._table.parameters])
        self._keys: list[Key] = []
        self._joints: list[Array] = []
        self._displacement: list[Array] = []

    def add(self, key: Key, joints: Array, displacement: Array) -> None:
        """A pose of the sphere of that location and number: joints (n,) and styli (3,), m."""
        self._keys.append(key)
        self._joints.append(joints)
        self._displacement.append(displacement)

    def spheres(self) -> Mapping[Key, SphereScatter]:
        """Every sphere that has a pose, by location and number."""
        if not self._keys:
            return {}
        every = -(-len(self._keys) // MOST)
        known = sorted(set(self._keys))
        group = np.array([known.index(key) for key in self._keys[::every]])
        joints, read = np.array(self._joints[::every]), np.array(self._displacement[::every])
        seats = known_centers(self._probe, read, self._diameter)
        good = np.isfinite(seats).all(axis=1)
        group, joints, seats = group[good], joints[good], seats[good]
        nominal, jacobian = probing_jacobian(self._arm, self._probe, joints, seats)
        identified = self._identified(nominal, jacobian, joints, seats, group)
        return {
            key: SphereScatter(_two_sigma(nominal[group == k]), _two_sigma(identified[group == k]))
            for k, key in enumerate(known)
        }

    def _identified(
        self, p_base: Array, jacobian: Array, joints: Array, seats: Array, group: NDArray[np.int64]
    ) -> Array:
        """The places (N, 3) by the arm that explains them best, as far from each sphere's mean as
        if it had not been fitted to them; NaN where there are too few."""
        counts = np.bincount(group)
        rows = 3 * int(np.maximum(counts - 1, 0).sum())
        x = np.zeros(len(self._sigma))
        if rows < TIMES * len(x):
            return np.full_like(p_base, np.nan)
        for step in range(STEPS):
            if step:
                arm, probe = self._table.apply(
                    self._table.nominal + self._sigma * x, self._arm, self._probe
                )
                p_base, jacobian = probing_jacobian(arm, probe, joints, seats)
            columns = _centred(jacobian * self._sigma, group)
            a, b = columns.reshape(-1, len(x)) / NOISE, _centred(p_base, group) / NOISE
            told = a.T @ a
            change = -np.linalg.solve(told + np.eye(len(x)), a.T @ b.reshape(-1) + x)
            x = x + change
        fitted = np.trace(np.linalg.solve(told + np.eye(len(x)), told))  # parameters
        residuals: Array = NOISE * b + columns @ change
        return residuals * np.sqrt(rows / (rows - fitted))


def _centred(values: Array, group: NDArray[np.int64]) -> Array:
    """Values (N, ...) off their mean over each group."""
    flat = values.reshape(len(values), -1)
    sums = np.zeros((int(group.max()) + 1, flat.shape[1]))
    np.add.at(sums, group, flat)
    means = sums / np.maximum(np.bincount(group), 1)[:, None]
    return (flat - means[group]).reshape(values.shape)


def _two_sigma(places: Array) -> Array:
    """Of places (N, 3), m."""
    if len(places) < FEWEST:
        return UNKNOWN
    return frozen(2 * np.std(places, axis=0, ddof=1))
