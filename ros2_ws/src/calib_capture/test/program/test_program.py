# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from calib_capture.motion import FreePaths, travel_time
from calib_capture.program.candidates import NO_FREE_WAY, Candidate
from calib_capture.program.planner import Planner
from calib_capture.program.program import ProgramError, ProgramSettings
from calib_capture.program.visiting_order import VisitingOrder
from calib_model.errors import DataError
from calib_model.instruments import PassiveProbe
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import RigidTransform

pytestmark = pytest.mark.timeout(60)
SETTINGS = ProgramSettings(pool=1)


@pytest.fixture(scope='module')
def program(kr5, probe, gauge, placements):
    return Planner(kr5, probe, gauge, SETTINGS).program(placements)


@pytest.fixture(scope='module')
def joints(program):
    return np.array([pose.joints for pose in program.poses])


@pytest.mark.slow
def test_every_chosen_sphere_of_every_location_gets_all_its_poses(program, placements):
    planned = {(plan.location, plan.sphere): len(plan.poses) for plan in program.spheres}
    wanted = {(at, sphere) for at in placements for sphere in (1, 6, 10, 14)}
    assert planned == dict.fromkeys(wanted, SETTINGS.poses_per_sphere)
    assert len(program.poses) == len(placements) * 4 * 60


@pytest.mark.slow
def test_fourteen_spheres_of_the_test_location_are_within_reach(kr5, probe, gauge, placements):
    settings = replace(SETTINGS, spheres=tuple(range(1, 15)))
    program = Planner(kr5, probe, gauge, settings).program(placements, [8])
    assert all(len(plan.poses) == 60 for plan in program.spheres)


@pytest.mark.slow
def test_a_third_of_the_cap_at_least_around_a_sphere_is_within_reach(program):
    for plan in program.spheres:
        assert plan.unreachable <= 0.65 * plan.orientations, plan


@pytest.mark.slow
def test_poses_keep_off_the_joint_limits(program, joints, kr5):
    assert kr5.within_limits(joints, SETTINGS.limit_margin - 1e-9).all()


@pytest.mark.slow
def test_poses_bring_the_sphere_to_its_place_in_the_probe(
    program, joints, kr5, probe, gauge, placements
):
    T_base_probe = forward_kinematics(kr5, joints) @ probe.flange_T_probe.matrix()
    for pose, T in zip(program.poses, T_base_probe, strict=True):
        expected = placements[pose.location].apply(gauge.center(pose.sphere))
        assert np.abs(T[:3, :3] @ pose.p_probe_sphere + T[:3, 3] - expected).max() < 1e-9


@pytest.mark.slow
def test_spheres_are_probed_from_the_cap_around_the_gauge_s_z(program, joints, kr5, placements):
    for pose, T in zip(program.poses, forward_kinematics(kr5, joints), strict=True):
        outward = -T[:3, 2]  # the probe is mounted along the flange's z
        z_gauge = placements[pose.location].rotation[:, 2]
        assert outward @ z_gauge >= np.cos(SETTINGS.cap) - 1e-9


@pytest.mark.slow
def test_offsets_stay_within_the_stroke_and_turn_all_ways(program, probe, gauge):
    p_probe = np.array([pose.p_probe_sphere for pose in program.poses])
    length = np.linalg.norm(p_probe, axis=1)
    assert (length >= 0.0010 - 1e-9).all()
    assert (length <= 0.0015 + 1e-9).all()
    displacement = probe.displacements(p_probe, gauge.sphere_diameter)
    assert probe.within_stroke(displacement).all()
    for plan in program.spheres:
        spread = np.linalg.svd(np.array([p.p_probe_sphere for p in plan.poses]))[1]
        assert spread[2] > 0.3 * spread[0]


@pytest.mark.slow
def test_orientations_and_branches_are_many(program):
    for plan in program.spheres:
        seats = {tuple(np.round(pose.p_probe_sphere, 9)) for pose in plan.poses}
        assert 8 <= len(seats) < len(plan.poses) / 2


@pytest.mark.slow
def test_the_order_is_far_shorter_than_a_random_one(program, joints, kr5):
    def travel(q):
        return sum(travel_time(a, b[None], kr5.velocity)[0] for a, b in zip(q, q[1:], strict=False))

    shuffled = joints.reshape(-1, 60, 6)[:, np.random.default_rng(0).permutation(60)]
    assert travel(joints) < 0.5 * travel(shuffled.reshape(-1, 6))


@pytest.mark.slow
def test_the_same_seed_gives_the_same_program_and_another_seed_another(
    kr5, probe, gauge, placements
):
    def joints_of(seed):
        settings = replace(SETTINGS, seed=seed, poses_per_sphere=20)
        program = Planner(kr5, probe, gauge, settings).program(placements, [1])
        return np.array([pose.joints for pose in program.poses])

    assert np.array_equal(joints_of(1), joints_of(1))
    assert not np.array_equal(joints_of(1), joints_of(2))


