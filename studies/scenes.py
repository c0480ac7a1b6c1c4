# SPDX-License-Identifier: Apache-2.0
"""Seeded calibrations whose truth is known: a ball bar probed by an arm off its description."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib_model.arrays import Array
from calib_model.descriptions import (
    parse_arm,
    parse_gauge,
    parse_placements,
    parse_probe,
    read_description,
)
from calib_model.instruments import Arm, Gauge, PassiveProbe, Probe
from calib_model.kinematics import DEFAULT_SIGMA, parallel_joints, point_derivatives, points
from calib_model.measurement import Measurement, ProbingSet
from calib_model.transforms import RigidTransform, nearest_rotation
from calib_solver.identified import Identification
from calib_solver.problem import Problem, point_jacobian

CONFIG = Path(__file__).resolve().parents[1] / 'ros2_ws/src/calib_bringup/config'
SPHERES = (1, 6, 10, 14)
LOCATIONS = 7
#: how far off its middle an active probe meets a sphere, m
PUSH = 1.2e-3
#: postures known for every sphere at most, from which each measurement takes its own
POOL = 150


@dataclass(frozen=True)
class Bench:
    """What is nominal: arm, probe, gauge, and where the gauge stands, location by location."""

    arm: Arm
    probe: Probe
    gauge: Gauge
    placements: tuple[RigidTransform, ...]
    spheres: tuple[int, ...] = SPHERES


@dataclass(frozen=True)
class Noise:
    """Standard deviations: of every joint at every pose (rad) and of the sphere's centre as the
    probe reads it (m, per coordinate); `certificate` as a ratio to its stated uncertainty."""

    joint: float = 1e-5
    reading: float = 1e-6
    certificate: float = 1.0


NOISELESS = Noise(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Scene:
    """The truth, and what was measured of it; `location` of the measurement counts from 1."""

    arm: Arm
    mount: RigidTransform
    measured: Measurement

    def held_out(self, location: int) -> tuple[Measurement, Measurement]:
        """The measurement without one location, and that location alone."""
        apart = self.measured.poses.location == location
        return (
            replace(self.measured, poses=self.measured.poses.take(~apart)),
            replace(self.measured, poses=self.measured.poses.take(apart)),
        )

    def points(self, q: Array, p_flange: Array) -> Array:
        """Where points (N, 3) of the flange really are at postures q (N, n), m."""
        return points(self.arm, q, p_flange)

    def seated(self, q: Array, centers: Array) -> Array:
        """Where spheres (N, 3) that sit in the probe really are at postures q (N, n), m."""
        return self.points(q, self.mount.apply(centers))

    def errors(self, arm: Arm, probe: Probe, seed: int = 0, count: int = 300) -> Array:
        """How far `arm` is off the truth at postures anywhere (count,), m, base left free."""
        q, centers = anywhere(self.arm, probe, np.random.default_rng(seed), count)
        true = points(self.arm, q, self.mount.apply(centers))
        said = points(arm, q, probe.flange_T_probe.apply(centers))
        off: Array = np.linalg.norm(aligned(said, true) - true, axis=1)
        return off


def predicted(done: Identification, q: Array, centers: Array) -> tuple[Array, Array]:
    """Where an identified arm with all that was found of it has spheres (N, 3) that sit at
    `centers` (N, 3) in its probe, at postures q (N, n), m; and how that goes (N, 3, F) with the
    free parameters."""
    measured, probe = done.problem.measured, done.probe
    displacement = np.zeros_like(centers)
    if not isinstance(probe, PassiveProbe):
        displacement = probe.displacements(centers, measured.gauge.sphere_diameter)
    number = measured.gauge.numbers[0]
    poses = ProbingSet.of([1] * len(q), [number] * len(q), q, displacement)
    there = Problem.of(replace(measured, poses=poses))
    p_base, jacobian = point_jacobian(there, done.table, done.full, np.arange(len(q)))
    return p_base, jacobian[:, :, done.table.free_columns]


def unseen_distances(
    done: Identification,
    true: Callable[[Array, Array], Array],
    generator: np.random.Generator,
    pairs: int,
) -> tuple[Array, Array]:
    """Errors of predicted distances between points anywhere, two by two, and what is stated of
    them (pairs,), m; `true` gives where spheres (N, 3) in the probe are at postures (N, n)."""
    q, centers = anywhere(done.arm, done.probe, generator, 2 * pairs)
    said, jacobian = predicted(done, q, centers)
    really = true(q, centers)
    between = said[:pairs] - said[pairs:]
    length = np.linalg.norm(between, axis=1)
    slope = np.einsum('nk,nkf->nf', between / length[:, None], jacobian[:pairs] - jacobian[pairs:])
    stated = np.sqrt(np.einsum('nf,fg,ng->n', slope, done.uncertainty.covariance, slope))
    off: Array = length - np.linalg.norm(really[:pairs] - really[pairs:], axis=1)
    return off, stated


def kr5(probe: str = 'active') -> Bench:
    """The KR 5 sixx R650 at the seven places of its ball bar, an active or a passive probe."""
    arm = read_description(CONFIG / 'arms/kuka_kr5_sixx_r650.yaml', parse_arm)
    trihedron = read_description(CONFIG / 'probes/active_trihedron.yaml', parse_probe)
    seat = PassiveProbe('seat', trihedron.flange_T_probe, np.array([0.001, 0.002, 0.01]))
    gauge = read_description(CONFIG / 'gauges/ball_bar_kr5.yaml', parse_gauge)
    places = read_description(CONFIG / 'locations/kr5.yaml', parse_placements)
    stands = tuple(places[number] for number in range(1, LOCATIONS + 1))
    return Bench(arm, trihedron if probe == 'active' else seat, gauge, stands)


def anywhere(
    arm: Arm, probe: Probe, generator: np.random.Generator, count: int
) -> tuple[Array, Array]:
    """Postures (count, n) between the joint limits, spheres' centres (count, 3) in the probe."""
    limits = np.clip(arm.limits, -2.5, 2.5)
    q = generator.uniform(limits[:, 0], limits[:, 1], (count, arm.n))
    return q, seated(probe, generator, count)


