# SPDX-License-Identifier: Apache-2.0
"""Eq. 15 from one sphere, from four, and with the certificate's distances between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import RankError
from calib_model.transforms import rotation_vector
from calib_solver.fitting import ProbeFit, fit_probe
from calib_solver.problem import Problem
from studies.running import columns, over_seeds, study
from studies.scenes import (
    Noise,
    Scene,
    kr5,
    measure,
    off_as_the_prior_says,
    off_mount,
)

ABOUT = """
P of an active probe on a KR 5 sixx R650, from poses at one location of the gauge, each joint of
each pose off by 1e-5 rad and the probe's centre by 1 um. rms error over the seeds of P's
translation (um) and rotation (urad), coordinates together, and the ratio of the actual error to
the stated standard uncertainty (rms; 1: just what is said). The arm that is held while P is fitted
is, in turn, the true one and the nominal one, whose parameters are off as the prior says: then P
takes up what the last joint's are off, and no stated uncertainty knows of the arm's errors.
`refused`: seeds at which the readings were said to leave P's rotation undetermined.
"""
POSES = 60
LAYOUTS = (
    '1 sphere, 60 poses',
    '4 spheres, 60 poses in all',
    '1 sphere, 150 poses',
    '4 spheres, 240 poses',
    '7 locations x 4 spheres, 1680 poses',
)
ARMS = ('true', 'nominal')


@dataclass(frozen=True)
class Outcome:
    """Error of P: `translation` (3,), m, `rotation` (3,), rad; `score` (6,) both over stated."""

    translation: Array
    rotation: Array
    score: Array


def outcomes(seed: int) -> dict[tuple[str, str, bool], Outcome]:
    """Every layout by each arm, without and with distances where there are any."""
    bench = kr5()
    generator = np.random.default_rng((seed, 6))
    true = off_as_the_prior_says(bench.arm, generator)
    mount = off_mount(bench.probe, generator)
    location = generator.integers(len(bench.placements))
    one = replace(bench, placements=(bench.placements[location],))
    first = replace(one, spheres=(int(generator.choice(bench.spheres)),))
    scenes = [(first, POSES), (one, 15), (first, 150), (one, POSES), (bench, POSES)]
    found = {}
    for layout, (part, poses) in zip(LAYOUTS, scenes, strict=True):
        scene = measure(part, true, mount, generator, poses, Noise())
        for held in ARMS:
            arm = true if held == 'true' else bench.arm
            problem = Problem.of(replace(scene.measured, arm=arm))
            for distances in (False, True)[: 1 + (len(part.spheres) > 1)]:
                try:
                    fit = fit_probe(problem, distances)
                except RankError:
                    continue
                found[layout, held, distances] = outcome(scene, fit)
    return found


def outcome(scene: Scene, fit: ProbeFit) -> Outcome:
    """How far P is from where the probe really sits."""
    shift = fit.flange_T_probe.translation - scene.mount.translation
    turn = rotation_vector(fit.flange_T_probe.rotation @ scene.mount.rotation.T)
    return Outcome(shift, turn, np.concatenate([shift, turn]) / fit.standard_uncertainty)


def table(count: int) -> list[str]:
    """The lines of the study."""
    found = over_seeds(outcomes, range(count))
    lines = [f'{count} seeds']
    for held in ARMS:
        rows = []
        for layout in LAYOUTS:
            for distances in (False, True):
                every = [each.get((layout, held, distances)) for each in found]
                of = [one for one in every if one is not None]
                if not of:
                    continue
                rows.append(
                    [
                        layout + (', distances' if distances else ''),
                        str(count - len(of)),
                        f'{1e6 * _rms([one.translation for one in of]):.1f}',
                        f'{1e6 * _rms([one.rotation for one in of]):.1f}',
                        f'{_rms([one.score for one in of]):.2f}',
                    ]
                )
        lines += ['', f'the {held} arm is held', '']
        lines += columns(['', 'refused', 'translation', 'rotation', 'error / stated'], rows)
    return lines


def _rms(values: list[Array]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


if __name__ == '__main__':
    study('probe_fit', ABOUT, 100, table)
