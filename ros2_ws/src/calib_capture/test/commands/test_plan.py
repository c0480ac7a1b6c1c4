# SPDX-License-Identifier: Apache-2.0
import re
import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from calib_capture.commands import plan
from calib_capture.measuring import MeasuringRun, RunSettings, TakenPose
from calib_capture.measuring.commanded_motion import LEAD
from calib_capture.motion import InverseKinematics
from calib_capture.nodes.messages import marker_array
from calib_capture.program import (
    Planner,
    ProgramSettings,
    branch_names,
    program_text,
    shortfall,
)
from calib_capture.showing import outcome_markers, program_markers
from calib_model.kinematics import forward_kinematics
from calib_model.pairing import SteadyPose
from calib_model.stamps import SECOND
from calib_model.transforms import RigidTransform

pytestmark = pytest.mark.timeout(60)
#: a bar of which only the near end is within reach
HALF_OUT = RigidTransform(np.array([0.5, 0.0, 0.4]), np.zeros(3))


@pytest.fixture(scope='module')
def places(placements):
    return {1: placements[1], 2: placements[2], 3: HALF_OUT}


@pytest.fixture(scope='module')
def program(kr5, probe, gauge, places):
    settings = ProgramSettings(poses_per_sphere=12)
    return Planner(kr5, probe, gauge, settings).program(places)


@pytest.mark.slow
def test_the_text_counts_every_pose_and_every_refusal(program):
    lines = program_text(program)
    assert lines[0] == f'{len(program.poses)} poses of 12 spheres at 3 locations'
    header = lines[2].split()
    branches = header[3:-4]
    for line, sphere in zip(lines[3:], program.spheres, strict=False):
        cells = line.split()
        counts = Counter(pose.branch for pose in sphere.poses)
        expected = [sphere.location, sphere.sphere, len(sphere.poses)]
        expected += [counts[branch] for branch in branches]
        expected += [len(sphere.spares), sphere.orientations, sum(sphere.refused.values())]
        assert [int(cell) for cell in cells[: len(expected)]] == expected
    refused = Counter()
    for sphere in program.spheres:
        refused.update(sphere.reasons)
    for reason, count in refused.items():
        line = next(line for line in lines if line.startswith(f'{reason}  '))
        assert int(line.split()[-1]) == count
        assert sum(map(int, line[len(reason) :].split()[:-1])) == count


@pytest.mark.slow
def test_the_text_names_spheres_out_of_reach_and_what_is_to_be_expected(program):
    text = '\n'.join(program_text(program))
    assert (3, 14) in program.unreached
    assert 'location 3: sphere 14 is out of reach' in text
    assert f'after calibration: {program.expected.after * 1e3:.4f} mm' in text


def test_branches_of_one_hand_have_names_of_their_own(kr5, iiwa14):
    for arm in (kr5, iiwa14):
        inverse, generator = InverseKinematics(arm), np.random.default_rng(0)
        most = 0
        for _ in range(30):
            q = generator.uniform(*np.clip(arm.limits, -2.5, 2.5).T)
            branches = inverse.branches(forward_kinematics(arm, q[None])[0], q[2])
            names = branch_names(arm, branches)
            assert len(set(names)) == len(names) == len(branches)
            most = max(most, len(names))
        assert most == 8 or (arm.n == 7 and most >= 4)


@pytest.mark.slow
def test_shapes_show_the_gauge_the_spheres_and_every_pose(program, kr5, probe, gauge, places):
    markers = program_markers(program, kr5, probe, gauge, places)
    assert len({(marker.group, marker.number) for marker in markers}) == len(markers)
    by_name = {(marker.group, marker.number): marker for marker in markers}
    probed, missing = by_name['probed', 1], by_name['out_of_reach', 3]
    expected = [places[1].apply(gauge.center(n)) for n in (1, 6, 10, 14)]
    assert np.abs(probed.points - expected).max() < 1e-12
    assert len(missing.points) == sum(at == 3 for at, _ in program.unreached)
    needles = by_name['poses', 2].points.reshape(-1, 2, 3)
    assert len(needles) == sum(pose.location == 2 for pose in program.poses)
    centers = np.array([places[2].apply(gauge.center(n)) for n in (1, 6, 10, 14)])
    off = np.linalg.norm(needles[:, :1] - centers, axis=2).min(axis=1)
    assert off.max() < 1e-9
    outward = (needles[:, 1] - needles[:, 0]) @ places[2].rotation[:, 2]
    assert (outward >= 0.06 * np.cos(np.radians(70)) - 1e-9).all()


@pytest.mark.slow
def test_every_pose_that_was_taken_or_refused_has_a_needle_at_its_sphere(
    program, kr5, probe, gauge, places
):
    first, second, third = program.poses[0], program.poses[-1], program.spheres[0].spares[0]
    read = probe.displacements(first.p_probe_sphere[None], gauge.sphere_diameter)[0]
    taken = [TakenPose(first, SteadyPose(1, first.joints, read, 5))]
    shown = {
        marker.group: marker
        for marker in outcome_markers(taken, [second, third], kr5, probe, gauge)
    }
    assert {group: len(marker.points) for group, marker in shown.items()} == {
        'taken': 2,
        'refused': 4,
    }
    tips = [*shown['taken'].points[::2], *shown['refused'].points[::2]]
    for pose, tip in zip((first, second, third), tips, strict=True):
        center = places[pose.location].apply(gauge.center(pose.sphere))
        assert np.abs(tip - center).max() < 1e-9
    assert outcome_markers([], [], kr5, probe, gauge) == []
    odd = TakenPose(first, SteadyPose(1, first.joints, np.array([0.4, -0.9, 2.0]), 5))
    assert outcome_markers([odd], [], kr5, probe, gauge)  # a reading of no sphere


