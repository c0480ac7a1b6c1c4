# SPDX-License-Identifier: Apache-2.0
"""Whether the stamps in a topic's headers tell the time of its messages."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.stamps import SECOND

FEW = 0.4  # of the messages have a stamp of their own, not even where each came twice
OTHERS = 0.1  # of the messages with one stamp that hold something else
BACK = 0.05  # of the steps that go back: no late message and no clock that is set does that
STANDING = 0.01  # of the recorded time in which a clock stands as good as still
Stamps = NDArray[np.int64]


def tell_no_time(stamp: Stamps, logged: Stamps, content: Array) -> str:
    """Why the stamps (N,), ns, of messages that were recorded at `logged` (N,), ns, with values
    `content` (N, k), say nothing of when; '' where they do."""
    count = len(stamp)
    if not count:
        return ''
    if not stamp.any():
        return 'are all 0'
    if count < 3:
        return ''
    step = np.diff(stamp)
    passed, recorded = int(np.ptp(stamp)), int(np.ptp(logged))
    if recorded > SECOND and passed < STANDING * recorded:
        return f'go on by {passed / SECOND:.3g} s in {recorded / SECOND:.3g} s'
    if (step < -SECOND).mean() > BACK:
        return f'jump back {int((step < -SECOND).sum())} times in {count} messages'
    same = step == 0
    other = np.zeros(0, dtype=np.bool_)
    if same.any():
        other = (content[1:][same] != content[:-1][same]).any(axis=1)
    if same.mean() > 1 - FEW and other.mean() > OTHERS:
        return f'are the same for {int(same.sum())} of {count} messages, which differ'
    return ''
