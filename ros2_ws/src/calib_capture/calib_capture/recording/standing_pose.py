# SPDX-License-Identifier: Apache-2.0
"""The pose at which the arm stands now, from the last moments of both streams."""

from __future__ import annotations

from calib_model.errors import CalibrationError
from calib_model.pairing import (
    JointSample,
    Pairing,
    Reading,
    Reason,
    Refusal,
    SteadyPose,
    SteadySettings,
)
from calib_model.stamps import SECOND


class StandingError(CalibrationError):
    """An arm or a probe that is not steady enough to be taught by."""


def pose_at_rest(
    joints: list[JointSample], readings: list[Reading], settings: SteadySettings
) -> SteadyPose:
    """The readings of the last `settings.dwell` s averaged, both streams in stamps' order.

    Raises:
        StandingError: the arm has not stood still for so long, or the readings are not good; says
            what is wrong.
    """
    if not joints:
        raise StandingError('no joint states from the arm')
    newest = max(sample.stamp for sample in joints)
    if readings:  # the probe's last word may be older than the arm's
        newest = min(newest, max(reading.stamp for reading in readings))
    begin = newest - round(settings.dwell * SECOND)
    # from the last sample before: the window shall lie within the samples
    before = max((each.stamp for each in joints if each.stamp <= begin), default=begin)
    samples = [each for each in joints if each.stamp >= before]
    pairing = Pairing(settings)
    outcomes = [outcome for each in samples for outcome in pairing.add_joints(each)]
    for reading in readings:
        if reading.stamp >= before:
            outcomes += pairing.add_reading(reading)
    outcomes += pairing.finish()
    if len(outcomes) != 1:
        raise StandingError(f'the arm has not stood still for {settings.dwell:g} s')
    outcome = outcomes[0]
    if isinstance(outcome, Refusal):
        raise StandingError(_explained(outcome.reason))
    return outcome


def _explained(reason: Reason) -> str:
    return f'the probe cannot be read here: {reason.value}'
