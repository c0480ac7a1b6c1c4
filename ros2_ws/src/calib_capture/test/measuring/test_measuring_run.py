# SPDX-License-Identifier: Apache-2.0
"""A measuring run against an arm and a probe that are a few lines each."""

import numpy as np
import pytest

from calib_capture.measuring import MeasuringRun, RunError, RunSettings
from calib_capture.measuring.pose_queue import NO_ANSWER
from calib_capture.program import PlannedPose, Program, SpherePlan
from calib_model.pairing import (
    Reason,
    Refusal,
    SteadyPose,
)
from calib_model.stamps import SECOND

pytestmark = pytest.mark.timeout(60)
SETTINGS = RunSettings(batch=3, answer_timeout=1.0, give_up=5.0)


def planned(number, count=7, spares=2):
    """Postures in a row, 0.1 rad apart, sphere `number` of location 1."""

    def pose(i):
        return PlannedPose(1, number, np.full(6, 0.1 * i), np.zeros(3))

    poses = tuple(pose(i) for i in range(1, count + 1))
    return SpherePlan(1, number, poses, tuple(pose(-i) for i in range(1, spares + 1)), count, 0)


HOME = np.zeros(6)


def stand(run, joints=HOME):
    """The arm has stood somewhere for a while."""
    run.see(joints, -SECOND, 0.0)
    run.see(joints, 0, 0.0)


def rests(trajectory):
    """The instants and postures at which the arm is at rest, but for where it begins."""
    still = (trajectory.velocities == 0).all(axis=1)
    return trajectory.seconds[still][1:], trajectory.positions[still][1:]


def stops(trajectory):
    return rests(trajectory)[1]


@pytest.fixture
def program():
    return Program((planned(1),))


@pytest.fixture
def run(kr5, program):
    run = MeasuringRun(kr5, program, SETTINGS, 0.0)
    stand(run)
    return run


def restless(run, step, seconds, rate=250, begin=1.0, pace=1.0):
    """The arm's third joint is `step` rad to and fro, for so many seconds, in which `pace` times as
    many pass for it; asked all the while."""
    for k in range(round(seconds * rate)):
        joints = np.zeros(6)
        joints[2] = step * ((k + 1) % 2)
        now = begin + k / rate
        run.see(joints, round(now * pace * SECOND), now)
        run.refuse_restless(now)
        assert run.next_trajectory(now) is None


def test_an_arm_that_never_comes_to_rest_is_told_by_its_joint(kr5, program):
    run = MeasuringRun(kr5, program, SETTINGS, 0.0)
    with pytest.raises(RunError, match=f'{kr5.joint_names[2]} moves or scatters by 0.0021 rad'):
        restless(run, 2.1e-3, 4.0)


@pytest.mark.parametrize('pace', [0.2, 0.0])
def test_a_slow_simulation_has_its_own_time_to_come_to_rest(kr5, program, pace):
    restless(MeasuringRun(kr5, program, SETTINGS, 0.0), 2.1e-3, 9.0, pace=pace)


def test_time_that_nobody_could_tell_does_not_count_as_restless(kr5, program):
    run = MeasuringRun(kr5, program, SETTINGS, 0.0)
    restless(run, 2.1e-3, 2.4)
    run.excuse()  # the stream was silent
    restless(run, 2.1e-3, 2.4, begin=30.0)
    run.pause()
    run.refuse_restless(40.0)
    run.go_on(41.0)
    restless(run, 2.1e-3, 2.4, begin=41.0)
    run.see(HOME, 50 * SECOND, 50.0)
    run.see(HOME, 51 * SECOND, 51.0)
    assert run.next_trajectory(51.0) is not None


def test_an_arm_comes_and_leaves_by_the_approach_also_from_batch_to_batch(kr5):
    def pose(i):
        way = np.array([[0.1 * i + 0.02] * 6, [0.1 * i + 0.01] * 6])
        return PlannedPose(1, 1, np.full(6, 0.1 * i), np.zeros(3), way)

    poses = tuple(pose(i) for i in range(1, 5))
    program = Program((SpherePlan(1, 1, poses, (), 4, 0),))
    run = MeasuringRun(kr5, program, RunSettings(batch=2), 0.0)
    stand(run)
    first = run.next_trajectory(0.0)
    assert stops(first)[:, 0] == pytest.approx(
        [0.12, 0.11, 0.1, 0.1, 0.11, 0.12, 0.22, 0.21, 0.2, 0.2]
    )
    assert (np.diff(first.seconds) > 0).all()
    for i in (1, 2):
        run.take(answered(np.full(6, 0.1 * i)), 1.0)
    run.see(np.full(6, 0.2), 0, 1.0)
    run.see(np.full(6, 0.2), 10**9, 1.0)
    second = run.next_trajectory(2.0)
    assert stops(second)[:4, 0] == pytest.approx([0.21, 0.22, 0.32, 0.31])


