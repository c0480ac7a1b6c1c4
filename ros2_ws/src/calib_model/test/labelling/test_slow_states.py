# SPDX-License-Identifier: Apache-2.0
"""Joint states of a led arm that come, or are new, too seldom."""

import numpy as np
import pytest

from calib_model.labelling.unlabelled_bag import _slow_states
from calib_model.stamps import SECOND


def states(sent, new, seconds=4.0):
    """An arm on its way, its states sent and made anew so many times a second."""
    when = np.arange(0.0, seconds, 1 / sent)
    made = np.floor(when * new + 1e-9) / new
    joints = np.stack([0.3 * made, np.sin(made), np.cos(0.7 * made)], axis=1)
    return joints, (when * SECOND).astype(np.int64)


@pytest.mark.parametrize(
    ('sent', 'new', 'said'),
    [
        (200.0, 8.0, 'new 8.0 times a second (200 are sent, most of them repeat)'),
        (12.5, 12.5, 'new 12.5 times a second: of an arm'),
    ],
)
def test_their_rate_is_named_with_the_one_that_is_needed(sent, new, said):
    (line,) = _slow_states(*states(sent, new))
    assert said in line and '50 and more are needed' in line


def test_an_arm_that_rests_for_long_and_one_at_a_good_rate_are_not():
    joints, stamp = states(250.0, 250.0)
    still = np.repeat(joints[-1:], 2000, axis=0)
    rested = stamp[-1] + np.arange(1, 2001) * (SECOND // 250)
    whole = np.concatenate([joints, still]), np.concatenate([stamp, rested])
    assert _slow_states(joints, stamp) == _slow_states(*whole) == []
    assert _slow_states(still, rested) == []
    assert _slow_states(*states(100.0, 100.0)) == []
