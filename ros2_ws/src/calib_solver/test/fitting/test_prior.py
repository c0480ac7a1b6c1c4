# SPDX-License-Identifier: Apache-2.0
"""What is known beforehand: it holds what few poses do not tell, and bends nothing they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import kr5, passive, simulate

from calib_model.errors import DescriptionError
from calib_model.kinematics import DEFAULT_SIGMA, identifiable_table
from calib_solver.fitting.options import Options
from calib_solver.fitting.prior import (
    DEFAULT_PRIOR,
    NO_PRIOR,
    USUAL_PRIOR,
    Prior,
    chosen_prior,
    parse_prior,
)
from calib_solver.identification import identify

pytestmark = pytest.mark.timeout(60)


@pytest.mark.slow
def test_noise_free_data_are_not_biased_by_a_prior_however_strong():
    scene = simulate(kr5(), passive(), 41, poses=14)
    narrow = {kind: sigma / 30 for kind, sigma in DEFAULT_SIGMA.items()}
    for prior in (USUAL_PRIOR, Prior(DEFAULT_SIGMA, 1000.0), Prior(narrow, 1.0)):
        done = identify(scene.measured, Options(prior=prior))
        assert done.fit.converged
        assert done.identified.phi < 1e-20
        assert scene.prediction_error(done.arm, done.probe) < 1e-9


def offset_and_phi(scene, strength):
    done = identify(scene.measured, Options(prior=Prior(DEFAULT_SIGMA, strength)))
    assert done.fit.converged
    scaled = done.fit.x / done.options.prior.sigmas(done.table)
    return float(np.linalg.norm(scaled)), done.identified.phi


def test_a_stronger_prior_stays_nearer_to_nominal_and_fits_worse():
    scene = simulate(kr5(), passive(), 42, locations=2, poses=6, noise=2e-4)
    found = [offset_and_phi(scene, strength) for strength in (0.0, 1.0, 10.0, 100.0, 1e4)]
    offsets, phis = zip(*found, strict=True)
    assert all(np.diff(offsets) < 0)
    assert all(np.diff(phis) > 0)


def test_a_narrow_sigma_holds_its_kind_and_leaves_the_others():
    scene = simulate(kr5(), passive(), 43, locations=3, poses=8, noise=1e-4)
    held = identify(scene.measured, Options(prior=Prior({**DEFAULT_SIGMA, 'a': 1e-9})))
    free = identify(scene.measured)
    moved = np.abs(held.arm.geometry - scene.measured.arm.geometry)
    moved_free = np.abs(free.arm.geometry - scene.measured.arm.geometry)
    assert moved[0].max() < 1e-7 < 1e-5 < moved_free[0].max()
    assert moved[2].max() > 1e-5


def prediction_error(prior, scenes):
    """The median over several arms of the error on unseen postures."""
    errors = []
    for scene in scenes:
        done = identify(scene.measured, Options(prior=prior, quick=True))
        errors.append(scene.prediction_error(done.arm, done.probe))
    return np.median(errors)


@pytest.mark.slow
def test_with_few_poses_a_prior_predicts_better_than_none():
    scenes = [
        simulate(kr5(), passive(), seed, locations=1, poses=3, noise=1e-3) for seed in range(60, 75)
    ]
    without = prediction_error(NO_PRIOR, scenes)
    assert prediction_error(Prior(DEFAULT_SIGMA, 1.0), scenes) < 0.7 * without
    assert prediction_error(USUAL_PRIOR, scenes) < 0.75 * without


@pytest.mark.slow
def test_with_many_poses_the_default_prior_does_not_hurt():
    scenes = [
        simulate(kr5(), passive(), seed, locations=6, poses=40, noise=1e-4) for seed in range(3)
    ]
    without = prediction_error(NO_PRIOR, scenes)
    assert prediction_error(USUAL_PRIOR, scenes) < 1.1 * without


def test_every_free_parameter_has_a_sigma_and_strength_weighs_them():
    table = identifiable_table(kr5(), passive())
    sigmas = USUAL_PRIOR.sigmas(table)
    assert sigmas.shape == (len(table.free),)
    assert dict(zip([p.name for p in table.free], sigmas, strict=True))['alpha1'] == 1e-3
    np.testing.assert_allclose(Prior(DEFAULT_SIGMA, 3.0).information(table), 3 / sigmas**2)
    assert not NO_PRIOR.information(table).any()


def test_a_file_gives_sigmas_and_strength_and_keeps_the_other_defaults(tmp_path):
    path = tmp_path / 'prior.yaml'
    path.write_text('sigma: {a: 0.001, probe_rotation: 0.05}\nstrength: 2.5\n')
    prior = chosen_prior(str(path))
    assert prior.strength == 2.5
    assert prior.sigma == {**DEFAULT_SIGMA, 'a': 0.001, 'probe_rotation': 0.05}


@pytest.mark.parametrize(
    ('choice', 'expected'),
    [
        ('', DEFAULT_PRIOR),
        ('default', DEFAULT_PRIOR),
        ('auto', DEFAULT_PRIOR),
        ('2', USUAL_PRIOR),
        ('none', NO_PRIOR),
        ('0', NO_PRIOR),
        ('3.5', Prior(DEFAULT_SIGMA, 3.5)),
    ],
)
def test_a_word_or_a_number_is_a_choice_too(choice, expected):
    assert chosen_prior(choice) == expected


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('sigma: {length: 0.1}', r'prior: sigma\.length: unknown kind \(known: a, alpha'),
        ('sigma: {a: 0.0}', r'sigma\.a: expected a standard deviation above zero'),
        ('sigma: {a: -1.0}', r'sigma\.a: expected a standard deviation above zero'),
        ('sigma: {a: .nan}', r'sigma\.a: expected a finite number'),
        ('sigma: {a: wide}', r"sigma\.a: expected a number, got 'wide'"),
        ('sigma: 3', r'sigma: expected a mapping'),
        ('strength: -1', r'strength: expected zero or more'),
        ('strenght: 1', r"unknown key 'strenght': is it 'strength'"),
        ('[1, 2]', r'expected a mapping'),
        ('sigma: {a: 1', r'not valid YAML'),
    ],
)
def test_a_prior_that_cannot_be_used_says_where(text, said):
    with pytest.raises(DescriptionError, match=said):
        parse_prior(text)


@pytest.mark.parametrize('choice', ['-1', 'nan', 'inf', '/no/such/prior.yaml'])
def test_a_choice_that_is_none_is_refused(choice):
    with pytest.raises(DescriptionError, match=choice):
        chosen_prior(choice)


def test_a_given_prior_that_is_in_the_way_is_named_and_not_the_arm():
    """Zeros 6 degrees off against a prior of a hundredth of a degree, held firmly."""
    scene = simulate(kr5(), passive(), 31, locations=3, poses=10, noise=1e-5)
    taken = scene.measured.poses
    off = np.radians(6.0) * np.array([0.0, 1.0, -1.0, 0.5, 1.0, 0.0])
    poses = replace(taken, joints=taken.joints + off)
    measured = replace(scene.measured, poses=poses)
    narrow = {**DEFAULT_SIGMA, 'theta_0': 1e-6}
    held = identify(measured, Options(prior=Prior(narrow, 1e6)))
    assert 'the prior holds the arm away from what the poses say' in held.warnings[0]
    assert not any('not the arm' in line for line in held.warnings)
    by_itself = identify(measured)
    assert by_itself.identified.spread < held.identified.spread / 10
    assert not any('the prior holds' in line for line in by_itself.warnings)