def test_at_the_first_two_poses_the_joints_turn_a_little_and_back_once_these_were_held(
    kr5, program
):
    run = MeasuringRun(kr5, program, SETTINGS, 0.0, turns=lambda pose: pose.joints * 0.01)
    plain = MeasuringRun(kr5, program, SETTINGS, 0.0)
    stand(run)
    stand(plain)
    turned, straight = run.next_trajectory(0.0), plain.next_trajectory(0.0)
    # it comes, is held, and has turned
    places = np.repeat([0.1, 0.2, 0.3], [3, 3, 2])
    assert stops(turned)[:, 0] == pytest.approx(places)
    assert stops(straight)[:, 0] == pytest.approx(np.repeat([0.1, 0.2, 0.3], 2))
    for place, most in ((0.1, 1e-3), (0.2, 2e-3), (0.3, 0.0)):
        off = turned.positions - place
        assert off[np.abs(off) < 3e-3].max() == pytest.approx(most, rel=0.01)


def test_an_arm_goes_by_the_way_that_was_found_free_or_by_one_found_anew(kr5):
    asked = []

    def way_to(start, pose):
        asked.append((float(start[0]), pose))
        return np.full((1, 6), 0.77) if pose is not poses[2] else None

    def pose(i):
        here, before = np.full((1, 6), 0.1 * i), 0.1 * (i - 1) + 0.01 * (i != 3)
        way = np.array([[before] * 6, [0.5 + 0.1 * i] * 6])
        return PlannedPose(1, 1, here[0], np.zeros(3), here + 0.01, '', way, 0.02)

    poses = tuple(pose(i) for i in range(1, 5))
    program = Program(
        (SpherePlan(1, 1, poses, (), 4, 0),), None, way_to, lambda here, pose: 'arm touches rod'
    )
    run = MeasuringRun(kr5, program, RunSettings(batch=4, approach_speed=0.05), 0.0)
    stand(run)
    first = run.next_trajectory(0.0)
    assert stops(first)[:, 0] == pytest.approx(
        [
            0.77,
            0.11,
            0.1,
            0.1,  # from where the arm stood
            0.11,
            0.7,
            0.21,
            0.2,
            0.2,  # as planned
            0.21,
            0.77,
            0.41,
            0.4,
            0.4,  # the third has no way: on to the fourth
        ]
    )
    assert [pose for _, pose in asked] == [poses[0], poses[2], poses[3]]
    assert [start for start, _ in asked] == pytest.approx([0.0, 0.21, 0.21])
    assert run.tally.refused == {'no free way, arm touches rod where the arm stands': 1}
    times = rests(first)[0]
    assert times[2] - times[1] >= 0.02 / 0.05


def answered(joints):
    return SteadyPose(1, joints, np.zeros(3), 3)


def test_nothing_is_commanded_before_the_arm_has_been_seen(kr5, program):
    run = MeasuringRun(kr5, program, SETTINGS, 0.0)
    assert run.next_trajectory(0.0) is None
    stand(run)
    assert run.next_trajectory(0.0) is not None


