# SPDX-License-Identifier: Apache-2.0
"""The hand-guided FARO Sterling, on few poses."""

from pathlib import Path

import numpy as np
import pytest

from calib_model.bags import decode, read_measurement, read_messages, stamp_of
from calib_model.errors import DataError
from calib_model.kinematics import points
from calib_model.topics import DISPLACEMENTS, JOINT_STATE, JOINT_STATES, PROBE_DISPLACEMENTS
from selfcenter_probe.commands import hand_guided
from selfcenter_probe.operator import (
    LIFT,
    LIMIT_MARGIN,
    TICK,
    HandGuided,
    MotionSettings,
    Scene,
    guided,
    probing_set,
    read_scene,
)
from selfcenter_probe.simulation import parse_magnitudes

SOURCE = Path(__file__).resolve().parents[3]
CONFIG = SOURCE / 'calib_bringup' / 'config'
WORLD = SOURCE / 'selfcenter_probe' / 'config' / 'world_faro.yaml'
PROBES = {
    'passive': CONFIG / 'probes' / 'passive_seat_faro.yaml',
    'active': CONFIG / 'probes' / 'active_trihedron_faro.yaml',
}
FILES = {
    'arm': CONFIG / 'arms' / 'faro_sterling.yaml',
    'gauge': CONFIG / 'gauges' / 'ball_bar_1500.yaml',
    'placements': CONFIG / 'locations' / 'faro.yaml',
    'world': WORLD,
}
ELBOW = 3  # joint 4 hinges the forearm on the upper arm
pytestmark = pytest.mark.timeout(60)


def faro(kind):
    return read_scene(str(PROBES[kind]), FILES)


def led(scene, locations=(1, 3), spheres=(1, 10, 14), poses=40, seed=1):
    world = scene.world(seed)
    sides = {number: scene.placements[number] for number in locations}
    motion = guided(world, sides, spheres, MotionSettings(poses, seed=seed))
    return HandGuided(world, motion, seed)


@pytest.fixture(scope='module', params=['passive', 'active'])
def kind(request):
    return request.param


@pytest.fixture(scope='module')
def scene(kind) -> Scene:
    return faro(kind)


@pytest.fixture(scope='module')
def hand(scene):
    return led(scene)


@pytest.fixture(scope='module')
def taken(hand):
    return [(seating, hand.poses_of(i)) for i, seating in enumerate(hand.motion.seatings)]


def miss(world, poses):
    """How far each pose's sphere (N, 3) seems from where it is, by the true arm and probe."""
    centers = world.probe.centers(poses.displacement, world.sphere_diameter)
    p_flange = world.probe.flange_T_probe.apply(centers)
    number = {
        (int(k), int(s)): p
        for k, s, p in zip(world.location, world.sphere, world.p_base_sphere, strict=True)
    }
    there = [number[int(k), int(s)] for k, s in zip(poses.location, poses.sphere, strict=True)]
    return points(world.arm, poses.joints, p_flange) - np.array(there)


@pytest.mark.slow
def test_without_noise_and_force_every_pose_has_the_sphere_where_it_is(kind):
    magnitudes = parse_magnitudes(WORLD.read_text()).without_noise()
    told = faro(kind)
    exact = led(Scene(told.arm, told.probe, told.gauge, told.placements, magnitudes))
    taken = [(s, exact.poses_of(i)) for i, s in enumerate(exact.motion.seatings)]
    assert np.abs(miss(exact.world, probing_set(taken))).max() < 1e-10


@pytest.mark.slow
def test_forces_and_noise_move_the_sphere_by_what_a_measuring_arm_is_off(hand, taken):
    off = np.linalg.norm(miss(hand.world, probing_set(taken)), axis=1)
    assert 2e-5 < np.median(off) < 5e-4
    assert off.max() < 2e-3


