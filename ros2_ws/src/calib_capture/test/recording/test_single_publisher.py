# SPDX-License-Identifier: Apache-2.0
"""One publisher or several, told by the numbers of their messages."""

from __future__ import annotations

import numpy as np
import pytest

from calib_capture.recording.single_publisher import CLEAR, LATCHED, Origin, Publishers


def judged(numbers, period=0.01):
    publishers = Publishers()
    return publishers, [publishers.see(n, i * period) for i, n in enumerate(numbers)]


def test_one_publisher_is_one_whatever_is_lost():
    rng = np.random.default_rng(1)
    numbers = np.flatnonzero(rng.random(5000) > 0.2)
    publishers, origins = judged(numbers.tolist())
    assert set(origins) == {Origin.ONE}
    assert publishers.lost == numbers[-1] - numbers[0] + 1 - len(numbers) > 900


def test_one_started_anew_is_unsure_for_a_moment_and_one_again():
    _, origins = judged([*range(1000, 1200), *range(1, 300)])
    begin = origins.index(Origin.UNSURE)
    assert begin == 200
    clear = origins.index(Origin.ONE, begin)
    assert clear - begin == round(CLEAR / 0.01)
    assert set(origins[clear:]) == {Origin.ONE}


def test_what_the_one_before_left_behind_is_known_for_as_long_as_descriptions_may_take():
    publishers = Publishers()
    for number, now in ((1, 0.0), (2, 0.1), (1, 3.0)):
        assert publishers.left(now) is None
        publishers.see(number, now)
    assert publishers.left(3.0) == 0.1
    publishers.see(2, 3.1)
    assert publishers.left(3.0 + 0.99 * LATCHED) == 0.1
    assert publishers.left(3.0 + LATCHED) is None


@pytest.mark.parametrize('other', [1, 990, 1000, 50_000])
def test_two_at_a_time_are_several_after_a_few_messages_and_never_one_again(other):
    pairs = zip(range(1001, 1051), range(other, other + 50), strict=True)
    two = [n for pair in pairs for n in pair]
    _, origins = judged([*range(900, 1001), *two])
    assert set(origins[:101]) == {Origin.ONE}
    several = origins.index(Origin.SEVERAL)
    assert several <= 101 + 6
    assert set(origins[several:]) == {Origin.SEVERAL}
    # of the second publisher's messages, one at most is taken for the first's
    assert Origin.ONE not in origins[103:]


def test_a_slow_second_publisher_is_found_too():
    numbers = [n for i in range(40) for n in (*range(1000 + 25 * i, 1025 + 25 * i), i)]
    publishers, _ = judged(numbers, period=0.02)
    assert publishers.origin is Origin.SEVERAL


def test_messages_of_other_joints_from_the_same_publisher_are_not_lost():
    publishers = Publishers()
    for number in range(1, 100):
        if number % 2:
            publishers.see(number, number * 0.01)
        else:
            publishers.pass_by(number)
    assert publishers.lost == 0
    publishers.pass_by(7)  # of another publisher
    assert publishers.see(101, 2.0) is Origin.ONE
    assert publishers.lost == 1


def test_a_middleware_without_numbers_leaves_it_at_one():
    assert set(judged([None] * 50)[1]) == {Origin.ONE}