def test_the_next_batch_waits_until_the_arm_has_held_the_last_pose(run, program):
    first = run.next_trajectory(0.0)
    assert len(stops(first)) == 6  # three poses, each with its rest
    for i, pose in enumerate(program.poses[:3]):
        assert run.next_trajectory(0.1) is None
        run.see(pose.joints, i * SECOND, 0.1)
    run.see(program.poses[2].joints, 2 * SECOND + SECOND // 50, 0.1)
    assert run.next_trajectory(0.1) is None
    run.see(program.poses[2].joints, 2 * SECOND + round(SETTINGS.hold * SECOND), 0.1)
    assert np.array_equal(stops(run.next_trajectory(0.1))[0], program.poses[3].joints)


def test_a_third_batch_waits_for_outcomes_of_the_first(run, program):
    def hold(pose, stamp):
        run.see(pose.joints, stamp, 0.1)
        run.see(pose.joints, stamp + SECOND, 0.1)

    run.next_trajectory(0.0)
    hold(program.poses[2], SECOND)
    run.next_trajectory(0.1)
    hold(program.poses[5], 3 * SECOND)
    assert run.next_trajectory(0.1) is None
    for pose in program.poses[:3]:
        assert run.take(answered(pose.joints), 0.1).planned is pose
    assert len(stops(run.next_trajectory(0.1))) == 2


def test_trajectories_keep_the_speed_and_hold_every_pose(run, kr5):
    trajectory = run.next_trajectory(0.0)
    assert (np.abs(trajectory.velocities) <= SETTINGS.speed * kr5.velocity * (1 + 1e-9)).all()
    seconds, postures = rests(trajectory)
    assert np.allclose(np.diff(seconds)[::2], SETTINGS.hold)
    assert np.allclose(np.diff(postures, axis=0)[::2], 0)


def test_a_run_ends_when_every_pose_is_taken(run, program):
    for pose in program.poses:
        run.next_trajectory(0.0)
        run.take(answered(pose.joints), 1.0)
    assert run.finished
    assert run.tally.line() == '7 poses taken, 0 refused'
    assert run.seconds_left(1.0) == 0


def test_stops_that_nobody_planned_count_for_nothing(run):
    run.next_trajectory(0.0)
    assert run.take(answered(np.full(6, 0.55)), 0.1) is None
    assert run.tally.done == 0


def test_a_pose_passed_by_without_an_answer_is_tried_once_more(run, program):
    run.next_trajectory(0.0)
    second = program.poses[1]
    assert run.take(answered(second.joints), 0.1).planned is second
    run.take(answered(program.poses[2].joints), 0.1)
    again = run.next_trajectory(0.2)
    assert np.array_equal(stops(again)[0], program.poses[0].joints)
    run.take(answered(program.poses[3].joints), 0.3)
    assert run.tally.refused == {NO_ANSWER: 1}


def test_a_refusal_by_place_is_not_tried_again_but_replaced(run, program):
    run.next_trajectory(0.0)
    run.take(Refusal(1, program.poses[0].joints, Reason.OVER_TRAVEL), 0.1)
    for pose in program.poses[1:3]:
        run.take(answered(pose.joints), 0.1)
    spare = run.next_trajectory(0.2)
    assert np.array_equal(stops(spare)[0], program.spheres[0].spares[0].joints)
    assert run.tally.line() == '2 poses taken, 1 refused (1 over-travel; 1 replaced)'
    assert run.tally.done == 2


def test_without_a_spare_the_sphere_has_one_pose_less(kr5):
    program = Program((planned(1, count=1, spares=0),))
    run = MeasuringRun(kr5, program, SETTINGS, 0.0)
    stand(run)
    run.next_trajectory(0.0)
    run.take(Refusal(1, program.poses[0].joints, Reason.OVER_TRAVEL), 0.1)
    assert run.finished
    assert run.tally.taken == 0


def test_lost_readings_are_tried_once_more(run, program):
    for _ in range(2):
        run.next_trajectory(0.0)
        run.take(Refusal(1, program.poses[0].joints, Reason.NO_READINGS), 0.1)
        for pose in program.poses[1:3]:
            run.take(answered(pose.joints), 0.1)
    assert run.tally.refused == {'no probe readings': 1}


def test_an_arm_that_is_there_already_steps_aside_for_a_new_stop(run, program):
    stand(run, program.poses[0].joints)
    trajectory = run.next_trajectory(0.0)
    aside = np.abs(stops(trajectory)[0] - program.poses[0].joints).max()
    assert SETTINGS.tolerance < aside <= 0.02
    assert np.array_equal(stops(trajectory)[1], program.poses[0].joints)


def test_a_batch_of_a_pose_where_the_arm_stands_is_not_taken_for_done(kr5):
    program = Program((planned(1, count=4, spares=0),))
    run = MeasuringRun(kr5, program, RunSettings(batch=1), 0.0)
    here = program.poses[0].joints
    stand(run, here)
    run.see(here, 10 * SECOND, 0.0)
    run.next_trajectory(0.0)
    run.see(here, 11 * SECOND, 0.1)  # has not set off yet
    assert run.next_trajectory(0.1) is None
    run.see(here + 0.005, 12 * SECOND, 0.2)
    run.see(here, 13 * SECOND, 0.3)
    assert run.next_trajectory(0.3) is None
    run.see(here, 14 * SECOND, 0.4)
    assert run.next_trajectory(0.4) is not None


def test_a_creeping_arm_is_alive_and_not_there(run, program):
    run.next_trajectory(0.0)
    for i in range(100):
        run.see(program.poses[2].joints - 0.05 + 5e-4 * i, i * SECOND // 100, 0.02 * i)
        assert run.next_trajectory(0.02 * i) is None
    assert not run.overdue(2.5)


def test_a_silent_graph_is_given_up_in_time(run):
    run.next_trajectory(0.0)
    assert not run.overdue(0.9)
    run.see(np.full(6, 0.05), 0, 0.9)  # it still moves
    assert not run.overdue(1.5)
    assert run.overdue(2.0)
    with pytest.raises(
        RunError, match='does not follow: it has stopped on the way, joint_a1 stands'
    ):
        run.where.refuse_standstill()
    run.close_batch(2.0)
    run.next_trajectory(2.0)
    with pytest.raises(RunError, match='no pose has been answered for 6 s'):
        run.close_batch(6.0)


@pytest.mark.parametrize(('stops_at', 'stuck'), [(0.04, True), (0.1, False)])
def test_an_arm_that_stops_on_its_way_is_stuck_and_one_that_is_late_at_a_pose_is_not(
    kr5, stops_at, stuck
):
    program = Program((planned(1, count=40, spares=0),))
    run = MeasuringRun(kr5, program, RunSettings(batch=30), 0.0)
    stand(run)
    run.sent(run.next_trajectory(0.0), 0.0)
    told = []
    for i in range(300):  # at a hundredth of the way's speed or less, as an override lets it
        now = i / 100
        run.see(np.full(6, min(0.08 * now, stops_at)), i * SECOND // 100, now)
        told.append(run.stuck(now))
    assert not any(told[:150])
    assert told[-1] == stuck


def test_an_arm_that_has_not_been_heard_since_its_command_is_not_overdue(run):
    trajectory = run.next_trajectory(0.0)
    run.sent(trajectory, 7.0)  # planning may take long where others are busy, too
    assert not run.overdue(60.0)
    run.see(np.full(6, 0.2), 3 * SECOND, 61.0)
    assert not run.overdue(61.5)
    assert run.overdue(63.0)


def test_after_a_batch_was_given_up_the_next_one_waits_for_the_arm_to_rest(run):
    run.next_trajectory(0.0)
    run.see(np.full(6, 0.13), 9 * SECOND, 0.5)
    run.close_batch(2.0)
    for i in range(5):  # it comes late and goes on
        run.see(np.full(6, 0.15 + 0.02 * i), 10 * SECOND + i * SECOND // 10, 2.0 + 0.1 * i)
        assert run.next_trajectory(2.0) is None
    run.see(np.full(6, 0.23), 11 * SECOND, 3.0)
    again = run.next_trajectory(3.0)
    assert np.allclose(again.positions[0], 0.23)


def test_an_attempt_that_was_nobodys_fault_counts_not(run, program):
    run.next_trajectory(0.0)
    for turn in range(5):  # more often than a pose is tried
        run.excuse()
        run.close_batch(0.5 * turn)
        assert run.next_trajectory(0.5 * turn) is not None
    assert not run.tally.refused
    run.close_batch(3.0)
    run.next_trajectory(3.0)
    run.close_batch(4.0)
    assert run.tally.refused[NO_ANSWER] == 3
    with pytest.raises(RunError, match='no pose has been answered for 101 s'):
        run.give_up(101.0)


def test_a_clock_that_is_set_back_does_not_keep_the_arm_waiting(run, program):
    run.next_trajectory(0.0)
    run.see(program.poses[0].joints, 100 * SECOND, 0.1)
    run.see(program.poses[2].joints, 100 * SECOND, 0.1)
    run.see(program.poses[2].joints, 10 * SECOND, 0.1)
    run.see(program.poses[2].joints, 11 * SECOND, 0.1)
    assert run.next_trajectory(0.2) is not None
