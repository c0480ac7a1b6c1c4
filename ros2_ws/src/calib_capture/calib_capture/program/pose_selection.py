# SPDX-License-Identifier: Apache-2.0
"""Poses chosen by what they tell of the parameters.

A pose tells p_base_sphere(theta) = c + noise of a centre c that is unknown, three numbers of which
F parameters theta and the centre are to be had; the certificate tells the distances between the
centres of a location. With the centres' part eliminated, the information of all poses about theta
is that of the centred repeatability terms and of the distances of eq. 11, each at its own weight.
Because every sphere's number of poses is given, log det of that differs from log det of the
information about theta and centres together by a constant only, and in the latter a pose is three
rows more or less: exchanging poses is cheap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.kinematics import DEFAULT_SIGMA, identifiable_table, probing_jacobian

Indices = NDArray[np.int64]
POSTURES = 500


@dataclass(frozen=True)
class SelectionSettings:
    """`noise`: standard deviation (m) of a pose per coordinate, arm and probe together. `sigma`:
    what is known of the parameters beforehand, by kind. Exchanges go on until a round over all
    spheres gains less than `plateau` in log det, at most `rounds` times."""

    noise: float = 2e-5
    sigma: Mapping[str, float] | None = None
    plateau: float = 0.02
    rounds: int = 20


@dataclass(frozen=True)
class Choice:
    """For every sphere the chosen rows of its candidates, and log det before and after."""

    chosen: tuple[Indices, ...]
    before: float
    after: float
    rounds: int


class Information:
    """What poses of one arm with one probe before one gauge tell of its parameters.

    Parameters are counted in standard deviations of what is known beforehand, so the information
    without any pose is the identity.
    """

    def __init__(
        self,
        arm: Arm,
        probe: Probe,
        gauge: Gauge,
        settings: SelectionSettings = SelectionSettings(),
    ) -> None:
        self._arm = arm
        self._probe = probe
        self._gauge = gauge
        self.settings = settings
        self.table = identifiable_table(arm, probe)
        sigma = settings.sigma or DEFAULT_SIGMA
        self._sigma = np.array([sigma[parameter.kind] for parameter in self.table.free])

    def rows(self, joints: Array, p_probe_sphere: Array) -> Array:
        """J (N, 3, F + 3) of postures (N, n): by the F parameters, in m, and by the centre."""
        _, jacobian = probing_jacobian(self._arm, self._probe, joints, p_probe_sphere)
        own = jacobian[:, :, self.table.free_columns] * self._sigma
        center = np.broadcast_to(-np.eye(3), (len(own), 3, 3))
        rows: Array = np.concatenate([own, center], axis=2) / self.settings.noise
        return rows

    def of_location(self, spheres: Sequence[int], centers: Array, rows: Sequence[Array]) -> Array:
        """Information (F + 3k, F + 3k) of k spheres of one location at `centers` (k, 3), m."""
        free = len(self._sigma)
        information = np.zeros((free + 3 * len(spheres),) * 2)
        for place, own in enumerate(rows):
            at = self.place_of(place)
            flat = own.reshape(-1, free + 3)
            information[np.ix_(at, at)] += flat.T @ flat
        for i, j in combinations(range(len(spheres)), 2):
            length = self._gauge.distance(spheres[i], spheres[j])
            # no distance is better known than to a tenth of a micrometre
            sure = max(self._gauge.distance_uncertainty(length) / 2, 1e-7)
            along = np.zeros(len(information))
            unit = (centers[i] - centers[j]) / np.linalg.norm(centers[i] - centers[j])
            along[free + 3 * i : free + 3 * i + 3] = unit / sure
            along[free + 3 * j : free + 3 * j + 3] = -unit / sure
            information += np.outer(along, along)
        return information

    def place_of(self, sphere: int) -> Indices:
        """Rows of a location's information that one sphere's poses touch, shape (F + 3,)."""
        free = len(self._sigma)
        return np.concatenate([np.arange(free), free + 3 * sphere + np.arange(3)])

    def about_parameters(self, location: Array) -> Array:
        """The same (F, F) about the parameters alone, the centres eliminated."""
        free = len(self._sigma)
        across, centers = location[:free, free:], location[free:, free:]
        left: Array = location[:free, :free] - across @ np.linalg.pinv(centers) @ across.T
        return left

    @property
    def known(self) -> Array:
        """The information (F, F) without any pose."""
        return np.eye(len(self._sigma))

    def position_uncertainties(self, information: Array, seed: int = 0) -> Array:
        """Standard uncertainty (m) of a probed position in the arm's base frame at postures
        anywhere between the joint limits (POSTURES,), from the information (F, F)."""
        limits = self._arm.ranges
        generator = np.random.default_rng(seed)
        joints = generator.uniform(limits[:, 0], limits[:, 1], (POSTURES, self._arm.n))
        own = self.rows(joints, np.zeros((POSTURES, 3)))[:, :, : len(self._sigma)]
        own = own * self.settings.noise
        covariance = np.linalg.inv(information)
        found: Array = np.sqrt(np.einsum('nkf,fg,nkg->n', own, covariance, own))
        return found

    def position_uncertainty(self, information: Array) -> float:
        """The root mean square of these."""
        return float(np.sqrt(np.mean(self.position_uncertainties(information) ** 2)))


@dataclass(frozen=True)
class Pool:
    """The candidates of one sphere: `rows` (K, 3, F + 3), its location and centre (3,), m."""

    location: int
    sphere: int
    center: Array
    rows: Array


def information_matrix(
    information: Information, pools: Sequence[Pool], chosen: Sequence[Indices]
) -> Array:
    """The information (F, F) about the parameters of the chosen poses, what was known included."""
    total = information.known
    for members in _by_location(pools):
        total = total + information.about_parameters(_location(information, pools, chosen, members))
    return total


def log_det(information: Array) -> float:
    """The criterion: log of the determinant."""
    return float(np.linalg.slogdet(information)[1])


def choose(information: Information, pools: Sequence[Pool], wanted: int) -> Choice:
    """`wanted` poses of every sphere, all where it has no more.

    Starts with the first ones of every pool; never ends with less log det than these have.
    """
    chosen: list[Indices] = [np.arange(min(wanted, len(pool.rows))) for pool in pools]
    groups = _by_location(pools)
    before = log_det(information_matrix(information, pools, chosen))
    reached, rounds = before, 0
    while rounds < information.settings.rounds:
        rounds += 1
        for members in groups:
            _improve(information, pools, chosen, members)
        last, reached = reached, log_det(information_matrix(information, pools, chosen))
        if reached - last < information.settings.plateau:
            break
    return Choice(tuple(chosen), before, reached, rounds)


def _by_location(pools: Sequence[Pool]) -> list[list[int]]:
    locations = sorted({pool.location for pool in pools})
    return [[i for i, pool in enumerate(pools) if pool.location == at] for at in locations]


def _location(
    information: Information,
    pools: Sequence[Pool],
    chosen: Sequence[Indices],
    members: Sequence[int],
) -> Array:
    return information.of_location(
        [pools[i].sphere for i in members],
        np.array([pools[i].center for i in members]),
        [pools[i].rows[chosen[i]] for i in members],
    )


def _improve(
    information: Information, pools: Sequence[Pool], chosen: list[Indices], members: Sequence[int]
) -> None:
    """Exchange poses of one location's spheres, the other locations as they are."""
    others = [i for i in range(len(pools)) if i not in members]
    members = [i for i in members if len(chosen[i])]  # of others nothing tells where they are
    outside = information_matrix(
        information, [pools[i] for i in others], [chosen[i] for i in others]
    )
    free = len(outside)
    for place, member in enumerate(members):
        if len(pools[member].rows) <= len(chosen[member]):
            continue
        whole = _location(information, pools, chosen, members)
        whole[:free, :free] += outside
        at = information.place_of(place)
        covariance = np.asarray(np.linalg.inv(whole)[np.ix_(at, at)], dtype=np.float64)
        chosen[member] = exchanged(covariance, pools[member].rows, chosen[member])


