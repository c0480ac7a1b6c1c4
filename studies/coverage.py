# SPDX-License-Identifier: Apache-2.0
"""Do the stated 95 % intervals hold the truth in 92 to 98 of 100 calibrations?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.kinematics import DEFAULT_SIGMA
from calib_solver.fitting import NO_PRIOR, OBJECTIVES, Options
from calib_solver.identification import identify
from calib_solver.identified import Identification
from studies.running import columns, over_seeds, study
from studies.scenes import (
    Noise,
    Scene,
    kr5,
    measure,
    off_as_the_prior_says,
    off_mount,
    unseen_distances,
)

ABOUT = """
Simulated calibrations of a KR 5 sixx R650 with an active probe: 7 locations x 4 spheres x 60
poses; every parameter off as the prior says, those that nothing shows included; every joint of
every pose off by 1e-5 rad, the probe's centre by 1 um per coordinate, the gauge off its certificate
as that says. Per cent of the stated 95 % intervals that hold the truth, and the standard deviation
of (found - true) / stated. Parameters: the truth in the gauge of the table of parameters.
Distances: between 60 points at random postures anywhere between the joint limits.
"""
POSES = 60
PAIRS = 30
#: half the width of a 95 % interval, in standard uncertainties
WITHIN = 1.959964


@dataclass(frozen=True)
class Scores:
    """(found - true) / stated: of each free parameter (F,) and of distances (PAIRS,)."""

    names: tuple[str, ...]
    parameters: Array
    distances: Array
    misfit: float
    rejected: int


def scene_of(seed: int, noise: Noise = Noise()) -> tuple[Scene, Scene]:  # noqa: B008
    """A calibration and the same without any noise."""
    bench = kr5()
    generator = np.random.default_rng(seed)
    arm = off_as_the_prior_says(bench.arm, generator)
    mount = off_mount(
        bench.probe, generator, DEFAULT_SIGMA['probe_translation'], DEFAULT_SIGMA['probe_rotation']
    )
    exact = measure(bench, arm, mount, np.random.default_rng((seed, 1)), POSES, Noise(0, 0, 0))
    return measure(bench, arm, mount, np.random.default_rng((seed, 1)), POSES, noise), exact


def scores(seed: int) -> dict[str, Scores]:
    """The scores of one calibration by each objective."""
    scene, exact = scene_of(seed)
    # where the frozen parameters are nominal, the free ones take up what those are really off
    truth = identify(exact.measured, Options(prior=NO_PRIOR, loss='plain', joint_errors=()))
    assert truth.identified.phi < 1e-18, truth.fit.reason
    found = {}
    for name in OBJECTIVES:
        done = identify(scene.measured, Options(name, joint_errors=()))
        standard = done.uncertainty.standard
        off = (done.full - truth.full)[done.table.free_columns]
        found[name] = Scores(
            tuple(parameter.name for parameter in done.table.free),
            off / standard,
            distance_scores(scene, done, seed),
            done.uncertainty.misfit,
            len(done.rejected),
        )
    return found


def distance_scores(scene: Scene, done: Identification, seed: int) -> Array:
    """Scores of predicted distances between points, two by two."""
    generator = np.random.default_rng((seed, 2))
    off, stated = unseen_distances(done, scene.seated, generator, PAIRS)
    return off / stated


def table(count: int) -> list[str]:
    """The lines of the study."""
    found = over_seeds(scores, range(count))
    lines = [f'{count} calibrations', '']
    rows = []
    for name in OBJECTIVES:
        of = [each[name] for each in found]
        for what in ('parameters', 'distances'):
            rows.append([f'{name}, {what}', *_cells(np.array([getattr(s, what) for s in of]))])
    every = np.concatenate([np.ravel(s.parameters) for each in found for s in each.values()])
    rows.append(['all objectives, parameters', *_cells(every)])
    every = np.concatenate([np.ravel(s.distances) for each in found for s in each.values()])
    rows.append(['all objectives, distances', *_cells(every)])
    lines += columns(['', 'covered %', 'std'], rows)
    lines += ['', 'per parameter, covered %']
    names = found[0]['distance'].names
    by_name = [
        [
            parameter,
            *(_cells(np.array([e[name].parameters[i] for e in found]))[0] for name in OBJECTIVES),
        ]
        for i, parameter in enumerate(names)
    ]
    lines += columns(['', *OBJECTIVES], by_name)
    left_out = {name: float(sum(each[name].rejected for each in found)) for name in OBJECTIVES}
    misfit = {name: max(each[name].misfit for each in found) for name in OBJECTIVES}
    lines += ['', 'poses left out: ' + _listed(left_out), 'largest misfit: ' + _listed(misfit)]
    return lines


def _cells(score: Array) -> Sequence[str]:
    return f'{100 * np.mean(np.abs(score) < WITHIN):.1f}', f'{score.std():.3f}'


def _listed(values: dict[str, float]) -> str:
    return ', '.join(f'{name} {value:.4g}' for name, value in values.items())


if __name__ == '__main__':
    study('coverage', ABOUT, 300, table)
