# SPDX-License-Identifier: Apache-2.0
"""The order of a stream's messages: which come too late for their place, and where it begins anew.

What live pairing decides message by message is decided here for all messages at once.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from calib_model.stamps import SECOND

STEP_BACK = SECOND  # ns by which stamps fall when a clock was set back or a driver started anew
BEFORE_ALL = np.iinfo(np.int64).min
WINDOW = 256  # messages that are looked at first for a fall
Rows = NDArray[np.int64]


def in_order(stamp: Rows, lateness: float) -> Rows:
    """The rows of stamps (N,), ns, as received, in the order of the stamps, each stamp once.

    A message that comes up to `lateness` (s) late is put in its place; one that comes later, or
    has the stamp of an earlier one, is left out.
    """
    if not len(stamp):
        return np.zeros(0, dtype=np.int64)
    if (stamp[1:] > stamp[:-1]).all():
        return np.arange(len(stamp))
    newest = np.maximum.accumulate(stamp)
    # the message that lets each one pass, itself or a newer one; for the last there is none
    leaves = np.searchsorted(newest, stamp + round(lateness * SECOND))
    leaves = np.maximum(leaves, np.arange(len(stamp)))
    passed: Rows = np.full(len(stamp) + 1, BEFORE_ALL)
    np.maximum.at(passed, leaves, stamp)
    passed = np.maximum.accumulate(passed)
    in_time = np.flatnonzero(np.append(True, stamp[1:] > passed[: len(stamp) - 1]))
    return in_time[np.unique(stamp[in_time], return_index=True)[1]]


def unbroken(stamp: Rows, stream: Rows, step_back: int = STEP_BACK) -> Iterator[slice]:
    """The stretches of messages with stamps (N,), ns, of one or several streams (N,), as received,
    within which no stream falls back by more than `step_back` (ns) behind its newest."""
    begin, window = 0, WINDOW
    while begin < len(stamp):
        part = slice(begin, begin + window)
        fall = _first_fall(stamp[part], stream[part], step_back)
        if fall is None and part.stop < len(stamp):
            window *= 4
            continue
        end = part.stop if fall is None else begin + fall
        yield slice(begin, min(end, len(stamp)))
        begin, window = end, WINDOW


def _first_fall(stamp: Rows, stream: Rows, step_back: int) -> int | None:
    falls = np.zeros(len(stamp), dtype=np.bool_)
    for number in np.unique(stream):
        mine = np.flatnonzero(stream == number)
        falls[mine] = np.maximum.accumulate(stamp[mine]) - stamp[mine] > step_back
    return int(falls.argmax()) if falls.any() else None
