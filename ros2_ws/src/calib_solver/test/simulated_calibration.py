# SPDX-License-Identifier: Apache-2.0
"""Probing poses of an arm whose true parameters are known, for tests to identify again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import (
    PRISMATIC,
    Arm,
    Coupling,
    Gauge,
    Joint,
    PassiveProbe,
    Probe,
    trihedron,
)
from calib_model.kinematics import point_derivatives, points
from calib_model.measurement import Measurement, ProbingSet
from calib_model.transforms import RigidTransform, nearest_rotation, rotation_matrix

QUARTER = np.pi / 2
SPHERES = (1, 6, 10, 14)
GAUGE = Gauge(
    'bar',
    0.022,
    tuple((k, (0.04 * (k - 1), 1e-5 * (k % 3), -8e-6 * (k % 4))) for k in range(1, 16)),
    1e-6,
    1e-6,
)
MOUNT = RigidTransform(np.array([0.004, -0.003, 0.1]))


def arm_of(name: str, rows: list[tuple[float, ...]]) -> Arm:
    """An arm from rows a, alpha, d, theta_0 and, where wanted, beta and direction."""
    joints = tuple(Joint(f'joint_a{i}', *row) for i, row in enumerate(rows, start=1))
    return Arm(name, joints)


def kr5(tilt: float = 0.0) -> Arm:
    """A KR 5 sixx R650; `tilt` (rad) between its nominally parallel axes 2 and 3."""
    rows = [
        (0.075, -QUARTER, 0.335, 0.0),
        (0.27, tilt, 0.0, QUARTER),
        (0.09, QUARTER, 0.0, 0.0),
        (0.0, -QUARTER, -0.295, 0.0),
        (0.0, QUARTER, 0.0, 0.0),
        (0.0, np.pi, -0.08, 0.0),
    ]
    return arm_of('kr5', rows)


def turned_kr5() -> Arm:
    """The same with joints 1, 2 and 5 counting the other way round."""
    arm = kr5()
    directions = (-1, -1, 1, 1, -1, 1)
    joints = [replace(j, direction=d) for j, d in zip(arm.joints, directions, strict=True)]
    return replace(arm, joints=tuple(joints))


def iiwa() -> Arm:
    """Seven joints, an LBR iiwa 14."""
    alpha = (-QUARTER, QUARTER, QUARTER, -QUARTER, -QUARTER, QUARTER, 0.0)
    d = (0.36, 0.0, 0.42, 0.0, 0.4, 0.0, 0.126)
    return arm_of('iiwa', [(0.0, alpha[i], d[i], 0.0) for i in range(7)])


def scara_like() -> Arm:
    """Axes 1 and 2 parallel, as a SCARA has them, with a wrist behind them."""
    rows = [
        (0.35, 0.0, 0.3, 0.0),
        (0.30, QUARTER, 0.05, 0.0),
        (0.06, -QUARTER, 0.1, 0.0),
        (0.0, QUARTER, 0.12, 0.0),
        (0.02, -QUARTER, 0.0, 0.0),
        (0.0, 0.0, 0.08, 0.0),
    ]
    return arm_of('scara_like', rows)


def ur_like() -> Arm:
    """Axes 2, 3 and 4 parallel, as the UR arms have them."""
    rows = [
        (0.0, QUARTER, 0.089, 0.0),
        (-0.425, 0.0, 0.0, 0.0),
        (-0.392, 0.0, 0.0, 0.0),
        (0.0, QUARTER, 0.109, 0.0),
        (0.0, -QUARTER, 0.095, 0.0),
        (0.0, 0.0, 0.082, 0.0),
    ]
    return arm_of('ur_like', rows)


def random_arm(generator: np.random.Generator) -> Arm:
    """Six axes anyhow, none of them nearly parallel to the next."""
    rows = [
        (
            generator.uniform(-0.3, 0.3),
            generator.choice([-1, 1]) * generator.uniform(0.5, 2.6),
            generator.uniform(-0.3, 0.3),
            generator.uniform(-3, 3),
            0.0,
            int(generator.choice([-1, 1])),
        )
        for _ in range(6)
    ]
    return arm_of('anyhow', rows)


def on_a_rail() -> Arm:
    """A KR 5 on a linear axis along the base's x, its third axis counted from the horizontal."""
    arm = kr5()
    rail = Joint('rail', 0.1, -QUARTER, 0.0, 0.0, type=PRISMATIC)
    joints = [rail, *arm.joints]
    # the rail's z lies along x, and the way from it to axis 1 goes up
    joints[1] = replace(joints[1], theta_0=0.3)
    joints[3] = replace(joints[3], coupling=Coupling('joint_a2', 1.0))
    base = RigidTransform(np.array([0.1, -0.2, 0.05]), np.array([0.0, QUARTER, 0.0]))
    return replace(arm, name='on_a_rail', joints=tuple(joints), base_T_dh=base)


