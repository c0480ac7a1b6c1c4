# SPDX-License-Identifier: Apache-2.0
"""Postures for a target that a tracker sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_capture.commands import plan
from calib_capture.motion import BodySettings
from calib_capture.program import ProgramError, TrackerSettings, tracker_program
from calib_capture.program.tracker_points import TargetInformation, postures_csv
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import RigidTransform, rotation_vectors

SETTINGS = TrackerSettings(3e-5, poses=40)


def test_chosen_postures_are_within_limits_and_tell_more_than_the_first_ones(kr5):
    chosen = tracker_program(kr5, SETTINGS)
    first = tracker_program(kr5, replace(SETTINGS, pool=1))
    assert len(chosen.joints) == len(first.joints) == 40
    assert kr5.within_limits(chosen.joints, SETTINGS.limit_margin).all()
    assert chosen.expected < 0.95 * first.expected
    assert {'arm touches floor', 'arm touches itself'} <= set(chosen.refused)


def test_orientations_and_more_or_better_points_make_positions_surer(kr5):
    plain = tracker_program(kr5, SETTINGS).expected
    for surer in (
        replace(SETTINGS, turn_noise=2e-4),
        replace(SETTINGS, poses=120),
        replace(SETTINGS, noise=1e-5),
    ):
        assert tracker_program(kr5, surer).expected < plain


def test_more_targets_in_the_same_postures_make_positions_surer_and_more_stations_less(kr5):
    targets = np.array([[0.0, 0.0, 0.1], [0.12, -0.05, 0.06], [-0.1, 0.02, 0.12]])
    one = tracker_program(kr5, SETTINGS).expected
    three = tracker_program(kr5, replace(SETTINGS, targets=targets))
    assert three.expected < 0.9 * one
    moved = tracker_program(kr5, replace(SETTINGS, targets=targets, stations=4))
    assert moved.expected > three.expected
    assert np.bincount(moved.station).tolist() == [0, 10, 10, 10, 10]
    rows = postures_csv(moved).splitlines()
    assert rows[0] == 'q1,q2,q3,q4,q5,q6,target,station'
    assert len(rows) == 1 + 3 * 40
    assert [row.split(',', 6)[-1] for row in (rows[1], rows[2], rows[-1])] == ['1,1', '2,1', '3,4']
    assert rows[1].split(',')[:6] == rows[3].split(',')[:6]


def test_rows_of_several_targets_and_stations_are_those_of_each_put_together(kr5):
    targets = np.array([[0.0, 0.0, 0.1], [0.12, -0.05, 0.06]])
    settings = replace(SETTINGS, targets=targets, stations=2, turn_noise=1e-4)
    both, joints = TargetInformation(kr5, settings), np.zeros((2, 6))
    joints[1] = 0.3
    rows = both.from_stations(both.rows(joints))
    free = len(both.table.free)
    assert rows.shape == (2, 12, free + 12 + 12)
    for k, at in enumerate(targets):
        alone = TargetInformation(kr5, replace(settings, targets=at[None], stations=1))
        own = rows[:, 6 * k : 6 * k + 6]
        expected = alone.rows(joints)
        first = free + 6 * k
        np.testing.assert_array_equal(own[:, :, :free], expected[:, :, :free])
        np.testing.assert_array_equal(own[:, :, first : first + 6], expected[:, :, free:-6])
        assert not own[:, :, free + 6 * (1 - k) : free + 6 * (2 - k)].any()
        for s in (0, 1):
            np.testing.assert_array_equal(own[s, :, -12 + 6 * s :][:, :6], expected[s, :, -6:])
            assert not own[s, :, -12 + 6 * (1 - s) :][:, :6].any()


def test_an_arm_that_is_walled_in_has_no_postures(kr5):
    low = replace(SETTINGS, bodies=BodySettings(floor=3.0))
    with pytest.raises(ProgramError, match='hardly any posture is free: arm touches floor'):
        tracker_program(kr5, low)


def test_rows_are_how_a_tracker_sees_the_target_move(kr5):
    """By the places, whose columns are put together there; those of parameters are tried in
    calib_model."""
    settings = replace(SETTINGS, noise=1.0, turn_noise=1.0)
    information = TargetInformation(kr5, settings)
    joints = np.random.default_rng(5).uniform(*kr5.ranges.T, (7, 6))
    flange = forward_kinematics(kr5, joints)
    rows = information.rows(joints)[:, :, -12:]

    def seen(target, base):
        """Of the target, moved in the flange, and the base, moved in the tracker's frame."""
        turned = base.rotation @ flange[:, :3, :3]
        at = settings.targets[0] + target.translation
        points = base.apply(flange[:, :3, 3] + np.einsum('nij,j->ni', flange[:, :3, :3], at))
        return points, turned @ target.rotation

    still = RigidTransform()
    points, turned = seen(still, still)
    for column in range(12):
        step = np.zeros(12)
        step[column] = 1e-6
        moved = seen(RigidTransform(step[:3], step[3:6]), RigidTransform(step[6:9], step[9:]))
        turns = rotation_vectors(moved[1] @ np.swapaxes(turned, 1, 2))
        found = np.concatenate([moved[0] - points, turns], axis=1) / 1e-6
        np.testing.assert_allclose(found, rows[:, :, column], atol=2e-6)


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        (['--tracker', '2e-5', '--locations', '1'], '--locations: goes without --tracker'),
        (['--target', '0', '0', '0.1'], '--target: goes with --tracker'),
        (['--stations', '2'], '--stations: goes with --tracker'),
        (['--tracker', '2e-5', '--stations', '9', '--poses', '8'], 'no more than the 8 postures'),
        (['--tracker', '20'], 'expected a number from 1e-09 to 1'),
    ],
)
def test_what_does_not_go_with_a_tracker_is_one_line(given, words, capsys, monkeypatch):
    monkeypatch.setattr('sys.argv', ['plan', *given])
    assert plan.main() == 2
    said = capsys.readouterr()
    assert words in said.err
    assert said.out == ''
