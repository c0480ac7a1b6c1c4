# SPDX-License-Identifier: Apache-2.0
"""Does the default prior help where poses are few, and leave alone what many of them tell?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_model.kinematics import DEFAULT_SIGMA
from calib_solver.fitting import USUAL_PRIOR, Options, Prior
from calib_solver.identification import identify
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
A KR 5 sixx R650 with an active probe; rms error, um, of 300 predictions anywhere, median over the
seeds, by the prior's strength (0: none; 2: the default). The arm's parameters are off in turn by
a third of what the prior says, by that, and by three times as much. `helped`: seeds at which the
default is better than no prior; `ratio`: of their errors, median.
"""
STRENGTHS = (0.0, 1.0, 2.0, 10.0)
#: poses in all, locations, and poses of each of their 4 spheres
SETS = ((60, 1, 15), (60, 3, 5), (1680, 7, 60), (10080, 7, 360))
SIZES = (1 / 3, 1.0, 3.0)
NOISE = Noise(joint=1e-4, reading=1e-6)


def errors(seed: int) -> list[list[list[float]]]:
    """rms error (m) by size of the arm's errors, set of poses and strength."""
    found = []
    for size in SIZES:
        of_size = []
        for total, locations, poses in SETS:
            scene = scene_of(seed, size, locations, poses)
            assert abs(len(scene.measured.poses) - total) < 0.03 * total
            of_size.append([_error(scene, strength) for strength in STRENGTHS])
        found.append(of_size)
    return found


def scene_of(seed: int, size: float, locations: int, poses: int) -> Scene:
    """A calibration of an arm off by `size` times what the prior says."""
    bench = kr5()
    generator = np.random.default_rng((seed, 5))
    arm = off_as_the_prior_says(bench.arm, generator, size)
    mount = off_mount(bench.probe, generator)
    bench = replace(bench, placements=bench.placements[:locations])
    return measure(bench, arm, mount, generator, poses, NOISE)


def _error(scene: Scene, strength: float) -> float:
    done = identify(scene.measured, Options(prior=Prior(DEFAULT_SIGMA, strength), joint_errors=()))
    return float(np.sqrt(np.mean(scene.errors(done.arm, done.probe) ** 2)))


def table(count: int) -> list[str]:
    """The lines of the study."""
    every = np.array(over_seeds(errors, range(count)))  # (seeds, sizes, sets, strengths)
    none, default = STRENGTHS.index(0.0), STRENGTHS.index(USUAL_PRIOR.strength)
    lines = [f'{count} seeds']
    for i, size in enumerate(SIZES):
        rows = []
        for j, (total, locations, _) in enumerate(SETS):
            of = every[:, i, j]
            ratio = of[:, default] / of[:, none]
            rows.append(
                [
                    f'{total} poses, {locations} x 4 spheres',
                    *(f'{1e6 * value:.2f}' for value in np.median(of, axis=0)),
                    f'{int((ratio < 1).sum())} of {count}',
                    f'{np.median(ratio):.3f}',
                ]
            )
        header = ['', *(f'strength {s:g}' for s in STRENGTHS), 'helped', 'ratio']
        lines += ['', f'parameters off by {size:.2g} of what the prior says', '']
        lines += columns(header, rows)
    return lines


if __name__ == '__main__':
    study('prior', ABOUT, 10, table)