@pytest.mark.slow
def test_a_seat_that_is_pressed_yields_downwards_and_more_than_styli():
    mean = {}
    for kind in PROBES:
        led_hand = led(faro(kind), locations=(1,))
        taken = [(s, led_hand.poses_of(i)) for i, s in enumerate(led_hand.motion.seatings)]
        mean[kind] = miss(led_hand.world, probing_set(taken)).mean(axis=0)
    assert mean['passive'][2] < -5e-5
    assert abs(mean['passive'][2]) > 2 * np.abs(mean['passive'][:2]).max()
    assert mean['passive'][2] < mean['active'][2] - 3e-5


def test_every_sphere_in_reach_gets_its_share_and_the_others_are_named(hand):
    motion = hand.motion
    assert motion.absent == ((3, 14),)
    counts = {}
    for seating in motion.seatings:
        place = seating.location, seating.sphere
        counts[place] = counts.get(place, 0) + seating.poses
    assert set(counts.values()) == {48}  # 6 spheres asked for, 5 in reach
    assert motion.poses == 6 * 40


@pytest.mark.slow
def test_the_true_arm_stays_within_its_limits(hand):
    for seating in hand.motion.seatings:
        stamps = np.arange(seating.begin, seating.end + 1, TICK)
        q, _ = hand.true_joints(seating, stamps)
        assert hand.world.arm.within_limits(q, LIMIT_MARGIN / 2).all()


def test_the_hand_moves_smoothly_while_it_holds_a_sphere(hand):
    seating = max(hand.motion.seatings, key=lambda s: s.poses)
    stamps = np.arange(seating.begin, seating.end + 1, TICK)
    q, _ = hand.true_joints(seating, stamps)
    speed = np.diff(q, axis=0) / 0.004
    assert 0.1 < np.abs(speed).max() < 3
    assert np.abs(np.diff(speed, axis=0)).max() < 0.1 * np.abs(speed).max()


def test_each_sphere_is_probed_from_both_sides_of_the_elbow(hand, taken):
    zero = hand.world.arm.geometry[3, ELBOW]
    bent = {}
    for seating, read in taken:
        sign = np.sign(np.sin(read.joints[:, ELBOW] - zero))
        bent.setdefault((seating.location, seating.sphere), set()).update(sign.tolist())
    both = [place for place, signs in bent.items() if {-1.0, 1.0} <= signs]
    assert len(both) >= 4


def test_a_spheres_motion_does_not_depend_on_what_else_is_measured(scene, hand):
    alone = led(scene, locations=(3,), spheres=(10,))
    ours = [s for s in hand.motion.seatings if (s.location, s.sphere) == (3, 10)]
    for one, other in zip(alone.motion.seatings, ours, strict=True):
        assert np.array_equal(one.way.c, other.way.c)
        assert one.level == other.level


@pytest.mark.slow
def test_the_same_seed_gives_the_same_poses_and_another_one_others(scene, taken):
    again, other = led(scene), led(scene, seed=2)
    assert np.array_equal(again.poses_of(3).joints, taken[3][1].joints)
    assert np.array_equal(again.poses_of(3).contact.displacement, taken[3][1].contact.displacement)
    assert not np.allclose(other.poses_of(3).joints[:3], taken[3][1].joints[:3], atol=1e-3)


def test_a_gauge_out_of_reach_is_refused(scene):
    with pytest.raises(DataError, match='none of the 1 spheres is within reach'):
        led(scene, locations=(3,), spheres=(14,))


