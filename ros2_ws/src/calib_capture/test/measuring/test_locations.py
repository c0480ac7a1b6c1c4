# SPDX-License-Identifier: Apache-2.0
"""One gauge that is carried from location to location, and an arm that waits for it."""

import numpy as np
import pytest

from calib_capture.measuring import MeasuringRun, RunSettings
from calib_capture.measuring.locations import Locations
from calib_capture.measuring.pose_queue import NO_ANSWER
from calib_capture.measuring.pose_ways import NO_FREE_WAY
from calib_capture.program import PlannedPose, Program, SpherePlan
from calib_model.pairing import Reason, Refusal, SteadyPose
from calib_model.stamps import SECOND

pytestmark = pytest.mark.timeout(60)
REST = np.full(6, -0.9)
SETTINGS = RunSettings(batch=5, carried=True)


def pose(location, i, before):
    """At 0.1 i + location rad, come to from 0.02 above it; the way begins at the postures given."""
    here = np.full(6, location + 0.1 * i)
    way = np.array([np.full(6, each) for each in before])
    return PlannedPose(location, 3, here, np.zeros(3), here[None] + 0.02, '', way, 0.02)


def plan(location, before, count=4, spares=1):
    poses = [pose(location, 0, before)]
    poses += [pose(location, i, [location + 0.1 * i - 0.08]) for i in range(1, count)]
    others = tuple(pose(location, -1 - i, [0.0]) for i in range(spares))
    return SpherePlan(location, 3, tuple(poses), others, count, 0)


class Cell:
    """An arm that is wherever it was sent, and a probe that takes or refuses as it is told."""

    def __init__(self, arm, plans, **more):
        self.anew = []

        def way_to(start, to):
            self.anew.append(('to', float(start[0]), to))
            return np.empty((0, 6))

        def way_out(start, location):
            self.anew.append(('out', float(start[0]), location))
            return np.empty((0, 6))

        found = {'way_to': way_to, 'way_out': way_out, **more}
        self.run = MeasuringRun(arm, Program(tuple(plans), rest=REST, **found), SETTINGS, 0.0)
        self.now, self.refused = 0, {}
        self.taken = []
        self.stand(np.zeros(6))

    def stand(self, joints, seconds=1.0):
        self.now += SECOND // 10
        self.run.see(joints, self.now, self.now / SECOND)
        self.now += round(seconds * SECOND)
        self.run.see(joints, self.now, self.now / SECOND)

    def step(self):
        """The next command done, every pose of it answered; the trajectory, or None."""
        trajectory = self.run.next_trajectory(self.now / SECOND)
        if trajectory is None:
            return None
        opened = self.run.poses.open
        self.stand(trajectory.positions[-1])
        for each in opened:
            reason = self.refused.get(round(float(each.joints[0]), 3))
            if reason is None:
                self.taken.append(round(float(each.joints[0]), 3))
                self.run.take(SteadyPose(1, each.joints, np.zeros(3), 3), self.now / SECOND)
            else:
                self.run.take(Refusal(1, each.joints, reason), self.now / SECOND)
        return trajectory

    def until_asked(self):
        """All commands until the arm waits or is done."""
        commands = []
        for _ in range(20):
            if self.run.awaits is not None or self.run.finished:
                break
            commands.append(self.step())
        return [each for each in commands if each is not None]


@pytest.fixture
def cell(kr5):
    return Cell(kr5, (plan(1, [0.0]), plan(2, [1.32, 0.6, REST[0]]), plan(4, [2.32, REST[0]])))


def test_a_location_is_done_with_its_spares_before_the_arm_goes_out_of_the_way_and_waits(cell):
    cell.refused = {1.3: Reason.OVER_TRAVEL, 1.1: Reason.NO_READINGS}
    commands = cell.until_asked()
    # the pose without readings a second time, and the spare of the one beyond the styli
    assert sorted(cell.taken) == [0.9, 1.0, 1.2]
    assert cell.run.awaits == 2
    assert cell.run.out_of_the_way
    assert np.allclose(commands[-1].positions[-1], REST)
    ended = cell.run.locations.ended[0]
    assert not ended.finished
    assert ended.line() == (
        'location 1: not finished: 3 of 4 poses taken, 2 refused (1 over-travel, 1 no probe '
        'readings)'
    )


def test_nothing_is_commanded_while_the_gauge_is_carried_however_long_it_takes(cell):
    cell.until_asked()
    left = cell.run.seconds_left(cell.now / SECOND)
    for _ in range(50):
        cell.stand(REST, 100.0)
        assert cell.run.next_trajectory(cell.now / SECOND) is None
        assert not cell.run.overdue(cell.now / SECOND)
    cell.run.carried(cell.now / SECOND)
    assert cell.run.seconds_left(cell.now / SECOND) == pytest.approx(left)
    cell.run.give_up(cell.now / SECOND + 1)
    assert np.allclose(cell.step().positions[0], REST)


def test_the_arm_goes_out_by_the_program_s_way_and_on_from_where_it_waited(cell):
    out = cell.until_asked()[-1]
    assert 0.6 in np.round(out.positions[:, 0], 9)
    assert not [each for each in cell.anew if each[0] == 'out']
    cell.run.carried(cell.now / SECOND)
    asked = len(cell.anew)
    cell.step()
    assert len(cell.anew) == asked
    # it was moved meanwhile: a way is found from there
    cell.until_asked()
    cell.stand(np.full(6, 0.4))
    cell.run.carried(cell.now / SECOND)
    cell.step()
    where, start, to = cell.anew[-1]
    assert (where, start, to.location) == ('to', pytest.approx(0.4), 4)