def test_seven_joints_are_swept(iiwa14, probe, gauge):
    settings = replace(SETTINGS, spheres=(1, 6), poses_per_sphere=40)
    place = {1: RigidTransform(np.array([0.5, -0.2, 0.3]), np.array([0.0, 0.0, 1.2]))}
    program = Planner(iiwa14, probe, gauge, settings).program(place)
    joints = np.array([pose.joints for pose in program.poses])
    assert len(joints) == 80
    assert len(set(joints[:, 2].round(6))) >= 15
    T_base_probe = forward_kinematics(iiwa14, joints) @ probe.flange_T_probe.matrix()
    seats = np.array([pose.p_probe_sphere for pose in program.poses])
    centers = np.einsum('nij,nj->ni', T_base_probe[:, :3, :3], seats) + T_base_probe[:, :3, 3]
    assert np.abs(centers[:40] - place[1].apply(gauge.center(1))).max() < 1e-9


def test_a_passive_probe_is_seated_without_offset(kr5, gauge, placements):
    seat = np.array([0.0, 0.0, 0.01])
    passive = PassiveProbe('seat', RigidTransform(np.array([0.0, 0.0, 0.1])), seat)
    settings = replace(SETTINGS, poses_per_sphere=10)
    program = Planner(kr5, passive, gauge, settings).program(placements, [1])
    assert all(np.array_equal(pose.p_probe_sphere, seat) for pose in program.poses)


def test_what_cannot_be_planned_is_refused_with_a_line(kr5, probe, gauge, placements):
    planner = Planner(kr5, probe, gauge, SETTINGS)
    with pytest.raises(ProgramError, match='location 9 has no place'):
        planner.program(placements, [9])
    far = {1: RigidTransform(np.array([3.0, 0.0, 0.0]))}
    with pytest.raises(ProgramError, match='none of the chosen spheres can be reached'):
        planner.program(far)
    with pytest.raises(DataError, match='no sphere 99'):
        Planner(kr5, probe, gauge, replace(SETTINGS, spheres=(99,))).program(placements, [1])
    with pytest.raises(ProgramError, match='beyond its stroke'):
        Planner(kr5, probe, gauge, replace(SETTINGS, offset=(0.001, 0.004)))


def test_a_gauge_in_millimetres_is_named_before_anything_is_planned(kr5, probe, gauge):
    long = tuple((number, tuple(1e3 * np.array(center))) for number, center in gauge.spheres)
    for wrong, said in (
        (replace(gauge, spheres=long), 'm apart, where'),
        (replace(gauge, sphere_diameter=22.0), 'spheres of 22 m diameter'),
    ):
        with pytest.raises(ProgramError, match=said) as refused:
            Planner(kr5, probe, wrong, ProgramSettings())
        assert 'is it in mm?' in str(refused.value)


def test_a_sphere_out_of_reach_is_named_and_the_others_are_planned(kr5, probe, gauge):
    half_out = {1: RigidTransform(np.array([0.5, 0.0, 0.4]), np.zeros(3))}
    settings = replace(SETTINGS, poses_per_sphere=10)
    program = Planner(kr5, probe, gauge, settings).program(half_out)
    assert (1, 14) in program.unreached
    assert {pose.sphere for pose in program.poses} >= {1}


def test_locations_are_well_distributed(placements, gauge):
    places = placements.values()
    ends = np.array([[place.apply(gauge.center(n)) for n in (1, 15)] for place in places])
    middle, along = ends.mean(axis=1), np.diff(ends, axis=1)[:, 0] / 0.56
    assert (np.ptp(middle, axis=0) > 0.4).all()
    assert np.linalg.eigvalsh(along.T @ along / len(along))[0] > 0.15  # bars point every way
    assert ends[:, :, 2].min() > 0.05


def test_spheres_of_different_locations_stay_apart(placements, gauge):
    certified = np.array([center for _, center in gauge.spheres])
    centers = [place.apply(certified) for place in placements.values()]
    for one, other in combinations(centers, 2):
        assert np.linalg.norm(one[:, None] - other[None], axis=2).min() >= 0.025


def test_everything_is_visited_once_the_nearer_turn_of_it_first():
    none = np.empty((0, 1))
    choices = [np.array([[3.0], [-3.2]]), np.array([[1.0]]), np.array([[-5.0]])]
    items = [Candidate(postures, none, np.zeros(3)) for postures in choices]

    def order(start):
        visits = VisitingOrder(np.ones(1), None, np.array([start])).visit(items)
        return [(visit.item, visit.which) for visit in visits]

    assert order(0.0) == [(1, 0), (0, 0), (2, 0)]
    assert order(-1.0) == [(1, 0), (0, 0), (2, 0)]
    assert order(-2.0) == [(0, 1), (2, 0), (1, 0)]


@pytest.mark.slow
def test_a_pose_with_no_free_way_is_left_out_and_told(kr5, probe, gauge, placements, monkeypatch):
    settings = replace(SETTINGS, poses_per_sphere=4, pool=1)
    whole = Planner(kr5, probe, gauge, settings).program(placements, [1])
    banned = whole.poses[2].approach[0]
    free = FreePaths.free

    def walled(ways, start, goal, seated=False):
        # full turns apart is the same place; ways are looked for from both ends
        turned = np.abs(np.sin((np.array([start, goal]) - banned) / 2)).max(axis=1)
        return (seated or turned.min() > 1e-9) and free(ways, start, goal, seated)

    monkeypatch.setattr(FreePaths, 'free', walled)
    left = Planner(kr5, probe, gauge, settings).program(placements, [1])
    assert len(left.poses) == len(whole.poses) - 1
    assert left.spheres[0].reasons[NO_FREE_WAY] == 1
    assert all(not np.array_equal(pose.approach[0], banned) for pose in left.poses)
