# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import given, settings, strategies as st

from calib_capture.motion import InterpolatedMotion, Leg, MotionState, motion_limits
from calib_capture.motion.jerk_limited import small_turns

SPEED = 2e-3  # rad/s, of some joint at any time: the arm never seems to stand


@settings(max_examples=25)
@given(
    turns=st.lists(st.floats(3e-4, 2e-2), min_size=6, max_size=6),
    signs=st.lists(st.sampled_from([-1, 1]), min_size=6, max_size=6),
    jerk=st.floats(20.0, 500.0),
)
def test_each_joint_turns_and_comes_back_within_the_limits(kr5, turns, signs, jerk):
    turned, at = np.array(turns) * signs, np.full(6, 0.3)
    limits = motion_limits(kr5, 4.0, jerk)
    table = np.stack([limits.velocity, limits.acceleration, limits.jerk])
    motion = InterpolatedMotion(MotionState.resting(at), small_turns(at, turned, table))
    assert motion.first_fault(limits, kr5.joint_names) is None
    off = motion.positions - at
    assert not off[[0, -1]].any()
    assert np.allclose(np.abs(off).max(axis=0), np.abs(turned), rtol=0.03)
    assert (np.sign(off.sum(axis=0)) == signs).all()


def test_the_arm_does_not_stand_between_the_joints(kr5):
    leg = Leg(np.zeros(6), motion_limits(kr5))
    begin = leg.seconds
    leg.turn(np.full(6, 5e-4))
    trajectory = leg.trajectory()
    assert len(trajectory.seconds) > 40
    between = (trajectory.seconds > begin + 0.05) & (trajectory.seconds < leg.seconds - 0.05)
    speed = np.abs(trajectory.velocities[between]).max(axis=1)
    assert speed.min() > SPEED


def test_without_turns_there_is_no_motion(kr5):
    leg = Leg(np.zeros(6), motion_limits(kr5))
    leg.turn(np.zeros(6))
    assert not leg.moves
