# SPDX-License-Identifier: Apache-2.0
"""The prior's strength is chosen by what was left out, and the choice is one to be glad of."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import kr5, passive, simulate

from calib_model.errors import DataError
from calib_model.kinematics import DEFAULT_SIGMA
from calib_solver.calibration import Calibration, summary_text
from calib_solver.fitting.options import Options
from calib_solver.fitting.prior import (
    CANDIDATES,
    DEFAULT_STRENGTH,
    Prior,
    chosen_prior,
    parse_prior,
)
from calib_solver.identification import identify
from calib_solver.problem import Problem, take_groups
from calib_solver.results import result_record

pytestmark = pytest.mark.timeout(60)
AUTO = Options(prior=chosen_prior('auto'))


def errors_by_strength(scene):
    """The error on unseen postures (m) of every candidate."""
    found = []
    for strength in CANDIDATES:
        done = identify(scene.measured, Options(prior=Prior(DEFAULT_SIGMA, strength)))
        found.append(scene.prediction_error(done.arm, done.probe))
    return found


@pytest.mark.slow
def test_few_noisy_poses_and_large_errors_both_get_a_strength_that_suits_them():
    noisy = simulate(kr5(), passive(), 60, locations=4, poses=3, noise=1e-3)
    far_off = simulate(kr5(), passive(), 60, locations=4, poses=6, noise=2e-4, errors=10)
    for scene in (noisy, far_off):
        done = identify(scene.measured, AUTO)
        in_hindsight = errors_by_strength(scene)
        error = scene.prediction_error(done.arm, done.probe)
        assert error <= 1.2 * min(in_hindsight)
        assert error < 0.3 * max(in_hindsight)


@pytest.mark.slow
def test_an_arm_within_its_tolerances_gets_a_stronger_prior_than_one_far_out():
    scenes = [
        simulate(kr5(), passive(), 65, locations=6, poses=3, noise=1e-3, errors=errors)
        for errors in (0.2, 10.0)
    ]
    close, far_off = (identify(scene.measured, AUTO).options.prior.strength for scene in scenes)
    assert close > far_off


def test_what_was_tried_is_told(tmp_path):
    measured = simulate(kr5(), passive(), 66, locations=3, poses=5, noise=2e-4).measured
    done = identify(measured, AUTO)
    record = result_record(done)
    told = record['diagnostics']['prior']
    assert told['strength'] == done.options.prior.strength in CANDIDATES
    assert told['cross_validation']['left_out'] == 'locations'
    assert told['cross_validation']['folds'] == 3
    tried = told['cross_validation']['tried']
    assert [one['strength'] for one in tried] == list(CANDIDATES)
    assert min(one['behind'] for one in tried) == 0.0
    assert all(one['score'] > 0 for one in tried)
    json.dumps(record, allow_nan=False)
    text = summary_text(Calibration(done, None, record, ()))
    assert f'prior of strength {told["strength"]:g}, chosen by leaving out locations' in text


def test_a_prior_that_was_given_tells_its_strength_alone():
    measured = simulate(kr5(), passive(), 66, locations=2, poses=5, noise=2e-4).measured
    told = result_record(identify(measured))['diagnostics']['prior']
    assert told == {'strength': DEFAULT_STRENGTH, 'cross_validation': None}


@pytest.mark.slow
def test_one_location_is_judged_over_its_spheres():
    scene = simulate(kr5(), passive(), 60, locations=1, poses=8, noise=1e-3)
    done = identify(scene.measured, AUTO)
    assert done.cross_validation.left_out == 'spheres'
    assert done.cross_validation.folds == 4
    error = scene.prediction_error(done.arm, done.probe)
    assert error <= 1.2 * min(errors_by_strength(scene))


def test_more_than_ten_locations_are_left_out_several_at_a_time():
    scene = simulate(kr5(), passive(), 67, locations=12, spheres=(1, 14), poses=4, noise=2e-4)
    assert identify(scene.measured, AUTO).cross_validation.folds == 10


def test_a_single_sphere_cannot_choose():
    measured = simulate(kr5(), passive(), 68, locations=1, spheres=(6,), poses=20).measured
    with pytest.raises(DataError, match='one sphere only, expected two locations or two spheres'):
        identify(measured, AUTO)


def test_an_objective_that_nothing_is_left_of_cannot_choose():
    measured = simulate(kr5(), passive(), 69, locations=1, spheres=(1, 14), poses=12).measured
    distances = replace(AUTO, objective='distance')
    with pytest.raises(DataError, match='objective distance has no terms once a part'):
        identify(measured, distances)


def test_auto_is_a_choice_on_the_command_line_and_in_a_file():
    assert chosen_prior('auto') == Prior(DEFAULT_SIGMA, candidates=CANDIDATES)
    prior = parse_prior('strength: auto\nsigma: {a: 0.001}\n')
    assert prior.candidates == CANDIDATES
    assert prior.sigma['a'] == 0.001


def test_groups_of_spheres_keep_their_poses_distances_and_placements():
    measured = simulate(kr5(), passive(), 70, locations=3, poses=4).measured
    problem = Problem.of(measured, {(2, 6): 1})
    first, second, third = problem.locations
    part = take_groups(problem, [third, second, third])
    assert part.keys[:, 0].tolist() == [1] * 4 + [2] * 4 + [3] * 4
    assert len(part.pairs) == 6 + 3 + 6
    np.testing.assert_array_equal(part.joints[:16], part.joints[-16:])
    np.testing.assert_array_equal(part.order[:16], problem.order[problem.start[8] :])
    for pairs, nominal in ((part.pairs, part.nominal), (problem.pairs, problem.nominal)):
        keys = part.keys if pairs is part.pairs else problem.keys
        expected = [measured.gauge.distance(*keys[pair, 1]) for pair in pairs]
        np.testing.assert_allclose(nominal, expected, rtol=1e-15)
    whole = take_groups(problem, [first, second, third])
    for name in ('start', 'joints', 'cosine', 'sine', 'centers', 'placement', 'pairs'):
        np.testing.assert_array_equal(getattr(whole, name), getattr(problem, name))
