# SPDX-License-Identifier: Apache-2.0
import numpy as np

from selfcenter_probe.simulation.encoders import Repeatability

SIGMA, TRAVEL = 1e-5, 0.05


class Drawn:
    """Repeatability with draws of its own."""

    def __init__(self, seed=0, sigma=SIGMA):
        self._errors, self._generator = Repeatability(sigma, TRAVEL), np.random.default_rng(seed)

    def after(self, q):
        return self._errors.after(q, self._generator)

    def draw(self, postures):
        return self._errors.draw(postures, self._generator)


def test_the_error_stays_while_the_arm_stands():
    error = Drawn()
    q = np.full(6, 0.3)
    first = error.after(q)
    for _ in range(100):
        np.testing.assert_array_equal(error.after(q.copy()), first)


def test_only_joints_that_travel_change_theirs():
    error = Drawn()
    before = error.after(np.zeros(6)).copy()
    after = error.after(np.array([0.5, 0, 0, 0, 0, 0]))
    assert after[0] != before[0]
    np.testing.assert_array_equal(after[1:], before[1:])


def test_the_error_neither_grows_nor_fades_and_is_new_after_a_long_travel():
    error = Drawn()
    path = np.cumsum(np.random.default_rng(1).uniform(0.0, 0.5, (6000, 6)), axis=0)
    errors = np.array([error.after(q) for q in path])
    np.testing.assert_allclose(errors[3000:].std(axis=0), SIGMA, rtol=0.1)
    np.testing.assert_allclose(errors.mean(axis=0), 0, atol=0.1 * SIGMA)
    long = np.array([error.after(i * np.ones(6)) for i in range(4000)])
    lagged = np.corrcoef(long[1:, 0], long[:-1, 0])[0, 1]
    assert abs(lagged) < 0.05


def test_the_error_does_not_jump_on_a_short_way():
    error = Drawn()
    near = error.after(np.zeros(6)).copy()
    step = np.array([error.after(np.full(6, 1e-6 * i)) for i in range(1, 100)])
    assert np.abs(step - near).max() < SIGMA / 2


def test_the_way_there_may_be_cut_into_pieces():
    """The spread after a travel does not depend on how many states report it."""
    travel = np.linspace(0.0, 0.03, 7)
    whole, pieces = [], []
    for seed in range(1500):
        one, many = Drawn(seed), Drawn(seed + 10**6)
        start = one.after(np.zeros(6))[0]
        whole.append(one.after(np.full(6, travel[-1]))[0] - start)
        errors = [many.after(np.full(6, x))[0] for x in travel]
        pieces.append(errors[-1] - errors[0])
    np.testing.assert_allclose(np.std(whole), np.std(pieces), rtol=0.1)


def test_without_noise_there_is_none():
    error = Drawn(sigma=0.0)
    assert not error.after(np.zeros(6)).any()
    assert not error.after(np.ones(6)).any()
    assert not error.draw(np.zeros((5, 6))).any()
