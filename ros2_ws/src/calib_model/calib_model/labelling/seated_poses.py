# SPDX-License-Identifier: Apache-2.0
"""Poses of an arm whose ball was seated in sockets, without any probe reading: joints alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm, PassiveProbe
from calib_model.kinematics import points
from calib_model.labelling.joint_stops import Postures, single_states, stops, way
from calib_model.labelling.raw_settings import RawSettings
from calib_model.labelling.seated_ball import ball_on_flange, seats
from calib_model.labelling.sphere_clusters import NEAR
from calib_model.measurement import ProbingSet
from calib_model.pairing import HandGuidedSettings, RawStreams, SteadyPose

DWELL = 0.1  # s that a stop lasts at least
SLOW = 0.02  # rad/s: a hand that holds an arm is no brake
PER_STOP = 5.0  # rad of way for every stop: an arm that goes farther may not stop for its poses
FOR_EVERY = 3  # poses on its way for every stop: then it does not


@dataclass(frozen=True)
class SeatedPoses:
    """Poses in time order, where the ball was in each, `p_base` (N, 3), m, and `line`: how they
    were found, in words."""

    poses: tuple[SteadyPose, ...]
    p_base: Array
    line: str


def seated_poses(
    arm: Arm, probe: PassiveProbe, streams: RawStreams, choice: RawSettings
) -> SeatedPoses:
    """Each stop of the arm, or, where it was led without stopping, its way while the ball stays."""
    settings = dict(choice.settings)
    dwell = max(DWELL, settings.get('settle', 0.0) + settings.get('dwell', 0.0))
    stamp, joints = streams.joint_stamp, streams.joints
    postures = stops(stamp, joints, dwell, settings.get('max_speed', SLOW))
    how = f'each stop of {dwell:g} s and more is one'
    single = None if len(postures.stamp) > 1 else single_states(stamp, joints)
    standing = choice.standing
    if single is not None and standing is not False:
        postures, how, standing = single, 'each joint state is one', True
    few = len(postures.stamp)
    if standing is None:
        standing = way(stamp, joints) <= PER_STOP * few
        few *= FOR_EVERY  # an arm that is lifted between its stops goes far as well
    if not standing:
        spacing = HandGuidedSettings().spacing
        rows = seats(arm, _described(probe), stamp, joints, spacing)
        if choice.standing is False or len(rows) > few:
            postures = Postures.of_rows(stamp, joints, rows)
            how = f'the arm was led with the ball seated, one every {spacing:g} rad'
    return _placed(arm, probe, postures, f'poses by the joints alone: {how}')


def recorded_poses(arm: Arm, probe: PassiveProbe, poses: ProbingSet) -> SeatedPoses:
    """The same of poses that were taken one by one."""
    postures = Postures(poses.stamp, poses.joints, poses.readings)
    return _placed(arm, probe, postures, 'poses taken by hand')


def sockets(arm: Arm, probe: PassiveProbe, joints: Array) -> list[int]:
    """Which of the sockets, in the order of their first poses, each posture (N, n) is in."""
    p = points(arm, joints, ball_on_flange(arm, _described(probe), joints))
    centers: list[Array] = []
    found: list[int] = []
    for point in p:
        near = [i for i, center in enumerate(centers) if np.linalg.norm(point - center) <= NEAR]
        if not near:
            centers.append(point)
        found.append(near[0] if near else len(centers) - 1)
    return found


def _placed(arm: Arm, probe: PassiveProbe, postures: Postures, how: str) -> SeatedPoses:
    c = ball_on_flange(arm, _described(probe), postures.joints)
    poses = tuple(
        SteadyPose(int(stamp), frozen(joints), frozen(np.zeros(3)), int(states))
        for stamp, joints, states in zip(
            postures.stamp, postures.joints, postures.states, strict=True
        )
    )
    p_base = points(arm, postures.joints, c) if poses else np.empty((0, 3))
    return SeatedPoses(poses, p_base, f'{len(poses)} {how}')


def _described(probe: PassiveProbe) -> Array:
    """`p_flange_ball` (3,), m, as the description has it."""
    return probe.flange_T_probe.apply(probe.center)