def with_rail(arm: Arm, joint: int) -> Arm:
    """The arm with a joint, from 0, that slides."""
    joints = list(arm.joints)
    joints[joint] = replace(joints[joint], type=PRISMATIC)
    return replace(arm, joints=tuple(joints))


def stanford() -> Arm:
    """Two axes that turn, one that slides, and a wrist, as the Stanford arm has them."""
    rows = [
        (0.0, -QUARTER, 0.4, 0.0),
        (0.0, QUARTER, 0.15, 0.0),
        (0.0, 0.0, 0.3, 0.0),
        (0.0, -QUARTER, 0.0, 0.0),
        (0.0, QUARTER, 0.0, 0.0),
        (0.0, 0.0, 0.2, 0.0),
    ]
    return with_rail(arm_of('stanford', rows), 2)


def passive() -> PassiveProbe:
    """A seat whose sphere stands off the probe's origin."""
    return PassiveProbe('seat', MOUNT, np.array([0.001, 0.002, 0.01]))


def active() -> Probe:
    """The trihedron."""
    return trihedron(MOUNT)


@dataclass(frozen=True)
class Scene:
    """The true arm and the probe's true place on its flange, and what was measured with them."""

    true: Arm
    mount: RigidTransform
    measured: Measurement

    def true_centre(self, location: int, sphere: int) -> Array:
        """Where a probed sphere stands (3,), m, but for the noise of its poses."""
        poses = self.measured.poses
        own = (poses.location == location) & (poses.sphere == sphere)
        p_flange = self.mount.apply(self.measured.centers()[own])
        center: Array = points(self.true, poses.joints[own], p_flange).mean(axis=0)
        return center

    def prediction_error(self, arm: Arm, probe: Probe, seed: int = 99, count: int = 300) -> float:
        """The largest error (m) of unseen postures relative to one another.

        What a rigid motion of all points together takes away is the base's, and not counted.
        """
        generator = np.random.default_rng(seed)
        q = generator.uniform(-2.5, 2.5, (count, self.true.n))
        if isinstance(probe, PassiveProbe):
            centers = np.tile(probe.center, (count, 1))
        else:
            centers = generator.uniform(-1e-3, 1e-3, (count, 3))
        true = points(self.true, q, self.mount.apply(centers))
        said = points(arm, q, probe.flange_T_probe.apply(centers))
        return float(np.linalg.norm(aligned(said, true) - true, axis=1).max())


def aligned(moving: Array, fixed: Array) -> Array:
    """Points (N, 3) moved rigidly as near to `fixed` (N, 3) as they come."""
    moving_mean, fixed_mean = moving.mean(axis=0), fixed.mean(axis=0)
    rotation = nearest_rotation((fixed - fixed_mean).T @ (moving - moving_mean))
    return (moving - moving_mean) @ rotation.T + fixed_mean


def perturbed(
    arm: Arm, generator: np.random.Generator, length: float = 5e-4, angle: float = 1e-3
) -> Arm:
    """The arm with normal errors (m, rad); beta where the next axis is nearly parallel."""
    sigma = np.array([length, angle, length, angle, 0.0])[:, None] * np.ones(arm.n)
    parallel = np.abs(np.sin(arm.geometry[1])) < 0.05
    sigma[4, :-1] = np.where(parallel[:-1], angle, 0.0)
    return arm.with_geometry(arm.geometry + sigma * generator.normal(size=sigma.shape))


