# SPDX-License-Identifier: Apache-2.0
import re
from dataclasses import replace

import numpy as np
import pytest
from live_cell import LiveCell, Wrongs

from calib_capture.checking import OK, WRONG, Check

POSTURES = {
    'elbow': np.array([0.31, 1.32, -1.05, 0.42, 0.81, -0.37]),
    'low': np.array([-0.72, 0.95, -0.71, -1.1, 1.2, 0.9]),
}


@pytest.fixture
def checked(kr5, probe, gauge):
    """What a check says of an arm with these wrongs: its lines, and whether something is wrong."""

    def check(posture='elbow', described=None, **wrongs):
        findings = []
        cell = LiveCell(kr5, probe, gauge, POSTURES[posture], Wrongs(**wrongs))
        check = Check(kr5, probe, described or gauge, cell, findings.append)
        check.look(2.0)
        if not check.barred:
            check.move()
        assert check.wrong == any(each.verdict == WRONG for each in findings)
        return [each.line() for each in findings if each.verdict != OK], cell

    return check


@pytest.mark.parametrize('posture', POSTURES)
def test_where_nothing_is_wrong_nothing_is_said_to_be(checked, posture):
    found, cell = checked(posture)
    assert not found
    assert len(cell.moves) == 6
    assert cell._time < 12


@pytest.mark.parametrize(
    ('wrongs', 'said'),
    [
        ({'length': 1e3}, 'unit of styli: .* is its driver in mm\\?'),
        ({'length': 1e6}, 'unit of styli: .* is its driver in um\\?'),
        ({'angle': 180 / np.pi}, 'unit of joints: joint_a. at .* are they in degrees\\?'),
        ({'signs': (1, 1, -1)}, 'mounting: sign of displacement 3: then the sphere stands still'),
        ({'order': (2, 1, 0)}, 'mounting: styli in the order 3 2 1:'),
        ({'flips': 1}, 'mounting: sign of joint_a2:'),
        ({'turn': (0, 0, np.pi / 2)}, 'mounted turned by 90 deg about its z axis'),
        ({'turn': (0, 0, np.pi)}, 'mounted turned by 180 deg about its z axis'),
        ({'signs': (1, -1, 1), 'flips': 2}, 'sign of displacement 2, and sign of joint_a3'),
        (
            {'clock': 0.03},
            'clocks of joints and probe: readings are stamped (29.9|30..) ms too early',
        ),
        (
            {'clock': -0.15},
            'clocks of joints and probe: readings are stamped 1(49.9|50..) ms too la',
        ),
        ({'clock': 2.5}, 'one clock: readings are stamped 2.50. s before'),
        ({'noise': 5e-5}, 'noise of styli: 5'),
        ({'joint_noise': 1e-3}, 'noise of joints: 1'),
        ({'rate': 6.0}, 'rate of joint states: 6 Hz'),
        ({'silence': 0.4}, 'gaps in joint states: 1, the widest of 0.4'),
        ({'stuck': 1}, 'styli: displacement 2 hardly changes'),
        ({'swapped': True}, 'following: joint_a1 .*, joint_a2 did instead'),
        ({'backwards': True}, 'following: joint_a1 turned the other way'),
        ({'unstamped': True}, 'stamps of joint states: zero'),
    ],
)
def test_what_is_wrong_is_named(checked, wrongs, said):
    found, _ = checked('low', **wrongs)
    assert any(re.search(said, line) for line in found), found


def test_spheres_that_the_probe_is_not_made_for_are_named(checked, gauge):
    found, cell = checked(described=replace(gauge, sphere_diameter=0.0381))
    assert len(found) == 1
    assert 'made for spheres of about 22 mm, those of' in found[0]
    assert not cell.moves


def test_two_clocks_do_not_hide_a_sign(checked):
    found, _ = checked(clock=0.02, signs=(-1, 1, 1))
    assert 'sign of displacement 1:' in found[0]
    assert 'too early' in found[1]


@pytest.mark.parametrize('wrongs', [{'joint_noise': 2e-5}, {'noise': 4e-6}, {'rate': 100.0}])
def test_noise_of_usual_encoders_and_slow_streams_are_no_sign(checked, wrongs):
    found, _ = checked(**wrongs)
    assert not any(line.startswith(WRONG) for line in found)


def test_a_sphere_at_the_end_of_a_stroke_is_not_moved_on(checked, monkeypatch):
    monkeypatch.setattr('live_cell.OFFSET', np.array([0.0, 0.0, 4.3e-3]))
    found, cell = checked()
    assert not cell.moves
    assert 'from the end of its stroke: put the sphere into the middle' in found[-1]
