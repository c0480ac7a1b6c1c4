# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from clear_of import placed, smallest_clearance

from calib_capture.motion.bodies import bodies_of
from calib_capture.motion.collision import CollisionCheck
from calib_capture.motion.free_paths import FreePaths
from calib_capture.motion.rrt_connect import rrt_connect
from calib_model.transforms import RigidTransform

pytestmark = pytest.mark.timeout(60)


@pytest.mark.parametrize('which', ['kr5', 'iiwa14'])
def test_nothing_moves_farther_than_the_joints_turns_times_their_reach(
    which, probe, gauge, request
):
    arm = request.getfixturevalue(which)
    bodies = bodies_of(arm, probe, gauge)
    ways = FreePaths(arm, None, bodies, 0.0)
    generator = np.random.default_rng(0)
    start = generator.uniform(-3, 3, (400, arm.n))
    turn = generator.uniform(-0.3, 0.3, (400, arm.n)) * (generator.random((400, arm.n)) < 0.4)
    before, _ = placed(arm, bodies, start, RigidTransform())
    after, _ = placed(arm, bodies, start + turn, RigidTransform())
    far = np.linalg.norm(after - before, axis=-1).max(axis=(1, 2))
    assert (far <= np.abs(turn) @ ways.reach + 1e-12).all()
    assert ways.reach[0] < 2 * ways.reach[1] < 3.0  # a bound that is of use


@pytest.mark.slow
def test_straight_ways_are_free_as_a_fine_search_finds_them(kr5, probe, gauge, placements):
    bodies = bodies_of(kr5, probe, gauge)
    check = CollisionCheck(kr5, bodies)
    check.put_gauge(placements[3], -1)
    ways = FreePaths(kr5, check, bodies, 0.0)
    generator, share = np.random.default_rng(1), np.linspace(0, 1, 300)[:, None]
    counts = {True: 0, False: 0}
    while min(counts.values()) < 8:
        start = generator.uniform(-2, 2, 6)
        goal = start + generator.uniform(-1, 1, 6)
        if not (ways.clear(start) and ways.clear(goal)):
            continue
        free = ways.free(start, goal)
        if counts[free] == 8:
            continue
        gap = smallest_clearance(kr5, bodies, start + share * (goal - start), placements[3], None)
        assert free == ways.free(goal, start)
        if free:
            assert gap.min() > 0
        else:
            assert gap.min() < 2 * bodies.settings.clearance
        counts[free] += 1


def test_a_detour_goes_around_a_wall_and_not_through_a_closed_one():
    def free(start, goal, gate):
        way = start + np.linspace(0, 1, 200)[:, None] * (goal - start)
        return not ((np.abs(way[:, 0]) < 0.1) & (way[:, 1] < gate)).any()

    def found(gate):
        generator = np.random.default_rng(2)
        start, goal = np.array([-1.0, 0.0]), np.array([1.0, 0.0])
        way = rrt_connect(
            start,
            goal,
            lambda a, b: free(a, b, gate),
            lambda: generator.uniform(-2, 2, 2),
            np.ones(2),
        )
        return way if way is None else np.vstack([start, way, goal])

    way = found(1.0)
    assert 3 <= len(way) <= 6  # shortened
    assert all(free(a, b, 1.0) for a, b in zip(way, way[1:], strict=False))
    assert found(9.0) is None


def test_an_arm_leaves_what_it_touches_by_a_joint_and_never_comes_nearer(
    kr5, probe, gauge, placements
):
    bodies = bodies_of(kr5, probe, gauge)
    check = CollisionCheck(kr5, bodies)
    ways = FreePaths(kr5, check, bodies, 0.0)
    generator, left = np.random.default_rng(4), 0
    for number in (2, 5, 6):
        place = placements[number]
        check.put_gauge(place, -1)
        for start in generator.uniform(-1.5, 1.5, (40, 6)):
            free = ways.left(start)
            if ways.clear(start):
                assert np.array_equal(free, start)
            elif free is not None:
                left += 1
                assert np.count_nonzero(free - start) == 1
                along = start + np.linspace(0, 1, 30)[:, None] * (free - start)
                gaps = smallest_clearance(kr5, bodies, along, place, None)
                outside = np.array([check.gap_outside(q, False) for q in along])
                assert gaps[-1] > 0
                assert (np.diff(outside) > -1e-3).all()
    assert left > 5
