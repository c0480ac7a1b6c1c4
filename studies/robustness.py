# SPDX-License-Identifier: Apache-2.0
"""Gross errors among the poses: are they found, and is the arm as good as without them?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.measurement import ProbingSet
from calib_solver.fitting import Options
from calib_solver.identification import identify
from calib_solver.identified import Identification
from calib_solver.problem import Problem
from calib_solver.quality import assess
from studies.running import columns, over_seeds, study
from studies.scenes import (
    LOCATIONS,
    SPHERES,
    Noise,
    Scene,
    kr5,
    measure,
    off_as_the_prior_says,
    off_mount,
    reach,
)

ABOUT = """
A KR 5 sixx R650 with an active probe, 7 locations x 4 spheres x 60 poses with noise; six locations
identify the arm, the seventh, always clean, is held out. `held out`: the rms distance of its poses
to the certificate, against that of the arm identified without the errors. `truth`: the same for the
rms error of 300 predictions anywhere. `found`: of the bad poses, left out (for spheres: set apart
from the others of their location). `good lost`: good poses left out. `named`: of the bad poses left
out, those whose reason names the right kind. Medians and the worst of all seeds.
"""
POSES = 60
NOISE = Noise()
HELD_OUT = LOCATIONS
#: part of the poses that is bad, and how far they are off, m
BAD = 0.05
SLIP = (1e-3, 20e-3)
#: a stretch of poses during which a stylus is stuck, and how far the gauge is pushed, m
STRETCH = 80
PUSHED = 1e-3

Mask = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
Spoilt = tuple[ProbingSet, Mask]
Spheres = frozenset[tuple[int, int]]


def slipped(scene: Scene, poses: ProbingSet, generator: np.random.Generator) -> Spoilt:
    """The contact slipped: the arm is 1 to 20 mm from where the reading was taken."""
    bad = generator.uniform(size=len(poses)) < BAD
    return moved(scene, poses, bad, _shifts(generator, int(bad.sum()))), bad


def _shifts(generator: np.random.Generator, count: int) -> Array:
    along = generator.normal(size=(count, 3))
    size = generator.uniform(*SLIP, (count, 1))
    shift: Array = along / np.linalg.norm(along, axis=1, keepdims=True) * size
    return shift


def moved(scene: Scene, poses: ProbingSet, bad: Mask, shift: Array) -> ProbingSet:
    """The poses with the arm moved by `shift` (B, 3), m, in those that are `bad`."""
    measured = scene.measured
    centers = measured.probe.centers(poses.displacement[bad], measured.gauge.sphere_diameter)
    p_flange = scene.mount.apply(centers)
    at = scene.points(poses.joints[bad], p_flange)
    joints = poses.joints.copy()
    joints[bad], _ = reach(scene.arm, joints[bad], p_flange, at + shift)
    return replace(poses, joints=joints)


def mislabelled_poses(scene: Scene, poses: ProbingSet, generator: np.random.Generator) -> Spoilt:
    """Single poses with the number of another sphere of their location."""
    bad = generator.uniform(size=len(poses)) < BAD
    sphere = poses.sphere.copy()
    others = [[k for k in SPHERES if k != own] for own in sphere[bad]]
    sphere[bad] = [generator.choice(numbers) for numbers in others]
    return replace(poses, sphere=sphere), bad


def stuck(scene: Scene, poses: ProbingSet, generator: np.random.Generator) -> Spoilt:
    """A stylus stays where it is for a stretch of poses."""
    first = generator.integers(len(poses) - STRETCH)
    stylus = generator.integers(3)
    displacement = poses.displacement.copy()
    displacement[first : first + STRETCH, stylus] = displacement[first, stylus]
    bad = np.zeros(len(poses), dtype=bool)
    bad[first : first + STRETCH] = True
    return replace(poses, displacement=displacement), bad


def mislabelled_sphere(scene: Scene, poses: ProbingSet, generator: np.random.Generator) -> Spoilt:
    """All poses of one sphere with a number that was not probed."""
    location, sphere = generator.integers(1, HELD_OUT), generator.choice(SPHERES)
    bad = (poses.location == location) & (poses.sphere == sphere)
    other = generator.choice([k for k in range(1, 16) if k not in SPHERES])
    return replace(poses, sphere=np.where(bad, other, poses.sphere)), bad


def two_spheres_swapped(scene: Scene, poses: ProbingSet, generator: np.random.Generator) -> Spoilt:
    """Two spheres of one location with each other's number."""
    location = generator.integers(1, HELD_OUT)
    one, two = generator.choice(SPHERES, 2, replace=False)
    here = poses.location == location
    sphere = poses.sphere.copy()
    sphere[here & (poses.sphere == one)] = two
    sphere[here & (poses.sphere == two)] = one
    return replace(poses, sphere=sphere), here & np.isin(poses.sphere, (one, two))


