# SPDX-License-Identifier: Apache-2.0
"""The prior's widths are those that the data are most likely with, and no start is a trap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal
from simulated_calibration import GAUGE, Scene, active, iiwa, kr5, passive, simulate

from calib_model.measurement import Measurement, ProbingSet
from calib_model.transforms import RigidTransform
from calib_solver.fitting.evidence import Group, widths
from calib_solver.fitting.objectives import Quadratic
from calib_solver.fitting.options import Options
from calib_solver.fitting.prior import DEFAULT_PRIOR, NO_PRIOR
from calib_solver.identification import identify

pytestmark = pytest.mark.timeout(60)


def linear(seed):
    """Residuals (40,) and slopes (40, 8) of a linear problem with two kinds of parameters, about
    offsets x (8,), and the noise's variance."""
    generator = np.random.default_rng(seed)
    slope = generator.normal(size=(40, 8)) * np.logspace(3, 0, 8)
    group = Group(
        np.array([2e-3, 5e-4] * 4),
        np.array([0, 1] * 4),
        np.zeros(8, dtype=bool),
        np.zeros(2, dtype=bool),
    )
    truth = group.sigma * np.array([3.0, 0.4])[group.kind] * generator.normal(size=8)
    x = 1e-3 * generator.normal(size=8)
    residual = slope @ (x - truth) + 0.01 * generator.normal(size=40)
    return residual, slope, group, x, 1e-4


@pytest.mark.parametrize('seed', range(5))
def test_the_widths_are_those_that_scipy_finds_most_likely(seed):
    residual, slope, group, x, noise = linear(seed)
    measured = residual - slope @ x

    def unlikely(logarithm):
        width = np.exp(logarithm)[group.kind] * group.sigma
        covariance = noise * np.eye(len(measured)) + (slope * width**2) @ slope.T
        seen = multivariate_normal.logpdf(measured, np.zeros(len(measured)), covariance)
        beforehand = -2 * logarithm - np.exp(-2 * logarithm)  # two offsets as large as usual
        return -(seen + beforehand.sum())

    best = np.exp(minimize(unlikely, np.zeros(2), method='Nelder-Mead', tol=1e-9).x)
    quadratic = Quadratic(
        float(residual @ residual), slope.T @ residual, slope.T @ slope, len(residual)
    )
    found = widths(quadratic, x, noise, group, np.full(2, 10.0))
    np.testing.assert_allclose(found.times, best, rtol=0.05)
    assert np.all((found.told >= 0) & (found.told <= 1))


@pytest.mark.parametrize('seed', range(5))
def test_next_to_no_noise_leaves_the_evidence_its_digits(seed):
    """Fewer residuals than parameters, which all but fit: 10 nm beside widths of centimetres."""
    generator = np.random.default_rng(40 + seed)
    sigma, kind = np.full(9, 2e-2), np.array([0, 1, 2] * 3)
    group = Group(sigma, kind, np.zeros(9, dtype=bool), np.ones(3, dtype=bool))
    slope = generator.normal(size=(7, 9)) * np.logspace(0, -2, 9)
    measured = -slope @ (sigma * np.array([1.0, 4.0, 9.0])[kind] * generator.normal(size=9))
    x = -np.linalg.pinv(slope) @ measured
    residual, noise = measured + slope @ x + 1e-10 * generator.normal(size=7), 1e-16
    quadratic = Quadratic(float(residual @ residual), slope.T @ residual, slope.T @ slope, 7.0)
    found = widths(quadratic, x, noise, group, np.full(3, 10.0))
    width = found.times[kind] * sigma
    covariance = noise * np.eye(7) + (slope * width**2) @ slope.T
    expected = multivariate_normal.logpdf(residual - slope @ x, np.zeros(7), covariance)
    constant = -3.5 * np.log(2 * np.pi)
    assert found.evidence + constant == pytest.approx(expected, abs=0.5)


def test_what_is_not_told_at_all_stays_as_usual():
    nothing = Quadratic(1.0, np.zeros(3), np.zeros((3, 3)), 10.0)
    group = Group(
        np.full(3, 1e-3), np.zeros(3, dtype=np.int64), np.zeros(3, bool), np.ones(1, bool)
    )
    found = widths(nothing, np.zeros(3), 0.1, group, np.full(1, 10.0))
    np.testing.assert_allclose(found.times, 1.0, rtol=0.02)


