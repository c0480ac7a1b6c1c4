# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from calib_model.errors import DataError
from calib_model.measurement import Measurement, ProbingSet, group_by_sphere


def with_pose(measured: Measurement, **columns: np.ndarray) -> Measurement:
    return replace(measured, poses=replace(measured.poses, **columns), source='here')


def test_what_does_not_fit_the_instruments_is_named(measured: Measurement) -> None:
    poses = measured.poses
    joints, reading, sphere = poses.joints.copy(), poses.displacement.copy(), poses.sphere.copy()
    joints[3, 2] = np.nan
    with pytest.raises(DataError, match=r'here: pose 4 \(location 1, sphere 14\) has a joint'):
        with_pose(measured, joints=joints).checked()
    reading[5, 0] = np.inf
    with pytest.raises(DataError, match=r'here: pose 6 \(location 1, sphere 6\) has a reading'):
        with_pose(measured, displacement=reading).checked()
    sphere[39] = 99
    with pytest.raises(DataError, match=r'pose 40 \(location 2, sphere 99\) names a sphere'):
        with_pose(measured, sphere=sphere).checked()
    with pytest.raises(DataError, match='poses have 5 joint positions, the arm .* has 6 joints'):
        with_pose(measured, joints=poses.joints[:, :5]).checked()
    apart = poses.displacement.copy()
    apart[7] = [0.1, -0.1, 0.0]
    with pytest.raises(DataError, match=r'here: .*no sphere .* \(reading 8 of 40\)'):
        with_pose(measured, displacement=apart).checked()
    with pytest.raises(DataError, match='holds no probing poses'):
        replace(measured, poses=poses.take(np.zeros(40, dtype=bool))).checked()


def test_columns_of_different_lengths_are_refused() -> None:
    with pytest.raises(DataError, match='differ in length'):
        ProbingSet.of([1, 1], [1, 1], np.zeros((3, 6)))


def test_a_set_cannot_be_changed_from_outside(measured: Measurement) -> None:
    joints = np.zeros((2, 6))
    poses = ProbingSet.of([1, 1], [1, 6], joints)
    joints[0, 0] = 1.0
    assert poses.joints[0, 0] == 0.0
    with pytest.raises(ValueError, match='read-only'):
        measured.poses.joints[0, 0] = 1.0


def test_parts_joined_are_the_whole(measured: Measurement) -> None:
    poses = measured.poses
    parts = [poses.take(poses.location == 1), poses.take(poses.location == 2)]
    whole = ProbingSet.joined(parts)
    np.testing.assert_array_equal(whole.joints, poses.joints)
    np.testing.assert_array_equal(whole.stamp, poses.stamp)
    with pytest.raises(DataError, match='different numbers of joints'):
        ProbingSet.joined([poses, ProbingSet.of([1], [1], np.zeros((1, 7)))])


def test_poses_are_grouped_by_location_and_sphere() -> None:
    keys, row = group_by_sphere(np.array([2, 1, 2, 1]), np.array([6, 14, 6, 1]))
    assert keys.tolist() == [[1, 1], [1, 14], [2, 6]]
    assert row.tolist() == [2, 1, 2, 0]