def seated(probe: Probe, generator: np.random.Generator, count: int) -> Array:
    """Where spheres sit in the probe (count, 3), m."""
    if isinstance(probe, PassiveProbe):
        return np.tile(probe.center, (count, 1))
    return generator.uniform(-PUSH, PUSH, (count, 3))


def aligned(moving: Array, fixed: Array) -> Array:
    """Points (N, 3) moved rigidly as near to `fixed` (N, 3) as they come."""
    moving_mean, fixed_mean = moving.mean(axis=0), fixed.mean(axis=0)
    rotation = nearest_rotation((fixed - fixed_mean).T @ (moving - moving_mean))
    placed: Array = (moving - moving_mean) @ rotation.T + fixed_mean
    return placed


def off_as_the_prior_says(arm: Arm, generator: np.random.Generator, size: float = 1.0) -> Arm:
    """An arm off in every parameter, those that nothing shows included."""
    kinds = ('a', 'alpha', 'd', 'theta_0', 'beta')
    sigma = np.array([DEFAULT_SIGMA[kind] for kind in kinds])[:, None] * np.ones(arm.n)
    return _off(arm, size * sigma * generator.normal(size=(5, arm.n)))


def off_by_at_most(arm: Arm, generator: np.random.Generator, length: float, angle: float) -> Arm:
    """An arm off evenly by up to `length` (m) and `angle` (rad) in every parameter."""
    most = np.array([length, angle, length, angle, angle])[:, None]
    return _off(arm, most * generator.uniform(-1, 1, (5, arm.n)))


def _off(arm: Arm, error: Array) -> Arm:
    # beta where axes are parallel; elsewhere the other four say any line already
    others = [i for i in range(arm.n) if i + 1 not in parallel_joints(arm)]
    error[4, others] = 0.0
    return arm.with_geometry(arm.geometry + error)


def off_mount(
    probe: Probe, generator: np.random.Generator, translation: float = 5e-4, rotation: float = 6e-3
) -> RigidTransform:
    """The mount off by so much in each coordinate (m) and about each axis (rad)."""
    nominal = probe.flange_T_probe
    return RigidTransform(
        nominal.translation + translation * generator.normal(size=3),
        nominal.rotation_vector + rotation * generator.normal(size=3),
    )


def off_gauge(gauge: Gauge, generator: np.random.Generator, ratio: float) -> Gauge:
    """The gauge as it really is: off its certificate as this says (k = 2), one bar throughout."""
    metre = 1 + ratio * gauge.proportional / 2 * generator.normal()
    each = ratio * gauge.constant / 2 / np.sqrt(2)
    spheres = [
        (number, tuple(metre * np.array(center) + each * generator.normal(size=3)))
        for number, center in gauge.spheres
    ]
    return replace(gauge, spheres=tuple(spheres))


