# SPDX-License-Identifier: Apache-2.0
"""Every pose has one outcome in the end, whatever happens to it."""

from __future__ import annotations

import numpy as np
from hypothesis import given, strategies as st

from calib_capture.measuring.pose_queue import NO_ANSWER, PoseQueue
from calib_capture.program import PlannedPose, Program, SpherePlan
from calib_model.pairing import Reason, Refusal, SteadyPose

NEAR = 1e-3  # rad
STEPS = ('command', 'take', 'refuse', 'retry', 'no way', 'take back', 'give up', 'excuse')


def program(count: int, spares: int) -> Program:
    def pose(i: int) -> PlannedPose:
        return PlannedPose(2, 5, np.full(6, 0.1 * i), np.zeros(3))

    poses = tuple(pose(i) for i in range(count))
    return Program((SpherePlan(2, 5, poses, tuple(pose(-1 - i) for i in range(spares)), count, 0),))


def do(queue: PoseQueue, step: str, which: int) -> None:
    if step == 'command' and queue.next is not None:
        queue.command_next()
    elif step == 'no way' and queue.next is not None:
        queue.refuse_next(step)
    elif step == 'take back':
        queue.take_back_open()
    elif step == 'give up':
        queue.give_up_open()
    elif step == 'excuse':
        queue.excuse_open()
    elif queue.waiting:
        joints = queue.open[which % queue.waiting].joints
        attempt = queue.stopped_at(joints + NEAR / 2, NEAR)
        assert attempt is not None
        if step == 'take':
            queue.accept(attempt, SteadyPose(1, joints, np.zeros(3), 3))
        else:
            reason = Reason.NO_READINGS if step == 'retry' else Reason.OVER_TRAVEL
            queue.refuse(attempt, Refusal(1, joints, reason))


@given(
    st.integers(1, 5),
    st.integers(0, 3),
    st.lists(st.tuples(st.sampled_from(STEPS), st.integers(0, 9)), max_size=40),
)
def test_poses_are_neither_lost_nor_doubled(count, spares, steps):
    queue = PoseQueue(program(count, spares), attempts=2)
    for step, which in steps:
        do(queue, step, which)
        tally = queue.tally
        assert len(queue.todo) + queue.waiting == tally.planned - tally.done == tally.left
        assert (len(queue.taken), len(queue.refused)) == (tally.taken, sum(tally.refused.values()))
        tried = [*queue.todo, *queue.open, *queue.refused, *(each.planned for each in queue.taken)]
        assert len({id(pose) for pose in tried}) == len(tried) == count + tally.replaced
        assert queue.done == bool(queue.locations.ended)


def test_a_stop_passes_by_what_was_commanded_before_it():
    queue = PoseQueue(program(3, 0), attempts=1)
    for _ in range(3):
        queue.command_next()
    assert queue.stopped_at(np.full(6, 9.0), NEAR) is None
    attempt = queue.stopped_at(queue.open[1].joints, NEAR)
    assert attempt is not None and attempt.pose is not queue.refused[0]
    assert queue.tally.refused == {NO_ANSWER: 1}
    assert queue.waiting == 1
