# SPDX-License-Identifier: Apache-2.0
"""Seeded problems of any size: a FARO-like arm with errors probes a ball bar, without a graph.

A few hundred postures per sphere are found by damped Newton steps from anywhere; where more are
wanted, each starts from one of these, moved along what leaves the sphere where it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib_model.arrays import Array
from calib_model.descriptions import parse_arm, parse_gauge, parse_probe, read_description
from calib_model.instruments import Arm, Gauge, PassiveProbe, Probe
from calib_model.kinematics import ParameterTable, joint_frames
from calib_model.measurement import Measurement, ProbingSet
from calib_model.transforms import RigidTransform

CONFIG = Path(__file__).resolve().parents[1] / 'ros2_ws/src/calib_bringup/config'
#: the chapter's set: 7 locations x 4 spheres x 385 poses
CHAPTER = 10_780
LOCATIONS, SPHERES = 7, (1, 6, 10, 14)
#: what the arm differs from its description by, m and rad, and how its joints scatter, rad
LENGTH_ERROR, ANGLE_ERROR, JOINT_NOISE = 3e-4, 1e-3, 1e-4
MOUNT_ERROR, MOUNT_TURN, READING_NOISE, PUSH = 1e-3, 1e-2, 1e-6, 1.2e-3
POOL, NULL_STEP, BLOCK = 400, 0.2, 4096
REACH = (0.25, 1.15)  # of the probed spheres from the shoulder, m


@dataclass(frozen=True)
class World:
    """What only the simulation knows: the arm and the probe's mount as they really are."""

    arm: Arm
    mount: RigidTransform


def faro(active: bool = False) -> tuple[Arm, Probe, Gauge]:
    """The FARO Sterling with its seat (or with the active probe in the seat's place)."""
    arm = read_description(CONFIG / 'arms/faro_sterling.yaml', parse_arm)
    seat = read_description(CONFIG / 'probes/passive_seat_faro.yaml', parse_probe)
    gauge = read_description(CONFIG / 'gauges/ball_bar_1500.yaml', parse_gauge)
    if not active:
        return arm, seat, gauge
    trihedron = read_description(CONFIG / 'probes/active_trihedron.yaml', parse_probe)
    return arm, trihedron.mounted(seat.flange_T_probe), gauge


def faro_measurement(poses: int = CHAPTER, seed: int = 1, active: bool = False) -> Measurement:
    """`poses` probing poses, spread evenly over 7 locations of 4 spheres, sorted by sphere."""
    rng = np.random.default_rng(seed)
    arm, probe, gauge = faro(active)
    world = _world(rng, arm, probe)
    targets = np.concatenate([_location(rng, gauge) for _ in range(LOCATIONS)])
    share = np.diff(np.linspace(0, poses, len(targets) + 1).astype(int))
    joints, displacement = [], []
    for target, count in zip(targets, share, strict=True):
        q, read = _probe_sphere(rng, world, probe, gauge.sphere_diameter, target, int(count))
        joints.append(q)
        displacement.append(read)
    location = np.repeat(np.arange(1, LOCATIONS + 1), len(SPHERES))
    sphere = np.tile(SPHERES, LOCATIONS)
    taken = ProbingSet.of(
        np.repeat(location, share),
        np.repeat(sphere, share),
        np.concatenate(joints),
        np.concatenate(displacement),
    )
    return Measurement(arm, probe, gauge, taken, f'{poses} simulated poses')


def reference_table(measured: Measurement) -> ParameterTable:
    """The 27 parameters that the C++ reference frees: all but beta and a rotation of the probe."""
    table = ParameterTable.of(measured.arm, measured.probe)
    held = table.matching('beta*') + table.matching('probe_r*')
    return table.frozen_at(held, 'not in the reference')


def _world(rng: np.random.Generator, arm: Arm, probe: Probe) -> World:
    size = np.array([LENGTH_ERROR, ANGLE_ERROR, LENGTH_ERROR, ANGLE_ERROR, 0.0])
    geometry = arm.geometry + size[:, None] * rng.normal(size=arm.geometry.shape)
    mount = probe.flange_T_probe
    turn = MOUNT_TURN * rng.normal(size=3)
    moved = RigidTransform(
        mount.translation + MOUNT_ERROR * rng.normal(size=3), mount.rotation_vector + turn
    )
    return World(arm.with_geometry(geometry), moved)


def _location(rng: np.random.Generator, gauge: Gauge) -> Array:
    """The probed spheres' centres (4, 3) of a bar laid anywhere in reach, m."""
    along = np.array([gauge.center(number) for number in SPHERES])
    along = along - (along[0] + along[-1]) / 2
    while True:
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        middle = rng.uniform([-0.9, -0.9, -0.2], [0.9, 0.9, 0.7])
        centers: Array = middle + along @ (turn * np.linalg.det(turn)).T
        distance = np.linalg.norm(centers, axis=1)
        if distance.min() > REACH[0] and distance.max() < REACH[1]:
            return centers


