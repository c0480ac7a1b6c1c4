# SPDX-License-Identifier: Apache-2.0
"""A calibration judged by what is left out of it: against fits that really leave it out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm
from simulated_calibration import active, kr5, passive, simulate
from simulated_joint_errors import off_by, true_errors

from calib_solver.fitting import USUAL_PRIOR, Options
from calib_solver.identification import identify
from calib_solver.left_out import FoldError, LeftOut, Prediction, growth, left_out_warnings
from calib_solver.problem import Problem
from calib_solver.quality import assess

pytestmark = pytest.mark.timeout(60)
PLAIN = Options(prior=USUAL_PRIOR, joint_errors=(), loss='plain')


def taken(measured, which):
    return replace(measured, poses=measured.poses.take(which))


@pytest.mark.parametrize('objective', ['distance_repeatability', 'position'])
@pytest.mark.parametrize('probe', [active, passive])
def test_it_is_what_fits_without_each_location_give(probe, objective):
    measured = simulate(kr5(), probe(), 9, locations=5, poses=12, noise=2e-5).measured
    options = replace(PLAIN, objective=objective)
    done = identify(measured, options)
    position, distance = [], []
    for location in np.unique(measured.poses.location):
        here = measured.poses.location == location
        rest = identify(taken(measured, ~here), options)
        judged = assess(Problem.of(taken(measured, here)), rest.arm, rest.probe)
        position.append(judged.position)
        distance.append(judged.distance)
    for found, really in ((done.left_out.position, position), (done.left_out.distance, distance)):
        errors = np.concatenate(really)
        assert found.count == len(errors)
        assert found.rms == pytest.approx(np.sqrt(np.mean(errors**2)), rel=0.05)
    assert (done.left_out.by, done.left_out.folds) == ('location', 5)


@pytest.mark.slow
def test_what_is_stated_is_what_is_seen_where_the_model_holds():
    ratios = []
    for seed in range(8):
        measured = simulate(kr5(), active(), 60 + seed, locations=5, poses=10, noise=2e-5).measured
        left_out = identify(measured).left_out
        assert left_out.factor == 1
        ratios.append(left_out.position.rms / left_out.position.stated)
    assert 0.85 < np.sqrt(np.mean(np.square(ratios))) < 1.15


@pytest.mark.slow
def test_what_the_model_does_not_say_enlarges_what_is_stated_and_is_said():
    exact = simulate(kr5(), active(), 71, locations=6, poses=15)
    scene = off_by(exact, true_errors(('encoder',)))
    done = identify(scene.measured, Options(joint_errors=()))
    assert done.left_out.factor > 1.3
    assert any('locations left out are missed by' in line for line in done.warnings)
    # identified with the arm they are no such thing any more
    mended = identify(scene.measured)
    assert mended.joint_error_choice.accepted == ('encoder',)
    assert mended.left_out.factor == 1
    assert mended.position_uncertainty.max() < done.position_uncertainty.max() / 3


@pytest.mark.parametrize('freedom', [1, 3, 10, 2000])
def test_chance_enlarges_nothing_more_often_than_a_normal_variable_leaves_three_sigma(freedom):
    """With few degrees of freedom, too, where a sum of squares is far from normal."""
    limit = chi2.isf(norm.sf(3.0), freedom)

    def grown(seen):
        return growth([FoldError(seen, 0.6 * freedom, 0.4 * freedom, 10, float(freedom))], 1.0) > 1

    assert not grown(0.98 * limit)
    assert grown(1.03 * limit)


def test_the_line_names_what_was_missed_the_most():
    told = LeftOut('location', 7, Prediction(8e-6, 8e-6, 900), Prediction(9e-6, 3e-6, 30), 3.1)
    [line] = left_out_warnings(told, named=False)
    assert line.startswith('lengths at locations left out are missed by 0.0090 mm where 0.0030 mm')
    [line] = left_out_warnings(replace(told, position=Prediction(4e-5, 8e-6, 900)), named=False)
    assert line.startswith('locations left out are missed by 0.0400 mm where 0.0080 mm')


@pytest.mark.parametrize('spheres', [(6,), (1, 10)])
def test_of_a_single_location_regions_of_postures_are_left_out(spheres):
    scene = simulate(kr5(), active(), 5, 1, spheres, poses=40, noise=2e-5)
    left_out = identify(scene.measured).left_out
    assert (left_out.by, left_out.folds, left_out.distance) == ('posture', 5, None)
    assert left_out.position.count == 40 * len(spheres)
    assert 0.6 < left_out.position.rms / left_out.position.stated < 1.6


@pytest.mark.slow
def test_many_locations_are_left_out_several_at_a_time_and_quick_leaves_all_in():
    measured = simulate(kr5(), active(), 6, locations=12, poses=6, noise=2e-5).measured
    assert identify(measured).left_out.folds == 10
    quick = identify(measured, Options(quick=True))
    assert quick.left_out is None and quick.joint_error_choice is None
    few = taken(measured, np.arange(5))
    assert identify(few).left_out is None
