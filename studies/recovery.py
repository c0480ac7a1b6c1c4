# SPDX-License-Identifier: Apache-2.0
"""Noise-free poses of random arms: is the truth found again, and does none end wrong unsaid?"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.descriptions import parse_arm, read_description
from calib_model.instruments import Arm, Joint
from calib_model.kinematics import points
from calib_model.transforms import RigidTransform
from calib_solver.fitting import OBJECTIVES, Options
from calib_solver.identification import identify
from studies.running import columns, over_seeds, study
from studies.scenes import CONFIG, Bench, Scene, kr5, measure, off_by_at_most, off_mount, reach

ABOUT = """
Arms off by up to 2 mm and 0.5 deg in every parameter, in turn a KR 5 sixx R650, an LBR iiwa 14
and six axes anyhow, with an active and with a passive probe; 5 locations x 4 spheres x 20 poses
without any noise; the default prior. `right`: every prediction, at 300 postures anywhere and
relative to one another, within 1e-8 m of the truth. `said`: not within, and the result says so,
by converged: false and a reason or by parameters that it calls not identifiable.
"""
LENGTH, ANGLE = 2e-3, np.radians(0.5)
POSES, LOCATIONS = 20, 5
RIGHT = 1e-8
ARMS = ('kr5', 'iiwa', 'anyhow')
PROBES = ('active', 'passive')


@dataclass(frozen=True)
class Outcome:
    """How one arm came out by one objective."""

    objective: str
    arm: str
    probe: str
    seed: int
    error: float
    converged: bool
    unseen: int
    iterations: int
    reason: str

    @property
    def verdict(self) -> str:
        """right, said or WRONG."""
        if self.error <= RIGHT:
            return 'right'
        return 'said' if not self.converged or self.unseen else 'WRONG'


def scene_of(seed: int) -> tuple[str, str, Scene]:
    """The arm's kind, the probe's, and what was measured."""
    kind, probe = ARMS[seed % len(ARMS)], PROBES[seed // len(ARMS) % len(PROBES)]
    generator = np.random.default_rng((seed, 7))
    nominal = kr5(probe)
    if kind == 'iiwa':
        arm = read_description(CONFIG / 'arms/kuka_lbr_iiwa14.yaml', parse_arm)
        nominal = replace(nominal, arm=arm)
    if kind == 'anyhow':
        nominal = replace(nominal, arm=anyhow(generator, seed))
    bench = replace(nominal, placements=tuple(_places(nominal, generator)))
    true = off_by_at_most(bench.arm, generator, LENGTH, ANGLE)
    mount = off_mount(bench.probe, generator)
    return kind, probe, measure(bench, true, mount, generator, POSES)


def anyhow(generator: np.random.Generator, seed: int) -> Arm:
    """Six axes, none of them nearly parallel to the next."""
    joints = [
        Joint(
            f'joint_{i}',
            generator.uniform(-0.3, 0.3),
            generator.choice([-1, 1]) * generator.uniform(0.5, 2.6),
            generator.uniform(-0.3, 0.3),
            generator.uniform(-3, 3),
            direction=int(generator.choice([-1, 1])),
        )
        for i in range(1, 7)
    ]
    return Arm(f'anyhow_{seed}', tuple(joints))


def _places(bench: Bench, generator: np.random.Generator) -> list[RigidTransform]:
    """Places of the gauge at which the arm reaches all of its spheres."""
    reached = points(
        bench.arm,
        generator.uniform(-2.5, 2.5, (300, bench.arm.n)),
        bench.probe.flange_T_probe.translation,
    )
    far = np.linalg.norm(reached - reached.mean(axis=0), axis=1)
    near = reached[np.argsort(far)[:100]]
    found: list[RigidTransform] = []
    while len(found) < LOCATIONS:
        place = RigidTransform(near[generator.integers(len(near))], 2 * generator.normal(size=3))
        targets = [place.apply(bench.gauge.center(number)) for number in bench.spheres]
        if all(_reached(bench, target, generator) for target in targets):
            found.append(place)
    return found


def _reached(bench: Bench, target: Array, generator: np.random.Generator) -> bool:
    limits = np.clip(bench.arm.limits, -2.5, 2.5)
    q = generator.uniform(limits[:, 0], limits[:, 1], (40, bench.arm.n))
    p_flange = np.tile(bench.probe.flange_T_probe.translation, (40, 1))
    q, arrived = reach(bench.arm, q, p_flange, np.tile(target, (40, 1)))
    return bool((arrived & bench.arm.within_limits(q, 0.02)).sum() > 10)


def outcomes(seed: int) -> list[Outcome]:
    """One arm by every objective."""
    kind, probe, scene = scene_of(seed)
    found = []
    for name in OBJECTIVES:
        done = identify(scene.measured, Options(name, joint_errors=()))
        unseen = sum(a.parameter.free and not a.identifiable for a in done.estimates)
        error = float(scene.errors(done.arm, done.probe).max())
        fit = done.fit
        found.append(
            Outcome(
                name, kind, probe, seed, error, fit.converged, unseen, fit.iterations, fit.reason
            )
        )
    return found


def table(count: int) -> list[str]:
    """The lines of the study."""
    every = [one for each in over_seeds(outcomes, range(count)) for one in each]
    rows = []
    for name in OBJECTIVES:
        for probe in PROBES:
            of = [one for one in every if (one.objective, one.probe) == (name, probe)]
            verdicts = Counter(one.verdict for one in of)
            worst = max((one.error for one in of if one.verdict == 'right'), default=float('nan'))
            rows.append(
                [
                    f'{name}, {probe}',
                    str(len(of)),
                    *(str(verdicts[verdict]) for verdict in ('right', 'said', 'WRONG')),
                    str(sum(one.converged for one in of)),
                    f'{worst:.1e}',
                    f'{np.median([one.iterations for one in of]):.0f}',
                    str(max(one.iterations for one in of)),
                ]
            )
    header = [
        '',
        'arms',
        'right',
        'said',
        'WRONG',
        'converged',
        'worst right, m',
        'iterations',
        'most',
    ]
    lines = [f'{count} arms', '', *columns(header, rows)]
    others = [one for one in every if one.verdict != 'right']
    if others:
        lines += ['', 'those not right:']
    lines += [
        f'{one.verdict} {one.objective} {one.arm} {one.probe} seed {one.seed}: {one.error:.1e} m, '
        f'converged {one.converged}, {one.unseen} not identifiable; {one.reason}'
        for one in others
    ]
    return lines


if __name__ == '__main__':
    study('recovery', ABOUT, 200, table)
