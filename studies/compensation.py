# SPDX-License-Identifier: Apache-2.0
"""How near to 500 random targets does the real arm get, before and after compensation?"""

from __future__ import annotations

import numpy as np

from calib_model.arrays import Array
from calib_model.kinematics import points, tool_motion
from calib_solver.compensation import Calibrated, Targets, compensate_targets, tip
from calib_solver.fitting import workspace_at
from calib_solver.identification import identify
from calib_solver.identified import Identification
from studies.running import columns, over_seeds, study
from studies.scenes import Noise, Scene, aligned, kr5, measure, off_as_the_prior_says, off_mount

ABOUT = """
A KR 5 sixx R650 as far off as the prior says, probed with an active probe at 7 locations of 4
spheres.
Then 500 random targets, with the commands of the nominal arm and with those of `compensate`:
mean distance of the real probe to its target, mm, median over the seeds. Targets are told in the
arm's own base frame, which no probing shows (d1, theta_0_1, and where the arm stands): all points
together are laid on the targets first. `stated` is the standard uncertainty of a position that the
calibration states for the same postures, mean; `expected` the mean distance, laid on the targets as
well, of arms drawn from its covariance. Ratios are after to these, `worst` over the seeds.
"""
TARGETS = 500
BENT = 0.05  # m/rad, the slowest the tool can be moved by turning the joints
DRAWS = 40
POSES = (5, 20, 60)
NOISE = Noise(joint=2e-5, reading=1e-6)


def errors(seed: int) -> list[list[float]]:
    """Mean error before and after, stated and expected (m), by poses of each sphere."""
    found = []
    for poses in POSES:
        bench = kr5()
        generator = np.random.default_rng((seed, 7))
        arm = off_as_the_prior_says(bench.arm, generator)
        scene = measure(bench, arm, off_mount(bench.probe, generator), generator, poses, NOISE)
        found.append(before_and_after(scene, generator))
    return found


def before_and_after(scene: Scene, generator: np.random.Generator) -> list[float]:
    """Mean error (m) of the nominal and the compensated commands, and what to expect of these."""
    measured = scene.measured
    done = identify(measured)
    calibrated = Calibrated(measured.arm, done.arm, tip(measured.probe), tip(done.probe))
    targets = random_targets(calibrated, generator)
    answer = compensate_targets(calibrated, Targets(targets))
    reached = [scene.points(q, scene.mount.translation) for q in (answer.nominal, answer.joints)]
    return [
        *(mean_error(points, targets) for points in reached),
        stated(done, answer.joints),
        expected(done, answer.joints, generator),
    ]


def stated(done: Identification, q: Array) -> float:
    """The stated standard uncertainty of the tool's position at postures q (N, n), mean, m."""
    there = workspace_at(done.problem, done.table, done.full, q)
    return float(there.uncertainty(done.uncertainty.covariance).mean())


def random_targets(calibrated: Calibrated, generator: np.random.Generator) -> Array:
    """Where the nominal arm's tool is in random postures within its limits, (TARGETS, 3), m.

    Not where it is all but stretched out: what the nominal arm just reaches the real one may not.
    """
    arm, tool = calibrated.nominal, calibrated.nominal_tool
    q = generator.uniform(*arm.ranges.T, (2 * TARGETS, arm.n))
    motion = tool_motion(arm, q, tool)
    able = np.linalg.svd(motion.jacobian[:, :3], compute_uv=False)[:, -1] > BENT
    targets = motion.position[able][:TARGETS]
    assert len(targets) == TARGETS
    return targets


def mean_error(reached: Array, targets: Array) -> float:
    """Mean distance, m, all points together laid on the targets."""
    off = np.linalg.norm(aligned(reached, targets) - targets, axis=1)
    return float(off.mean())


def expected(done: Identification, q: Array, generator: np.random.Generator) -> float:
    """The calibration's own uncertainty of that mean at postures q (N, n), m."""
    measured = done.problem.measured
    said = points(done.arm, q, done.probe.flange_T_probe.translation)
    covariance = done.uncertainty.covariance
    drawn = generator.multivariate_normal(np.zeros(len(covariance)), covariance, DRAWS)
    means = []
    for offsets in drawn:
        full = done.full.copy()
        full[done.table.free_columns] += offsets
        arm, probe = done.table.apply(full, measured.arm, measured.probe)
        means.append(mean_error(points(arm, q, probe.flange_T_probe.translation), said))
    return float(np.mean(means))


def table(count: int) -> list[str]:
    """The lines of the study."""
    every = np.array(over_seeds(errors, range(count)))  # (seeds, sets, 4)
    rows = []
    for i, poses in enumerate(POSES):
        row = [f'{7 * 4 * poses} poses']
        row += [f'{value:.5f}' for value in 1e3 * np.median(every[:, i, :2], axis=0)]
        for own in (2, 3):
            ratio = every[:, i, 1] / every[:, i, own]
            row += [f'{1e3 * np.median(every[:, i, own]):.5f}']
            row += [f'{np.median(ratio):.2f}', f'{ratio.max():.2f}']
        rows.append(row)
    header = ['', 'before', 'after', 'stated', 'ratio', 'worst', 'expected', 'ratio', 'worst']
    return [f'{count} seeds', '', *columns(header, rows)]


if __name__ == '__main__':
    study('compensation', ABOUT, 4, table)
