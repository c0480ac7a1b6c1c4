# SPDX-License-Identifier: Apache-2.0
"""Arms far off their description, few poses: does the evidence end where the data would lead it?"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.descriptions import parse_arm, read_description
from calib_model.errors import CalibrationError
from calib_model.instruments import Arm, Gauge
from calib_model.kinematics import DEFAULT_SIGMA, parallel_joints, points
from calib_model.measurement import Measurement, ProbingSet
from calib_model.transforms import RigidTransform
from calib_solver.fitting import DEFAULT_PRIOR, NO_PRIOR, Options, Prior
from calib_solver.identification import identify
from studies.running import columns, over_seeds, study
from studies.scenes import (
    CONFIG,
    Bench,
    Noise,
    Scene,
    anywhere,
    kr5,
    off_mount,
    reach,
    seated,
    unseen_distances,
)

ABOUT = """
Arms off by 5 mm, 1 deg and zeros by 3 to 10 deg (standard deviations), the probe by 20 mm, in turn
a KR 5 sixx R650 and an LBR iiwa 14 with an active and with a passive probe; bars of 50 to 600 mm
with two to four spheres at one to three places, 12 to 60 poses in all; every joint of every pose
off by 1e-5 rad. rms errors of 300 distances between points anywhere, mm, by the evidence, by
none, and by a prior whose widths are the true ones. `ratio`: the evidence's over the better of the
two others. `quiet`: converged, without a warning, and beyond 4 times what is stated.

Then arms as usual but for their zeros, 2 to 10 deg off, 96 to 240 poses of four spheres at three
places: its error over that of no prior, and how often the stated 95 % intervals of the
distances hold.
"""
LENGTH, ANGLE, MOUNT, TURN = 5e-3, np.radians(1.0), 2e-2, 5e-2
ZEROS, MILD_ZEROS = np.radians((3.0, 10.0)), np.radians((2.0, 10.0))
MILD_POSES, MILD_SPHERES, MILD_LOCATIONS, MILD_BAR = (96, 240), 4, 3, 0.6
#: half the width of a 95 % interval, in standard uncertainties
WITHIN = 1.959964
BARS, POSES, SPHERES, LOCATIONS = (0.05, 0.6), (12, 60), (2, 4), (1, 3)
PAIRS = 300
NOISE = Noise()
#: so many times worse than the better of the others, or than is stated, is too much
WORSE, BEYOND = 2.0, 4.0


@dataclass(frozen=True)
class Hard:
    """A calibration, and the standard deviations that its arm's errors were drawn from."""

    name: str
    scene: Scene
    sigma: dict[str, float]


@dataclass(frozen=True)
class Outcome:
    """rms error over unseen distances and what is stated of it, m, the share of them that the
    stated 95 % intervals `held`, and why it stopped."""

    error: float
    stated: float
    held: float
    converged: bool
    warnings: tuple[str, ...]
    reason: str

    @property
    def quiet(self) -> bool:
        """Whether it is far beyond what it states and no one is told."""
        beyond = self.error > BEYOND * self.stated
        return self.converged and not self.warnings and beyond


def hard_scene(seed: int) -> Hard:
    """The hard start of a seed."""
    generator = np.random.default_rng((seed, 13))
    zeros = float(generator.uniform(*ZEROS))
    bar = float(np.exp(generator.uniform(*np.log(BARS))))
    spheres = int(generator.integers(SPHERES[0], SPHERES[1] + 1))
    places = int(generator.integers(LOCATIONS[0], LOCATIONS[1] + 1))
    poses = int(generator.integers(POSES[0], POSES[1] + 1))
    sigma = {
        **DEFAULT_SIGMA,
        **dict.fromkeys(('a', 'd'), LENGTH),
        **dict.fromkeys(('alpha', 'beta'), ANGLE),
        'theta_0': zeros,
        'probe_translation': MOUNT,
        'probe_rotation': TURN,
    }
    return _hard(seed, generator, sigma, (bar, spheres, places, poses))