@pytest.mark.slow
def test_raw_streams_go_on_without_gaps_and_hold_every_pose(hand, taken):
    stamps, joints, read, displacement, status = [], [], [], [], []
    for stretch in hand.raw():
        stamps.append(stretch.stamp)
        joints.append(stretch.joints)
        read.append(stretch.readings.stamp)
        displacement.append(stretch.readings.displacement)
        status.append(stretch.readings.status)
    stamp, joint = np.concatenate(stamps), np.concatenate(joints)
    read_stamp, values = np.concatenate(read), np.concatenate(displacement)
    assert (np.diff(stamp) == TICK).all()
    assert (np.diff(read_stamp) == TICK // 2).all()
    for _, pose in taken:
        rows = np.searchsorted(stamp, pose.stamp)
        assert np.array_equal(joint[rows], pose.joints)
        rows = np.searchsorted(read_stamp, pose.stamp)
        assert np.array_equal(values[rows], pose.contact.displacement)
    lifted = (np.concatenate(status) != 0).any(axis=1)
    assert lifted.sum() == (len(taken) - 1) * (LIFT // (TICK // 2) - 1)
    assert np.abs(np.diff(joint, axis=0)).max() < 0.05  # 12 rad/s, through the air, too


def command(monkeypatch, kind, out, *given):
    files = [word for name, path in FILES.items() for word in (f'--{name}', str(path))]
    line = ['hand_guided', str(out), '--probe', str(PROBES[kind]), *files, *given]
    monkeypatch.setattr('sys.argv', line)
    return hand_guided.main()


def test_one_command_makes_a_bag(monkeypatch, capsys, tmp_path, kind):
    given = ('--locations', '4', '--spheres', '6', '14', '--poses', '25', '--seed', '3')
    assert command(monkeypatch, kind, tmp_path / 'bag', *given) == 0
    printed = capsys.readouterr().out
    assert 'location 4: sphere 14 is out of reach' in printed
    measured = read_measurement(tmp_path / 'bag')
    assert len(measured.poses) == 50
    assert set(measured.poses.sphere.tolist()) == {6}
    assert measured.probe.kind == kind
    assert command(monkeypatch, kind, tmp_path / 'bag', *given) == 2
    assert 'exists already' in capsys.readouterr().err


@pytest.mark.slow
def test_a_raw_bag_holds_both_streams_in_time_order(monkeypatch, tmp_path, kind):
    given = ('--locations', '1', '--spheres', '1', '--poses', '30', '--speed', '5')
    assert command(monkeypatch, kind, tmp_path / 'plain', *given) == 0
    assert command(monkeypatch, kind, tmp_path / 'raw', *given, '--raw') == 0
    plain, raw = read_measurement(tmp_path / 'plain'), read_measurement(tmp_path / 'raw')
    assert np.array_equal(plain.poses.joints, raw.poses.joints)
    assert np.array_equal(plain.poses.displacement, raw.poses.displacement)
    messages = list(read_messages(tmp_path / 'raw'))
    times = [message.log_time for message in messages]
    assert times == sorted(times)
    by_stamp = {
        stamp_of(state): state.position
        for state in (decode(JOINT_STATE, m.data) for m in messages if m.topic == JOINT_STATES.name)
    }
    for stamp, joints in zip(raw.poses.stamp.tolist(), raw.poses.joints, strict=True):
        assert np.array_equal(by_stamp[stamp], joints)
    readings = [m for m in messages if m.topic == PROBE_DISPLACEMENTS.name]
    assert len(readings) == 2 * len(by_stamp) - 1
    assert decode(DISPLACEMENTS, readings[0].data).header.frame_id == raw.probe.name


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        (('--locations', '9'), '--locations: there is no 9'),
        (('--spheres', '16'), '--spheres: there is no 16'),
        (('--spheres', '1', '1'), 'twice'),
        (('--poses', '1'), '--poses'),
        (('--speed', '0'), '--speed'),
        (('--seed', '-1'), '--seed'),
        (('--probe', 'nowhere.yaml'), 'nowhere.yaml: cannot be read'),
    ],
)
def test_what_makes_no_sense_is_one_line_and_exit_code_2(
    monkeypatch, capsys, tmp_path, given, said
):
    assert command(monkeypatch, 'passive', tmp_path / 'bag', *given) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count('\n') == 1
    assert not (tmp_path / 'bag').exists()


def test_a_probe_where_the_hand_is_has_no_axis(scene):
    magnitudes = parse_magnitudes('{}')
    probe = scene.probe.mounted(type(scene.probe.flange_T_probe)())
    bare = Scene(scene.arm, probe, scene.gauge, scene.placements, magnitudes)
    with pytest.raises(DataError, match='where the hand is'):
        led(bare)