def _probe_sphere(
    rng: np.random.Generator, world: World, probe: Probe, diameter: float, target: Array, count: int
) -> tuple[Array, Array]:
    """`count` postures that hold the probe on a sphere, as the encoders and the probe tell it."""
    at_rest: Array = np.zeros((POOL, 3))
    if isinstance(probe, PassiveProbe):
        at_rest = at_rest + probe.center
    pool: Array = np.zeros((0, world.arm.n))
    lower, upper = world.arm.limits.T
    wanted = min(count, POOL)
    while len(pool) < wanted:
        anywhere: Array = rng.uniform(lower, upper, size=(POOL, world.arm.n))
        found, held = _reach(world, anywhere, at_rest, target, steps=40)
        held &= world.arm.within_limits(found)
        pool = np.concatenate([pool, found[held]])
    q: Array = pool[:count] if count <= POOL else pool[rng.integers(len(pool), size=count)]
    center: Array = np.broadcast_to(at_rest[0], (count, 3))
    if not isinstance(probe, PassiveProbe):
        center = rng.uniform(-PUSH, PUSH, size=(count, 3))
    joints = np.empty_like(q)
    for first in range(0, count, BLOCK):
        block = slice(first, first + BLOCK)
        joints[block] = _near(rng, world, q[block], center[block], target, moved=count > POOL)
    read: Array = np.zeros((count, 3))
    if not isinstance(probe, PassiveProbe):
        read = probe.displacements(center, diameter) + READING_NOISE * rng.normal(size=(count, 3))
    return joints + JOINT_NOISE * rng.normal(size=joints.shape), read


def _near(
    rng: np.random.Generator, world: World, q: Array, center: Array, target: Array, moved: bool
) -> Array:
    """Postures near q that hold `center` on the target; a few that fail start anew."""
    start = q
    held = np.zeros(len(q), dtype=bool)
    step = NULL_STEP if moved else 0.0
    while not held.all():
        left = np.flatnonzero(~held)
        _, jacobian = _point_by_joints(world, start[left], center[left])
        trial = start[left] + step * _null_motion(rng, jacobian)
        trial, good = _reach(world, trial, center[left], target, steps=5)
        q = q.copy()
        q[left[good]] = trial[good]
        held[left[good]] = True
        step /= 2
    return q


def _null_motion(rng: np.random.Generator, jacobian: Array) -> Array:
    """Random joint motions (N, n), about 1 rad a joint, that leave the point where it is."""
    wish = rng.normal(size=(len(jacobian), jacobian.shape[2]))
    return wish - _solved(jacobian, np.einsum('nij,nj->ni', jacobian, wish), 1e-6)


def _reach(
    world: World, q: Array, center: Array, target: Array, steps: int
) -> tuple[Array, np.ndarray]:
    """Newton steps from q (N, n), damped while far; and which of them arrived."""
    for _ in range(steps):
        point, jacobian = _point_by_joints(world, q, center)
        error = target - point
        size = np.abs(error).max(axis=1)
        damping = np.where(size > 1e-2, 1e-3, 1e-12)
        q = q + np.clip(_solved(jacobian, error, damping), -0.3, 0.3)
        if size.max() < 1e-7:
            break
    point, _ = _point_by_joints(world, q, center)
    return q, np.abs(target - point).max(axis=1) < 1e-9


def _solved(jacobian: Array, error: Array, damping: Array | float) -> Array:
    """J'(JJ' + damping)^-1 error, shape (N, n)."""
    normal = jacobian @ jacobian.transpose(0, 2, 1)
    normal += np.reshape(damping, (-1, 1, 1)) * np.eye(3)
    solved: Array = np.einsum(
        'nij,ni->nj', jacobian, np.linalg.solve(normal, error[:, :, None])[:, :, 0]
    )
    return solved


def _point_by_joints(world: World, q: Array, center: Array) -> tuple[Array, Array]:
    """The sphere's centre (N, 3) as the true arm holds it, and its derivative by q (N, 3, n)."""
    frames = list(joint_frames(world.arm, q))
    last = frames[-1]
    point = last.origin + np.einsum('nij,nj->ni', last.rotation, world.mount.apply(center))
    columns = []
    for frame, direction in zip(frames, world.arm.direction, strict=True):
        (zx, zy, zz), (x, y, z) = frame.z_joint.T, (point - frame.origin_joint).T
        turned = np.stack([zy * z - zz * y, zz * x - zx * z, zx * y - zy * x], axis=1)
        columns.append(direction * turned)
    return point, np.stack(columns, axis=2)
