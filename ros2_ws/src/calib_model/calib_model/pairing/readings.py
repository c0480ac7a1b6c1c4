# SPDX-License-Identifier: Apache-2.0
"""A joint state and a probe reading by themselves, and what speaks against them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array

LARGEST = 1e6  # m or rad: no sensor gives more, and with more products overflow


class Status(Enum):
    """What a stylus says of its own reading; the values of StylusDisplacements."""

    OK = 0
    NO_CONTACT = 1
    OVER_TRAVEL = 2
    WEAK_SIGNAL = 3


class Reason(Enum):
    """Why a stop of the arm gave no pose."""

    NO_CONTACT = 'no contact'
    OVER_TRAVEL = 'over-travel'
    WEAK_SIGNAL = 'weak signal'
    UNKNOWN_STATUS = 'unknown status'
    NO_NUMBER = 'reading is no number'
    STYLI_UNSTEADY = 'styli not steady'
    ARM_UNSTEADY = 'arm not steady long enough'
    NO_READINGS = 'no probe readings'
    JOINTS_MISSING = 'joint states missing'


def reasons_in_words(counts: Mapping[str, int]) -> str:
    """Why so many gave no pose, the most frequent reason first."""
    often = sorted(counts.items(), key=lambda each: -each[1])
    return ', '.join(f'{count} {reason}' for reason, count in often)


class JointSample(NamedTuple):
    """The joints (n,) at a stamp in ns."""

    stamp: int
    joints: Array


class Reading(NamedTuple):
    """Displacements (3,) in m and the status of each stylus, at a stamp in ns."""

    stamp: int
    displacement: Array
    status: tuple[int, int, int]


def usable(values: Array) -> bool:
    """Whether all values, m or rad, are numbers that a sensor may give; of the few of a message or
    of a stop."""
    return all(-LARGEST <= value <= LARGEST for value in values.ravel().tolist())


#: what speaks against a reading by itself, the gravest first
GRAVEST = (
    Reason.OVER_TRAVEL,
    Reason.NO_CONTACT,
    Reason.WEAK_SIGNAL,
    Reason.UNKNOWN_STATUS,
    Reason.NO_NUMBER,
)


def objections(status: NDArray[np.integer], displacement: Array) -> NDArray[np.int64]:
    """What speaks against readings (N, 3) by themselves, as places in `GRAVEST`, the gravest first;
    its length where nothing does."""
    against: NDArray[np.int64] = np.select(
        [
            (status == Status.OVER_TRAVEL.value).any(axis=1),
            (status == Status.NO_CONTACT.value).any(axis=1),
            (status == Status.WEAK_SIGNAL.value).any(axis=1),
            (status != Status.OK.value).any(axis=1),
            ~((displacement <= LARGEST) & (displacement >= -LARGEST)).all(axis=1),
        ],
        list(range(len(GRAVEST))),
        default=len(GRAVEST),
    )
    return against