def test_shapes_as_messages_replace_those_before(program, kr5, probe, gauge, places):
    markers = program_markers(program, kr5, probe, gauge, places)
    array = marker_array('base_link', markers)
    assert array.markers[0].action == array.markers[0].DELETEALL
    for message, marker in zip(array.markers[1:], markers, strict=True):
        assert (message.ns, message.id) == (marker.group, marker.number)
        assert message.header.frame_id == 'base_link'
        points = [[p.x, p.y, p.z] for p in message.points]
        assert np.array_equal(points, marker.points)
        assert message.color.a > 0
        assert message.scale.x > 0


def test_the_command_prints_the_text(capsys, monkeypatch):
    monkeypatch.setattr('sys.argv', ['plan', '--poses', '4', '--locations', '1', '--pool', '2'])
    assert plan.main() == 0
    printed = capsys.readouterr().out
    assert printed.startswith('16 poses of 4 spheres at 1 location\n')
    assert 'expected standard uncertainty' in printed
    # four spheres of four poses, 0.9 s each at rest and two ways of 30 mm at 0.1 m/s
    told = re.search(r'expected duration of the capture: (\d+) min (\d\d) s', printed)
    seconds = 60 * int(told[1]) + int(told[2])
    assert 16 * 1.5 < seconds < 16 * 10
    slowly = ['--speed', '0.03', '--acceleration', '2']
    monkeypatch.setattr('sys.argv', [*sys.argv, *slowly])
    assert plan.main() == 0
    told = re.search(r'expected duration of the capture: (\d+) min', capsys.readouterr().out)
    assert 60 * int(told[1]) > 2 * seconds


def test_a_program_with_fewer_poses_than_asked_for_says_so_and_why(program):
    asked = len(program.poses) // len(program.spheres)
    assert shortfall(program, asked, standing=True) == ''
    few = shortfall(program, asked + 3, standing=True)
    wanted = len(program.poses) + 3 * len(program.spheres)
    assert few.startswith(f'{len(program.poses)} of the {wanted} poses asked for can be gone to')
    assert 'every bar that stands is in the way' in few
    assert 'no free posture or way' in shortfall(program, asked + 1, standing=False)


def test_a_program_takes_as_long_as_the_commands_that_a_run_sends(kr5, program):
    """Every command that a run makes of it, by an arm that is wherever it was sent."""
    settings = RunSettings(hold=0.3, batch=5, speed=0.5)
    run, seconds, now = MeasuringRun(kr5, program, settings, 0.0), 0.0, SECOND
    here = program.poses[0].approach[0]
    run.see(here, 0, 0.0)
    while not run.finished:
        run.see(here, now, 0.0)
        run.see(here, now + SECOND, 0.0)
        now += 2 * SECOND
        sent = run.next_trajectory(0.0)
        seconds += float(sent.seconds[-1])
        here = sent.positions[-1]
        run.see((here + sent.positions[0]) / 2, now, 0.0)
        while run.current is not None:
            run.take(SteadyPose(1, run.current.joints, np.zeros(3), 3), 0.0)
    commands = -(-len(program.poses) // settings.batch)
    timed = settings.timed(program, kr5)
    assert timed.seconds == pytest.approx(seconds + LEAD * commands, rel=0.02)
    assert timed == program
    assert 'expected duration' not in '\n'.join(program_text(program))
    assert MeasuringRun(kr5, timed, settings, 0.0).seconds_left(1.0) == timed.seconds


@pytest.mark.parametrize(
    ('arguments', 'line'),
    [
        (['--poses', '0'], "--poses: expected a whole number from 1 to 100000, got '0'"),
        (['--locations', '12'], 'location 12 has no place'),
        (['--bodies', 'nowhere.yaml'], 'nowhere.yaml: cannot be read'),
        (['--spheres', '77', '--poses', '1'], 'no sphere 77'),
    ],
)
def test_the_command_refuses_with_one_line(arguments, line, capsys, monkeypatch):
    monkeypatch.setattr('sys.argv', ['plan', *arguments])
    assert plan.main() == 2
    told = capsys.readouterr()
    assert line in told.err
    assert told.err.count('\n') == 1
    assert told.out == ''


def test_a_way_to_come_by_is_given_when_it_is_asked_for(kr5, probe, gauge, places):
    settings = ProgramSettings(poses_per_sphere=3)
    for drive, steps in ((False, 0), (True, 2)):
        planner = Planner(kr5, probe, gauge, replace(settings, drive_approach=drive))
        poses = planner.program(places, [1]).poses
        assert all(pose.approach.shape == (steps, 6) for pose in poses)
