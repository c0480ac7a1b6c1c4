# SPDX-License-Identifier: Apache-2.0
"""A second publisher on a topic: joint states that jump to and fro between two places."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, largest_steps
from calib_model.errors import DataError
from calib_model.stamps import SECOND

FAR = 0.01  # rad to and fro between neighbours
FAST = 1.0  # rad/s
BACK = 0.2  # of the way there that is left after the way back
MOST = 0.02  # of the messages that may do so
NEARLY_ALL = 0.9


def rival(stamp: NDArray[np.int64], joints: Array) -> NDArray[np.bool_]:
    """Which of the joint states (M, n), rad, at stamps (M,), ns, in order, come from somebody who
    says the same all the time, as a simulation that was left running does, while another moves.

    Raises:
        DataError: two publishers that both move: nobody knows which is the arm.
    """
    nobody = np.zeros(len(stamp), dtype=np.bool_)
    if len(stamp) < 3:
        return nobody
    far, left = largest_steps(joints), largest_steps(joints, 2)
    fast = far[:-1] * SECOND > FAST * np.diff(stamp)[:-1]
    to_and_fro = (far[:-1] > FAR) & (left < BACK * far[:-1]) & fast
    count = int(to_and_fro.sum())
    if count <= MOST * len(stamp):
        return nobody
    middle = np.flatnonzero(to_and_fro) + 1
    places, numbers = np.unique(joints[np.append(middle, middle - 1)], axis=0, return_counts=True)
    still: NDArray[np.bool_] = (joints == places[numbers.argmax()]).all(axis=1)
    if (still[middle] | still[middle - 1]).mean() > NEARLY_ALL and not still.all():
        return still
    raise DataError(
        f'the joints jump to and fro between two places {count} times in {len(stamp)} messages: '
        'two publishers on one topic? Record the arm alone'
    )
