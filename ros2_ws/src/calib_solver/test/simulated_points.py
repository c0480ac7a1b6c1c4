# SPDX-License-Identifier: Apache-2.0
"""Tracker tables of arms whose parameters, targets and stations are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from simulated_calibration import kr5

from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_model.kinematics import CorrectedArm, Correction
from calib_model.measured_points import PointMeasurement, PointSet
from calib_model.transforms import rotation_matrix, rotation_vector, rotation_vector_quaternion


@dataclass(frozen=True)
class Tracked:
    """What a tracker saw of an arm that is really `truth`: targets (K, 3) at `target`, turned by
    `target_rotation` (K, 3, 3), stations at `station` and `station_rotation` likewise."""

    measured: PointMeasurement
    truth: Arm
    target: Array
    target_rotation: Array
    station: Array
    station_rotation: Array


def bent(arm: Arm, generator: np.random.Generator, times: float = 1.0) -> Arm:
    """An arm as it may really be: lengths off by half a mm, angles by a mrad or two."""
    sigma = np.array([5e-4, 1e-3, 5e-4, 2e-3, 0.0])[:, None]
    return arm.with_geometry(
        arm.geometry + times * sigma * generator.normal(size=arm.geometry.shape)
    )


def tracked(
    seed: int,
    count: int = 300,
    targets: int = 1,
    stations: int = 1,
    oriented: bool = False,
    noise: float = 0.0,
    turn_noise: float = 0.0,
    arm: Arm | None = None,
    correction: Correction | None = None,
    world: int | None = None,
) -> Tracked:
    """Points with normal noise (m, rad); `world` seeds what is true where other noise is wanted."""
    arm = arm or kr5()
    world_generator = np.random.default_rng(seed if world is None else world)
    generator = np.random.default_rng([seed, 1])
    truth = bent(arm, world_generator)
    target = world_generator.uniform(-0.2, 0.2, (targets, 3))
    turn = np.array([rotation_matrix(v) for v in world_generator.normal(size=(targets, 3))])
    station = world_generator.uniform(-3, 3, (stations, 3))
    base = np.array([rotation_matrix(v) for v in 2 * world_generator.normal(size=(stations, 3))])
    limits = np.clip(arm.limits, -np.pi, np.pi)
    q = world_generator.uniform(limits[:, 0], limits[:, 1], (count, arm.n))
    of_target = np.arange(count) % targets
    of_station = np.arange(count) // targets % stations
    flange = CorrectedArm(truth, correction).forward(q)
    points = flange[:, :3, 3] + np.einsum('nij,nj->ni', flange[:, :3, :3], target[of_target])
    seen = np.einsum('nij,nj->ni', base[of_station], points) + station[of_station]
    quaternion = None
    if oriented:
        turned = base[of_station] @ flange[:, :3, :3] @ turn[of_target]
        shake = [rotation_matrix(v) for v in turn_noise * generator.normal(size=(count, 3))]
        vectors = [rotation_vector(a @ b) for a, b in zip(shake, turned, strict=True)]
        quaternion = np.array([rotation_vector_quaternion(v) for v in vectors])
    seen = seen + noise * generator.normal(size=seen.shape)
    points_set = PointSet.of(q, seen, quaternion, [str(k + 1) for k in of_target], of_station + 1)
    measured = PointMeasurement(arm, points_set, f'tracked {seed}')
    return Tracked(measured, truth, target, turn, station, base)
