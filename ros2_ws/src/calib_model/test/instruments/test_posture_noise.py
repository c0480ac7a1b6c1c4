# SPDX-License-Identifier: Apache-2.0
import numpy as np

from calib_model.instruments import PostureNoise

HERE, THERE = np.array([0.3, -1.2, 0.0]), np.array([0.3, -1.2, 1e-9])


def noise(seed=5):
    return PostureNoise(np.random.default_rng(seed))


def first(generator):
    return generator.standard_normal()


def test_a_posture_draws_the_same_whatever_was_drawn_and_visited_before_it():
    one, other = noise(), noise()
    other.arriving(THERE).standard_normal(1000)
    assert first(one.arriving(HERE)) == first(other.arriving(HERE))


def test_postures_visits_and_seeds_draw_each_for_themselves():
    drawn = noise()
    found = [first(drawn.arriving(each)) for each in (HERE, THERE, HERE, HERE)]
    found.append(first(noise(6).arriving(HERE)))
    assert len(set(found)) == 5


def test_zero_is_zero_from_either_side():
    assert first(noise().arriving(HERE)) == first(noise().arriving(np.array([0.3, -1.2, -0.0])))


def test_visits_scatter_as_one_stream_would():
    drawn = noise()
    values = np.array([drawn.arriving(HERE).standard_normal(3) for _ in range(4000)])
    np.testing.assert_allclose(np.cov(values.T), np.eye(3), atol=0.1)
    np.testing.assert_allclose(values.mean(axis=0), 0.0, atol=0.06)
    assert abs(np.corrcoef(values[1:, 0], values[:-1, 0])[0, 1]) < 0.05