def simulate(
    arm: Arm,
    probe: Probe,
    seed: int,
    locations: int = 5,
    spheres: tuple[int, ...] = SPHERES,
    poses: int = 20,
    noise: float = 0.0,
    errors: float = 1.0,
) -> Scene:
    """Poses of a perturbed arm on spheres of the bar at random places within its reach.

    `noise` (rad) is added to the joint readings; `errors` scales the arm's and the mount's.
    """
    generator = np.random.default_rng(seed)
    true = perturbed(arm, generator, 5e-4 * errors, 1e-3 * errors)
    mount = RigidTransform(
        probe.flange_T_probe.translation + 1e-3 * errors * generator.normal(size=3),
        probe.flange_T_probe.rotation_vector
        + (0.0 if isinstance(probe, PassiveProbe) else 5e-3 * errors) * generator.normal(size=3),
    )
    joints, centers, keys = [], [], []
    for location in range(1, locations + 1):
        for sphere, (q, center) in zip(
            spheres, _location(true, probe, mount, spheres, poses, generator), strict=True
        ):
            joints.append(q)
            centers.append(center)
            keys += [(location, sphere)] * poses
    location, sphere = np.array(keys).T
    p_probe = np.concatenate(centers)
    q = np.concatenate(joints)
    q = q + noise * generator.normal(size=q.shape)
    displacement = (
        np.zeros_like(p_probe)
        if isinstance(probe, PassiveProbe)
        else probe.displacements(p_probe, GAUGE.sphere_diameter)
    )
    poses_taken = ProbingSet.of(location, sphere, q, displacement)
    return Scene(true, mount, Measurement(arm, probe, GAUGE, poses_taken, 'simulated'))


Postures = tuple[Array, Array]


def _location(
    true: Arm,
    probe: Probe,
    mount: RigidTransform,
    spheres: tuple[int, ...],
    count: int,
    generator: np.random.Generator,
) -> list[Postures]:
    """The postures of each sphere with the bar somewhere the arm reaches all of them."""
    reached = points(true, generator.uniform(-2.5, 2.5, (300, true.n)), mount.translation)
    near = reached[np.argsort(np.linalg.norm(reached - reached.mean(axis=0), axis=1))[:100]]
    for _ in range(40):
        middle = near[generator.integers(len(near))]
        turn = rotation_matrix(generator.normal(size=3) * 2)
        found: list[Postures] = []
        for sphere in spheres:
            target = middle + turn @ (GAUGE.center(sphere) - GAUGE.center(8))
            postures = _postures(true, probe, mount, target, count, generator)
            if postures is None:
                break
            found.append(postures)
        else:
            return found
    raise AssertionError(f'{true.name} reaches no place for the bar')


def _postures(
    true: Arm,
    probe: Probe,
    mount: RigidTransform,
    target: Array,
    count: int,
    generator: np.random.Generator,
) -> Postures | None:
    """`count` postures (N, n) with the sphere at `target`, and where it sits in the probe (N, 3).

    Damped Newton from random starts; None where too few of them arrive.
    """
    found: list[Postures] = []
    missing = count
    for _ in range(2):
        q = generator.uniform(-2.5, 2.5, (2 * missing + 4, true.n))
        center = generator.uniform(-1.2e-3, 1.2e-3, (len(q), 3))
        if isinstance(probe, PassiveProbe):
            center = np.tile(probe.center, (len(q), 1))
        for _ in range(60):
            now = point_derivatives(true, q, mount.apply(center))
            miss = target - now.p_base
            size = np.linalg.norm(miss, axis=1)
            if np.sort(size)[missing - 1] < 1e-15:
                break
            damping = np.where(size > 1e-3, 1e-3, 1e-12)[:, None, None] * np.eye(3)
            transposed = np.swapaxes(now.joints, 1, 2)
            step = transposed @ np.linalg.solve(now.joints @ transposed + damping, miss[:, :, None])
            q = q + np.clip(step[:, :, 0], -0.3, 0.3)
        arrived = np.flatnonzero(size < 1e-14)[:missing]
        found.append((q[arrived], center[arrived]))
        missing -= len(arrived)
        if missing == 0:
            return np.concatenate([q for q, _ in found]), np.concatenate([c for _, c in found])
    return None
