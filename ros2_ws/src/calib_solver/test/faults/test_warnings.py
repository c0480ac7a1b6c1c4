# SPDX-License-Identifier: Apache-2.0
"""What was done otherwise than described is found out of any size, anywhere, on any arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import active, iiwa, kr5, passive, random_arm, simulate, ur_like

from calib_model.kinematics import identifiable_table
from calib_solver.faults.certificate import named_scale
from calib_solver.faults.encoder_jumps import large_jumps, likely_jumps, without
from calib_solver.faults.residual_projection import ResidualProjection, rough_spread
from calib_solver.faults.stuck_styli import set_apart, stuck_stretches
from calib_solver.faults.warnings import parameter_warnings
from calib_solver.fitting import USUAL_PRIOR
from calib_solver.identification import identify
from calib_solver.problem import Problem

pytestmark = pytest.mark.timeout(60)


@pytest.fixture(scope='module')
def measured():
    """Four locations of four spheres, 15 poses of each."""
    return simulate(kr5(), active(), 31, locations=4, poses=15, noise=1e-5).measured


def table_of(measured):
    return identifiable_table(measured.arm, measured.probe, (), ())


def jumped(measured, joint, size, first, last=None):
    """With a joint that reads `size` (rad) too much from pose `first` on, from 1."""
    off = np.zeros(len(measured.poses))
    off[first - 1 : last] = -size
    return replace(measured, poses=without(measured.poses, joint, off))


@pytest.mark.slow
@pytest.mark.parametrize('size', [-0.8, -0.1, 0.01, 0.3])
@pytest.mark.parametrize('make', [kr5, iiwa, ur_like, lambda: random_arm(np.random.default_rng(5))])
def test_a_jump_of_any_size_is_found_with_its_joint_size_and_moment(make, size):
    measured = simulate(make(), active(), 33, locations=4, poses=15, noise=1e-5).measured
    # within a location: between two of them the gauge might as well have turned
    wrong = jumped(measured, 2, size, 99)
    table = table_of(wrong)
    found = large_jumps(wrong, table, USUAL_PRIOR.sigmas(table))[0]
    assert (found.joint, found.last) == (2, None)
    assert abs(found.first - 99) <= 1
    assert found.size == pytest.approx(size, rel=0.02)
    mended = rough_spread(
        Problem.of(jumped(wrong, 2, -found.size, found.first)), table, USUAL_PRIOR.sigmas(table)
    )
    assert mended < rough_spread(Problem.of(wrong), table, USUAL_PRIOR.sigmas(table)) / 4


def test_a_jump_and_back_is_told_from_one_for_good(measured):
    wrong = jumped(measured, 3, 2e-3, 70, 150)
    table, done = table_of(wrong), identify(wrong)
    rows = np.arange(len(wrong.poses))
    residuals = ResidualProjection(Problem.of(wrong), table, done.arm, done.probe, rows)
    found = max(likely_jumps(residuals, np.arange(1, len(rows))), key=lambda jump: jump.share)
    assert (found.joint, found.first, found.last) == (3, 70, 150)
    assert found.size == pytest.approx(2e-3, rel=0.05)
    assert found.holds(np.array([68, 69, 149, 150])).tolist() == [False, True, True, False]


def test_what_the_parameters_can_do_is_no_fault(measured):
    """An arm that is off in everything leaves nothing but noise, to first order."""
    table = table_of(measured)
    problem = Problem.of(measured)
    done = identify(measured)
    rows = np.arange(len(measured.poses))
    left = ResidualProjection(problem, table, done.arm, done.probe, rows).left
    assert np.sqrt(left @ left / len(rows)) < 3e-5
    share, _ = ResidualProjection(problem, table, done.arm, done.probe, rows).explained(
        np.ones((len(rows), 3, 1))
    )
    assert share[0] == 0.0  # the same for all poses: their mean takes it up


@pytest.mark.slow
@pytest.mark.parametrize(('first', 'last'), [(1, 40), (41, 47), (200, 240), (1, 190), (20, 240)])
def test_a_stretch_with_one_reading_is_found_from_its_first_pose_to_its_last(measured, first, last):
    read = np.array(measured.poses.displacement)
    read[first - 1 : last, 1] = 4e-4
    wrong = replace(measured, poses=replace(measured.poses, displacement=read))
    (found,) = stuck_stretches(wrong)
    assert (found.stylus, found.first, found.last, found.reading) == (2, first, last, 4e-4)
    apart = set_apart(Problem.of(wrong), (found,))
    enough_left = (last - first + 1) <= 0.8 * len(read)
    assert (apart == 1).sum() == (last - first + 1) * enough_left
    line = f'stylus 2 reads 0.4000 mm in poses {first} to {last} while others move'
    assert any(each.startswith(line) for each in identify(wrong).warnings)


def test_two_styli_stuck_at_once_are_both_found(measured):
    read = np.array(measured.poses.displacement)
    read[50:90, :2] = 2e-4, -1e-4
    wrong = replace(measured, poses=replace(measured.poses, displacement=read))
    assert [one.stylus for one in stuck_stretches(wrong)] == [1, 2]


def test_a_passive_probe_has_no_stuck_styli():
    assert stuck_stretches(simulate(kr5(), passive(), 3, locations=2, poses=10).measured) == ()


def changed(measured, share=0.0, **lengths):
    """All lengths longer by a share, and single parameters by so much."""
    table = table_of(measured)
    full = np.array(table.nominal)
    for row, parameter in enumerate(table.parameters):
        if parameter.kind in ('a', 'd'):
            full[row] *= 1 + share
        full[row] += lengths.get(parameter.name, 0.0)
    return table, full, USUAL_PRIOR.sigmas(table)


def test_lengths_that_all_grow_by_more_than_arms_do_are_a_matter_of_scale(measured):
    (line,) = named_scale(*changed(measured, 0.01))
    assert line.startswith('the lengths of the arm come out 1.00% longer throughout')
    assert named_scale(*changed(measured, 0.001)) == ()
    assert named_scale(*changed(measured, a1=1e-3)) == ()


def test_what_is_far_from_nominal_is_told_unless_nothing_told_it(measured):
    table, full, sigma = changed(measured, a1=-8e-3, alpha2=0.1)
    sure, unsure = np.full(len(sigma), 1e-5), np.full(len(sigma), 1.0)
    (line,) = parameter_warnings(table, full, sigma, sure)
    assert 'alpha2 by +100.000 mrad, a1 by -8.000 mm' in line
    assert parameter_warnings(table, full, sigma, unsure) == ()
    assert parameter_warnings(*changed(measured, a1=4e-3), sure) == ()
    # where the probe is on the flange is what eq. 15 is for
    assert parameter_warnings(*changed(measured, probe_x=2.0), sure) == ()


def test_poses_that_are_all_the_same_are_no_traceback(measured):
    poses = measured.poses
    same = replace(
        poses,
        joints=np.tile(poses.joints[0], (len(poses), 1)),
        displacement=np.tile(poses.displacement[0], (len(poses), 1)),
    )
    done = identify(replace(measured, poses=same))
    assert any('still differ by' in line for line in done.warnings)