def mild_scene(seed: int) -> Hard:
    """An arm as usual whose zeros are off, in many poses."""
    generator = np.random.default_rng((seed, 14))
    zeros = float(generator.uniform(*MILD_ZEROS))
    poses = int(generator.integers(MILD_POSES[0], MILD_POSES[1] + 1))
    sigma = {**DEFAULT_SIGMA, 'theta_0': zeros, 'probe_translation': 5e-4, 'probe_rotation': 6e-3}
    return _hard(seed, generator, sigma, (MILD_BAR, MILD_SPHERES, MILD_LOCATIONS, poses))


def _hard(
    seed: int,
    generator: np.random.Generator,
    sigma: dict[str, float],
    shape: tuple[float, int, int, int],
) -> Hard:
    """An arm off by `sigma`, measured on a bar of `shape` as `_measure` has it."""
    bench = kr5(('active', 'passive')[seed // 2 % 2])
    if seed % 2:
        arm = read_description(CONFIG / 'arms/kuka_lbr_iiwa14.yaml', parse_arm)
        bench = replace(bench, arm=arm)
    bar, spheres, places, poses = shape
    name = (
        f'{bench.arm.name} {bench.probe.kind}, {spheres} spheres {1e3 * bar:.0f} mm, '
        f'{places} places, {poses} poses, zeros {np.degrees(sigma["theta_0"]):.1f} deg'
    )
    true = off_by(bench.arm, generator, sigma)
    mount = off_mount(bench.probe, generator, sigma['probe_translation'], sigma['probe_rotation'])
    measured = _measure(bench, true, mount, generator, shape)
    return Hard(name, Scene(true, mount, measured), sigma)


def off_by(arm: Arm, generator: np.random.Generator, sigma: dict[str, float]) -> Arm:
    """An arm off by these standard deviations in every parameter."""
    size = np.array([sigma[kind] for kind in ('a', 'alpha', 'd', 'theta_0', 'beta')])
    error = size[:, None] * generator.normal(size=(5, arm.n))
    error[4, [i for i in range(arm.n) if i + 1 not in parallel_joints(arm)]] = 0.0
    return arm.with_geometry(arm.geometry + error)


def _measure(
    bench: Bench,
    true: Arm,
    mount: RigidTransform,
    generator: np.random.Generator,
    shape: tuple[float, int, int, int],
) -> Measurement:
    """What the true arm and probe measure of a bar of some length with so many spheres, at so many
    places, in so many poses in all."""
    bar, spheres, places, poses = shape
    along = np.linspace(0, bar, spheres)
    gauge = Gauge('bar', 0.022, tuple((k + 1, (x, 0.0, 0.0)) for k, x in enumerate(along)))
    found: list[tuple[int, int, Array, Array]] = []
    each = np.diff(np.linspace(0, poses, spheres * places + 1).astype(int))
    while len(found) < spheres * places:
        stand = _stand(bench, true, mount, generator)
        here = []
        for number in gauge.numbers:
            count = int(each[len(found) + len(here)])
            q, centers = _postures(
                bench, true, mount, stand.apply(gauge.center(number)), count, generator
            )
            if len(q) < count:
                break
            here.append((len(found) // spheres + 1, number, q, centers))
        else:
            found += here
    location, sphere = np.repeat([one[:2] for one in found], each, axis=0).T
    q = np.concatenate([one[2] for one in found])
    centers = np.concatenate([one[3] for one in found])
    q = q + NOISE.joint * generator.normal(size=q.shape)
    displacement = np.zeros_like(centers)
    if bench.probe.kind == 'active':
        read = centers + NOISE.reading * generator.normal(size=centers.shape)
        displacement = bench.probe.displacements(read, gauge.sphere_diameter)
    taken = ProbingSet.of(location, sphere, q, displacement)
    return Measurement(bench.arm, bench.probe, gauge, taken, 'simulated')


def _stand(
    bench: Bench, true: Arm, mount: RigidTransform, generator: np.random.Generator
) -> RigidTransform:
    """Somewhere in the middle of what the arm reaches."""
    q, centers = anywhere(bench.arm, bench.probe, generator, 300)
    reached = points(true, q, mount.apply(centers))
    far = np.linalg.norm(reached - reached.mean(axis=0), axis=1)
    near = reached[np.argsort(far)[:100]]
    return RigidTransform(near[generator.integers(len(near))], 2 * generator.normal(size=3))


def _postures(
    bench: Bench,
    true: Arm,
    mount: RigidTransform,
    target: Array,
    count: int,
    generator: np.random.Generator,
) -> tuple[Array, Array]:
    """At most `count` postures of the true arm that hold the sphere, and where it sits then."""
    q, _ = anywhere(bench.arm, bench.probe, generator, 8 * count + 40)
    centers = seated(bench.probe, generator, len(q))
    q, arrived = reach(true, q, mount.apply(centers), np.tile(target, (len(q), 1)))
    arrived &= bench.arm.within_limits(q, 0.02)
    return q[arrived][:count], centers[arrived][:count]


def outcome(hard: Hard, prior: Prior) -> Outcome:
    """The calibration by one prior."""
    try:
        done = identify(hard.scene.measured, Options(prior=prior))
    except CalibrationError as error:
        return Outcome(float('inf'), float('inf'), 0.0, False, (str(error),), str(error))
    off, stated = unseen_distances(done, hard.scene.seated, np.random.default_rng(1), PAIRS)
    held = float(np.mean(np.abs(off) < WITHIN * stated))
    return Outcome(
        _rms(off), _rms(stated), held, done.fit.converged, done.warnings, done.fit.reason
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def hard_outcomes(seed: int) -> tuple[str, list[Outcome]]:
    """By the evidence, by no prior, by one of true width."""
    hard = hard_scene(seed)
    priors = (DEFAULT_PRIOR, NO_PRIOR, Prior(hard.sigma, 1.0))
    return hard.name, [outcome(hard, prior) for prior in priors]


def mild_outcomes(seed: int) -> tuple[str, list[Outcome]]:
    """By the evidence and by no prior."""
    mild = mild_scene(seed)
    return mild.name, [outcome(mild, prior) for prior in (DEFAULT_PRIOR, NO_PRIOR)]


def mild_lines(count: int) -> list[str]:
    """The lines on zeros alone."""
    every = over_seeds(mild_outcomes, range(count))
    error = np.array([[one.error for one in each] for _, each in every])
    ratio = error[:, 0] / error[:, 1]
    held = np.mean([each[0].held for _, each in every])
    return [
        '',
        f'zeros alone, {count} arms: error over that of no prior, median {np.median(ratio):.3f}, '
        f'largest {ratio.max():.3f}; of the stated 95 % intervals {100 * held:.1f} % hold',
    ]


def table(count: int) -> list[str]:
    """The lines of the study."""
    every = over_seeds(hard_outcomes, range(count))
    error = np.array([[one.error for one in each] for _, each in every])
    ratio = error[:, 0] / error[:, 1:].min(axis=1)
    rows = [
        [what, *(f'{1e3 * v:.4g}' for v in np.quantile(of, (0.1, 0.5, 0.9, 1.0)))]
        for what, of in zip(('evidence', 'none', 'true width'), error.T, strict=True)
    ]
    lines = [f'{count} starts', '', *columns(['', '10 %', 'median', '90 %', 'worst'], rows), '']
    quiet = [each[0].quiet for _, each in every]
    verdicts = Counter(
        (each[0].converged, bool(each[0].warnings), each[0].error > BEYOND * each[0].stated)
        for _, each in every
    )
    lines += [
        f'{n:4d} {"converged" if c else "not converged"}, {"warned" if w else "no warning"}, '
        f'{"beyond" if b else "within"} {BEYOND:g} times what is stated'
        for (c, w, b), n in sorted(verdicts.items(), reverse=True)
    ]
    lines += [
        '',
        f'ratio beyond {WORSE:g}: {int((ratio > WORSE).sum())}, largest {ratio.max():.3g}',
        f'quiet: {sum(quiet)}',
    ]
    for seed in np.flatnonzero((ratio > WORSE) | quiet):
        name, each = every[seed]
        lines.append(
            f'seed {seed} ({name}): '
            + ', '.join(f'{1e3 * o.error:.4g} ({1e3 * o.stated:.3g})' for o in each)
            + f'; {each[0].converged}, {each[0].reason}; {" / ".join(each[0].warnings)}'
        )
    return lines + mild_lines(count // 4)


if __name__ == '__main__':
    study('hard_starts', ABOUT, 200, table)