def measure(
    bench: Bench,
    arm: Arm,
    mount: RigidTransform,
    generator: np.random.Generator,
    poses: int,
    noise: Noise = NOISELESS,
) -> Scene:
    """`poses` of every sphere at every location, by the true `arm` and `mount`."""
    true_gauge = off_gauge(bench.gauge, generator, noise.certificate)
    targets = _targets(bench, true_gauge)
    pool = _pool(bench, min(POOL, 2 * poses))
    chosen = np.array([_chosen(generator, poses, pool.shape[1]) for _ in targets])
    q: Array = np.take_along_axis(pool, chosen[:, :, None], axis=1).reshape(-1, arm.n)
    if poses > pool.shape[1]:
        # the same posture comes several times: near it is another one
        q = q + 0.03 * generator.normal(size=q.shape)
    centers = seated(bench.probe, generator, len(q))
    wanted = np.repeat(targets, poses, axis=0)
    q, arrived = reach(arm, q, mount.apply(centers), wanted)
    assert arrived.mean() > 0.98, f'{arm.name}: too few postures found'
    keys = np.array(
        [
            (location, sphere)
            for location in range(1, len(bench.placements) + 1)
            for sphere in bench.spheres
        ]
    )
    location, sphere = np.repeat(keys, poses, axis=0)[arrived].T
    q, read = q[arrived], centers[arrived]
    q = q + noise.joint * generator.normal(size=q.shape)
    if isinstance(bench.probe, PassiveProbe):
        displacement = np.zeros_like(read)
    else:
        read = read + noise.reading * generator.normal(size=read.shape)
        displacement = bench.probe.displacements(read, bench.gauge.sphere_diameter)
    taken = ProbingSet.of(location, sphere, q, displacement)
    measured = Measurement(bench.arm, bench.probe, bench.gauge, taken, 'simulated')
    return Scene(arm, mount, measured)


def _chosen(generator: np.random.Generator, poses: int, known: int) -> np.ndarray:
    """Which of the postures known for a sphere are taken, each once where there are enough."""
    rounds = -(-poses // known)
    return np.concatenate([generator.permutation(known) for _ in range(rounds)])[:poses]


def _targets(bench: Bench, gauge: Gauge) -> Array:
    """`p_base_sphere` (S, 3) of every sphere at every location, m."""
    certified = np.array([gauge.center(number) for number in bench.spheres])
    return np.concatenate([stand.apply(certified) for stand in bench.placements])


_POOLS: dict[tuple[str, str, int], Array] = {}


def _pool(bench: Bench, size: int) -> Array:
    """Postures (S, size, n) of the nominal arm at every sphere, the same for every seed."""
    targets = _targets(bench, bench.gauge)
    key = (bench.arm.name, bench.probe.kind, hash((size, targets.tobytes())))
    if key not in _POOLS:
        generator = np.random.default_rng(1)
        _POOLS[key] = np.array([_postures(bench, target, size, generator) for target in targets])
    return _POOLS[key]


def _postures(bench: Bench, target: Array, size: int, generator: np.random.Generator) -> Array:
    """Postures (size, n) that hold the middle of the probe at a target, from anywhere."""
    found: Array = np.zeros((0, bench.arm.n))
    for _ in range(40):
        q, centers = anywhere(bench.arm, bench.probe, generator, size)
        p_flange = bench.probe.flange_T_probe.apply(centers)
        q, arrived = reach(bench.arm, q, p_flange, np.tile(target, (size, 1)), steps=40)
        arrived &= bench.arm.within_limits(q, 0.02)
        found = np.concatenate([found, q[arrived]])
        if len(found) >= size:
            return found[:size]
    raise AssertionError(f'{bench.arm.name} does not reach {target}')


def reach(
    arm: Arm, q: Array, p_flange: Array, target: Array, steps: int = 30
) -> tuple[Array, np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
    """Damped Newton steps from postures q (N, n) that bring points (N, 3) to targets (N, 3), and
    which of them (N,) arrived, to the last digits."""
    q = q.copy()
    left = np.arange(len(q))
    for _ in range(steps):
        now = point_derivatives(arm, q[left], p_flange[left])
        miss = target[left] - now.p_base
        size = np.linalg.norm(miss, axis=1)
        damping = np.where(size > 1e-3, 1e-3, 1e-12)[:, None, None] * np.eye(3)
        transposed = np.swapaxes(now.joints, 1, 2)
        step = transposed @ np.linalg.solve(now.joints @ transposed + damping, miss[:, :, None])
        q[left] += np.clip(step[:, :, 0], -0.3, 0.3)
        left = left[size > 1e-12]
        if len(left) == 0:
            break
    miss = target - points(arm, q, p_flange)
    return q, np.linalg.norm(miss, axis=1) < 1e-13