def exchanged(covariance: Array, rows: Array, chosen: Indices) -> Indices:
    """Drop the pose that tells least, take the one that tells most, until that is the same one.

    `covariance` (D, D) is that of parameters and places with the `chosen` of `rows` (K, R, D), R
    numbers a pose.
    """
    inside = np.zeros(len(rows), dtype=bool)
    inside[chosen] = True
    for _ in range(len(chosen)):
        drop = _extreme(covariance, rows, np.flatnonzero(inside), -1.0)
        covariance = _updated(covariance, rows[drop], -1.0)
        inside[drop] = False
        take = _extreme(covariance, rows, np.flatnonzero(~inside), 1.0)
        covariance = _updated(covariance, rows[take], 1.0)
        inside[take] = True
        if take == drop:
            break
    return np.flatnonzero(inside)


def _extreme(covariance: Array, rows: Array, among: Indices, sign: float) -> int:
    """The row with the largest det(I + sign B W B'): the least lost, or the most gained."""
    own = rows[among]
    inner = np.eye(own.shape[1]) + sign * (own @ covariance @ np.swapaxes(own, 1, 2))
    return int(among[int(np.argmax(np.linalg.det(inner)))])


def _updated(covariance: Array, own: Array, sign: float) -> Array:
    """The covariance with the rows `own` (R, D) of a pose more (1) or less (-1)."""
    across = covariance @ own.T
    inner = np.eye(len(own)) + sign * own @ across
    changed: Array = covariance - sign * across @ np.linalg.solve(inner, across.T)
    return (changed + changed.T) / 2