def gauge_moved(scene: Scene, poses: ProbingSet, generator: np.random.Generator) -> Spoilt:
    """The gauge was pushed between the second and the third sphere of a location."""
    location = generator.integers(1, HELD_OUT)
    bad = (poses.location == location) & np.isin(poses.sphere, SPHERES[2:])
    push = generator.normal(size=3)
    push = PUSHED * push / np.linalg.norm(push)
    return moved(scene, poses, bad, np.tile(push, (int(bad.sum()), 1))), bad


Spoil = Callable[[Scene, ProbingSet, np.random.Generator], Spoilt]
FAULTS: dict[str, Spoil] = {
    '5 % slipped contacts': slipped,
    '5 % mislabelled poses': mislabelled_poses,
    'a stylus stuck': stuck,
    'a sphere mislabelled': mislabelled_sphere,
    'two spheres swapped': two_spheres_swapped,
    'gauge pushed by 1 mm': gauge_moved,
}
WORD = {
    '5 % slipped contacts': 'slipped',
    '5 % mislabelled poses': 'mislabelled',
    'a stylus stuck': 'stuck',
}


@dataclass(frozen=True)
class Outcome:
    """Ratios to the arm of the clean poses, and shares of the bad poses and counts."""

    held_out: float
    truth: float
    found: float
    named: float
    good_lost: int


def scene_of(seed: int) -> Scene:
    """A clean calibration."""
    bench = kr5()
    generator = np.random.default_rng((seed, 3))
    arm, mount = off_as_the_prior_says(bench.arm, generator), off_mount(bench.probe, generator)
    return measure(bench, arm, mount, generator, POSES, NOISE)


def outcomes(seed: int) -> dict[str, Outcome]:
    """Every fault in one calibration; `clean`: the good poses lost without any."""
    scene = scene_of(seed)
    measured, held_out = scene.held_out(HELD_OUT)
    clean = identify(measured)
    judged = Problem.of(held_out)

    def quality(done: Identification) -> tuple[float, float]:
        position = assess(judged, done.arm, done.probe).position
        off = scene.errors(done.arm, done.probe)
        return float(np.sqrt(np.mean(position**2))), float(np.sqrt(np.mean(off**2)))

    best = quality(clean)
    found = {'none': Outcome(1.0, 1.0, 1.0, 1.0, len(clean.rejected))}
    for number, (name, spoil) in enumerate(FAULTS.items()):
        poses, bad = spoil(scene, measured.poses, np.random.default_rng((seed, 4, number)))
        done = identify(replace(measured, poses=poses), Options())
        now = quality(done)
        left_out = np.zeros(len(poses), dtype=bool)
        left_out[[one.pose - 1 for one in done.rejected]] = True
        named = [WORD.get(name, '') in one.reason for one in done.rejected if bad[one.pose - 1]]
        dealt = left_out | _set_apart(done, poses)
        found[name] = Outcome(
            now[0] / best[0],
            now[1] / best[1],
            float(dealt[bad].mean()),
            float(np.mean(named)) if named else 1.0,
            int((left_out & ~bad).sum()),
        )
    return found


def _set_apart(done: Identification, poses: ProbingSet) -> Mask:
    """Poses of spheres that do not stand with the first others of their location."""
    apart: Mask = np.zeros(len(poses), dtype=bool)
    problem = done.problem
    for rows in problem.locations:
        placements = problem.placement[rows]
        if len(np.unique(placements)) == 1:
            continue
        for location, sphere in problem.keys[rows]:
            apart |= (poses.location == location) & (poses.sphere == sphere)
    return apart


def table(count: int) -> list[str]:
    """The lines of the study."""
    found = over_seeds(outcomes, range(count))
    rows = []
    for name in ('none', *FAULTS):
        of = [each[name] for each in found]
        rows.append(
            [
                name,
                *_ratio([one.held_out for one in of]),
                *_ratio([one.truth for one in of]),
                f'{100 * np.mean([one.found for one in of]):.1f}',
                f'{100 * np.mean([one.named for one in of]):.1f}' if name in WORD else '-',
                str(sum(one.good_lost for one in of)),
            ]
        )
    header = ['', 'held out', 'worst', 'truth', 'worst', 'found %', 'named %', 'good lost']
    good = count * (HELD_OUT - 1) * len(SPHERES) * POSES
    return [f'{count} seeds, {good} poses', '', *columns(header, rows)]


def _ratio(values: list[float]) -> tuple[str, str]:
    return f'{np.median(values):.3f}', f'{max(values):.3f}'


if __name__ == '__main__':
    study('robustness', ABOUT, 30, table)