@pytest.mark.parametrize(
    ('rows', 'expected'), [((1, 1, 1), 10.0), ((1, 1, 0), 1.0), ((0, 0, 1), 1.0)]
)
def test_a_kind_that_nothing_tells_is_as_the_others_of_a_dh_row_are(rows, expected):
    """Two kinds of four parameters are told to be ten times as far off as usual."""
    size, kind = np.full(9, 1e-3), np.array([0] * 4 + [1] * 4 + [2])
    slope = np.diag([1e3] * 8 + [0.0])
    truth = 1e-2 * np.array([1.0, -1.0] * 4 + [0.0])
    residual = -slope @ truth
    quadratic = Quadratic(float(residual @ residual), slope.T @ residual, slope.T @ slope, 30.0)
    group = Group(size, kind, np.zeros(9, dtype=bool), np.array(rows, dtype=bool))
    found = widths(quadratic, np.zeros(9), 1e-6, group, np.full(3, 10.0))
    np.testing.assert_allclose(found.times[:2], 10.0, rtol=0.3)
    np.testing.assert_allclose(found.times[2], expected, rtol=0.3)


def zeros_off(seed, degrees, poses):
    """A KR 5 whose zeros are some degrees off, in poses of two locations."""
    scene = simulate(kr5(), passive(), seed, locations=2, poses=poses, noise=1e-5)
    off = np.radians(degrees) * np.random.default_rng(seed).normal(size=kr5().n)
    off[0] = 0.0
    taken = scene.measured.poses
    joints = taken.joints + off
    moved = ProbingSet.of(taken.location, taken.sphere, joints, taken.displacement)
    geometry = scene.true.geometry.copy()
    geometry[3] -= scene.true.direction * off
    measured = Measurement(kr5(), passive(), GAUGE, moved, 'zeros off')
    return Scene(scene.true.with_geometry(geometry), scene.mount, measured)


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(4))
def test_zeros_that_are_degrees_off_are_found_and_said_to_be_far_off(seed):
    scene = zeros_off(seed, 6.0, 8)
    priors = (DEFAULT_PRIOR, NO_PRIOR)
    done, plain = (identify(scene.measured, Options(prior=prior)) for prior in priors)
    assert done.fit.converged
    errors = [scene.prediction_error(one.arm, one.probe) for one in (done, plain)]
    assert errors[0] < 1.2 * errors[1]
    assert done.options.prior.times['theta_0'] > 10
    assert done.options.prior.times['alpha'] < 5


def test_the_probes_mount_is_never_held_wider_than_it_can_be():
    scene = simulate(kr5(), passive(), 3, locations=1, poses=4, noise=1e-4)
    far = RigidTransform(np.array([0.1, -0.1, 0.2]))
    probe = scene.measured.probe.__class__('seat', far, scene.measured.probe.center)
    measured = Measurement(kr5(), probe, GAUGE, scene.measured.poses, 'elsewhere')
    done = identify(measured, Options(prior=DEFAULT_PRIOR))
    width = DEFAULT_PRIOR.sigma['probe_translation'] * done.options.prior.times['probe_translation']
    assert width <= 0.5
    assert scene.prediction_error(done.arm, done.probe) < 5e-3


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(700, 704))
def test_a_straight_bar_tells_in_few_poses_what_its_distances_alone_do_not(seed):
    """Three or five of twelve spheres have two poses, the others one."""
    arm, twice = (kr5(), 3) if seed % 2 == 0 else (iiwa(), 5)
    scene = simulate(arm, active(), seed, locations=3, poses=2, noise=1e-5, errors=8.0)
    poses = scene.measured.poses
    rows = np.arange(len(poses))
    few = replace(scene.measured, poses=poses.take((rows % 2 == 0) | (rows < 2 * twice)))
    options = (Options(quick=True), Options(quick=True, objective='position'))
    done, by_position = (identify(few, each) for each in options)
    errors = [scene.prediction_error(one.arm, one.probe) for one in (done, by_position)]
    assert errors[0] < 1.5 * errors[1]
    assert not done.fit.converged
    assert len(done.fit.history) <= done.fit.iterations


@pytest.mark.slow
@pytest.mark.parametrize('seed', [702, 704])
def test_distances_that_follow_from_others_do_not_make_few_poses_many(seed):
    """Eight spheres in a line have 28 distances, of which seven do not follow from the others."""
    spheres = tuple(range(1, 16, 2))
    scene = simulate(
        kr5(), active(), seed, locations=2, spheres=spheres, poses=2, noise=1e-5, errors=8.0
    )
    rows = np.arange(len(scene.measured.poses))
    few = replace(scene.measured, poses=scene.measured.poses.take((rows % 2 == 0) | (rows < 8)))
    done = identify(few, Options(quick=True))
    assert scene.prediction_error(done.arm, done.probe) < 2e-4
