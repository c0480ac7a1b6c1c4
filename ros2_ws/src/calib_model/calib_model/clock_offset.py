# SPDX-License-Identifier: Apache-2.0
"""The offset between the clocks of joint states and probe readings, from motion in contact.

While the arm moves with the sphere in the probe, joints and displacements must tell of one fixed
sphere. Read against the wrong instant of the joints, it seems to move with the arm's velocity.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_model.arm import Arm
from calib_model.gauge import Gauge
from calib_model.kinematics import points
from calib_model.pairing import SECOND, JointSample, Reading
from calib_model.probe import Probe
from calib_model.rotation import Array

FINE = 0.02  # s between joint states up to which the arm's way between them is known
APART = 0.1  # s between readings that belong to one contact
STEP = 8e-3  # s of the central difference: noise of joint states is no velocity
SLOWEST = 2e-3  # m/s that count as motion
FEWEST = 20  # readings in motion that an estimate needs
ROUNDS = 20
LONGEST = 0.05  # s: beyond that it is no offset between clocks
KNOWN_TO = 5e-4  # s of standard uncertainty up to which an estimate is one


@dataclass(frozen=True)
class ClockOffset:
    """`seconds` to be added to a reading's stamp to have it in the joints' clock."""

    seconds: float
    standard_uncertainty: float
    readings: int

    def line(self) -> str:
        """In words."""
        return (
            f'clock offset: readings are {self.seconds * 1e3:+.2f} ms from the joints, '
            f'standard uncertainty {self.standard_uncertainty * 1e3:.2f} ms'
        )


def clock_offset(
    arm: Arm, probe: Probe, gauge: Gauge,
    joints: Sequence[JointSample], readings: Sequence[Reading],
) -> ClockOffset | None:  # fmt: skip
    """The offset, None where the streams do not tell: no motion in contact, or too little.

    Raises:
        ContactError: readings that no sphere of the gauge's diameter gives.
    """
    good = sorted((each for each in readings if not any(each.status)), key=lambda r: r.stamp)
    samples = sorted(joints, key=lambda sample: sample.stamp)
    if len(good) < 3 or len(samples) < 2:
        return None
    origin = samples[0].stamp
    t_joints = np.array([each.stamp - origin for each in samples]) / SECOND
    t_readings = np.array([each.stamp - origin for each in good]) / SECOND
    q = np.array([each.joints for each in samples])
    fine = _finely_known(t_joints, t_readings)
    if fine.sum() < 3:
        return None
    t_readings = t_readings[fine]
    s = np.array([each.displacement for each in good])[fine]
    p_flange = probe.flange_T_probe.apply(probe.centers(s, gauge.sphere_diameter))
    contact = np.concatenate([[0], np.cumsum(np.diff(t_readings) > APART)])

    def seen(offset: float) -> Array:
        """The sphere (N, 3) around its mean in each contact, m."""
        at = t_readings + offset
        posture = np.stack([np.interp(at, t_joints, column) for column in q.T], axis=1)
        return _around_mean(points(arm, posture, p_flange), contact)

    return _solved(seen, len(t_readings), int(contact[-1]) + 1)


def _solved(
    seen: Callable[[float], Array], count: int, contacts: int
) -> ClockOffset | None:
    offset = 0.0
    for _ in range(ROUNDS):
        rate = (seen(offset + STEP) - seen(offset - STEP)) / (2 * STEP)  # m/s
        moving = np.linalg.norm(rate, axis=1) > SLOWEST
        if moving.sum() < FEWEST:
            return None
        rate[~moving] = 0.0
        told, off = float((rate**2).sum()), seen(offset)
        step = -float((rate * off).sum()) / told
        offset += step
        if abs(offset) > LONGEST:
            return None
        if abs(step) < 1e-7:
            break
    left = 3 * (count - contacts) - 1
    if left < 1:
        return None
    uncertainty = float(np.sqrt((seen(offset) ** 2).sum() / left / told))
    if uncertainty > KNOWN_TO:
        return None
    return ClockOffset(offset, uncertainty, count)


def _around_mean(p: Array, contact: Array) -> Array:
    count = np.bincount(contact)[:, None]
    mean = np.stack([np.bincount(contact, column) for column in p.T], axis=1) / count
    around: Array = p - mean[contact]
    return around


def _finely_known(t_joints: Array, t_readings: Array) -> NDArray[np.bool_]:
    """Which readings (N,) fall between joint states close together, with room for an offset."""
    gap = np.diff(t_joints)
    known: NDArray[np.bool_] = np.ones(len(t_readings), dtype=np.bool_)
    for shift in (-FINE, 0.0, FINE):
        place = np.searchsorted(t_joints, t_readings + shift, side='right') - 1
        inside = (place >= 0) & (place < len(gap))
        known = known & inside & (gap[np.clip(place, 0, len(gap) - 1)] <= FINE)
    return known