def test_the_arm_never_goes_back_to_an_earlier_location_and_ends_when_all_are_done(cell):
    cell.refused = {2.1: Reason.STYLI_UNSTEADY, 2.2: Reason.OVER_TRAVEL}
    visited = []
    while not cell.run.finished:
        cell.until_asked()
        visited.append(cell.run.awaits)
        if cell.run.awaits is not None:
            cell.run.carried(cell.now / SECOND)
    assert visited == [2, 4, None]
    locations = [int(joints + 0.11) for joints in cell.taken]
    assert locations == sorted(locations)
    ends = cell.run.locations.ended
    assert [(each.location, each.taken, each.finished) for each in ends] == [
        (1, 4, True),
        (2, 3, False),
        (4, 4, True),
    ]


def test_a_way_out_is_found_anew_where_the_program_foresaw_another_end(cell):
    cell.refused = {1.3: Reason.OVER_TRAVEL}
    out = cell.until_asked()[-1]
    assert cell.anew[-1] == ('out', pytest.approx(0.92), 1)
    assert np.allclose(out.positions[-1], REST)


def test_without_a_way_out_the_arm_has_left_the_sphere_and_says_it_is_in_the_way(kr5):
    plans = plan(1, [0.0]), plan(2, [0.5])
    cell = Cell(kr5, plans, way_out=lambda start, location: None)
    last = cell.until_asked()[-1]
    assert cell.run.awaits == 2
    assert not cell.run.out_of_the_way
    assert np.allclose(last.positions[-1], 1.32)


def test_an_arm_that_finds_no_way_to_any_pose_leaves_the_sphere_before_the_run_is_over(kr5):
    first, last = plan(1, [0.0], count=5, spares=0), plan(1, [5.0], count=1, spares=0)
    cell = Cell(kr5, (first, last), way_to=lambda start, to: None if to in last.poses else [])
    cell.step()
    trajectory = cell.run.next_trajectory(cell.now / SECOND)
    assert np.allclose(trajectory.positions[-1], 1.42)
    assert cell.run.tally.refused == {NO_FREE_WAY: 1}
    assert not cell.run.finished
    cell.stand(trajectory.positions[-1])
    assert cell.run.next_trajectory(cell.now / SECOND) is None
    assert cell.run.finished


def test_an_arm_that_is_paused_on_its_way_out_goes_there_when_it_may_go_on(cell):
    cell.step()
    trajectory = cell.run.next_trajectory(cell.now / SECOND)
    cell.run.sent(trajectory, cell.now / SECOND)
    cell.stand(np.full(6, 0.8))
    cell.run.pause()
    cell.run.motion.forget()
    cell.stand(np.full(6, 0.8))
    assert cell.run.next_trajectory(cell.now / SECOND) is None
    cell.run.go_on(cell.now / SECOND)
    again = cell.step()
    assert np.allclose(again.positions[[0, -1]], [np.full(6, 0.8), REST])
    assert cell.run.next_trajectory(cell.now / SECOND) is None
    assert cell.run.awaits == 2


def test_what_is_resumed_elsewhere_waits_for_the_gauge_before_anything_moves(kr5):
    program = Program((plan(2, [0.0]),), rest=REST)
    run = MeasuringRun(kr5, program, SETTINGS, 0.0, at=1)
    run.see(np.zeros(6), 0, 0.0)
    run.see(np.zeros(6), SECOND, 1.0)
    assert run.awaits == 2
    assert run.next_trajectory(1.0) is None
    run.carried(7.0)
    run.see(np.zeros(6), 8 * SECOND, 8.0)
    assert run.next_trajectory(8.0) is not None
    assert MeasuringRun(kr5, program, SETTINGS, 0.0, at=2).awaits is None


def test_the_rest_is_planned_anew_while_the_gauge_is_carried(cell):
    cell.until_asked()
    anew = (plan(2, [REST[0]], count=2), plan(4, [REST[0]], count=3))
    cell.run.plan_anew(Program(anew, rest=REST))
    assert cell.run.to_come == (2, 4)
    assert cell.run.tally.planned == 4 + 2 + 3
    cell.run.carried(cell.now / SECOND)
    cell.until_asked()
    assert [each.planned for each in cell.run.locations.ended] == [4, 2]


def test_gauges_that_stand_everywhere_are_not_waited_for(kr5):
    plans = plan(1, [0.0], count=2), plan(2, [1.12], count=2)
    run = MeasuringRun(kr5, Program(plans, rest=REST), RunSettings(batch=5), 0.0)
    run.see(np.zeros(6), 0, 0.0)
    run.see(np.zeros(6), SECOND, 1.0)
    run.next_trajectory(1.0)
    assert run.to_come == ()  # all in one command
    assert run.awaits is None


def test_a_pose_that_a_spare_took_the_place_of_leaves_nothing_unfinished():
    locations = Locations(plan(7, [0.0], count=3).poses)
    locations.refuse(7, 'over-travel', replaced=True)
    for _ in range(3):
        assert not locations.ended
        locations.take(7)
    assert locations.ended[0].finished
    assert locations.ended[0].line() == (
        'location 7: 3 of 3 poses taken, 1 refused (1 over-travel)'
    )
    lost = Locations(plan(8, [0.0], count=1).poses)
    lost.refuse(8, NO_ANSWER, replaced=False)
    assert not lost.ended[0].finished
