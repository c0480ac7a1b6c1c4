# SPDX-License-Identifier: Apache-2.0
"""Poses of a hand-guided arm: spaced along its way, seated, on spheres that are known."""

import numpy as np
import pytest

from calib_capture.recording.hand_guided_record import HandGuidedRecord, apart
from calib_capture.recording.hand_guided_run import NO_SPHERE, NO_TOUCH, HandGuidedRun
from calib_model.errors import BagError
from calib_model.kinematics import points
from calib_model.labelling import NOWHERE, UNTOUCHED, SphereFinder
from calib_model.pairing import HandGuidedSettings, PairedReading
from calib_model.stamps import SECOND

pytestmark = pytest.mark.timeout(60)
SETTINGS = HandGuidedSettings(spacing=0.1, seated=0.05)


class OneSphere:
    """A finder that takes the first joint for the sphere's row."""

    labels = ((2, 6), (2, 10))

    def rows(self, joints, displacement):
        return np.round(joints[:, 0]).astype(int)


def reading(t, way, row=0, reason=''):
    joints = None if reason else np.array([float(row), way])
    return PairedReading(round(t * SECOND), joints, np.zeros(3), reason)


def contact(begin, end, row=0):
    """1 rad/s for some seconds, at 500 Hz."""
    return [reading(t, t, row) for t in np.arange(begin, end, 0.002)]


def ways(poses):
    return np.array([pose.joints[1] for pose in poses])


def test_poses_lie_spaced_along_the_way_and_clear_of_both_ends_of_a_contact():
    run = HandGuidedRun(OneSphere(), SETTINGS)
    poses = run.take(contact(1.0, 2.0) + [reading(2.0, 0.0, reason='no contact')])
    assert np.diff(ways(poses)) == pytest.approx(0.1, abs=2.1e-3)
    assert ways(poses)[0] == pytest.approx(1.05, abs=2.1e-3)
    assert ways(poses)[-1] <= 2.0 - 0.05
    assert {(pose.location, pose.sphere) for pose in poses} == {(2, 6)}
    assert run.tally.taken == len(poses) == 9
    assert (run.tally.readings, run.tally.paired) == (501, 500)


def test_an_arm_that_rests_gives_one_pose():
    run = HandGuidedRun(OneSphere(), SETTINGS)
    assert len(run.take([reading(t, 0.3) for t in np.arange(0, 2, 0.002)])) == 1


def test_batches_of_readings_make_no_difference():
    whole = contact(1.0, 2.0) + contact(3.0, 3.4, row=1) + contact(3.4, 4.0)
    expected = HandGuidedRun(OneSphere(), SETTINGS).take(whole)
    run, found = HandGuidedRun(OneSphere(), SETTINGS), []
    for begin in range(0, len(whole), 7):
        found += run.take(whole[begin : begin + 7])
    assert [pose.stamp for pose in found] == [pose.stamp for pose in expected]
    assert [pose.sphere for pose in found] == [pose.sphere for pose in expected]


def test_a_touch_too_short_to_be_seated_gives_no_pose():
    run = HandGuidedRun(OneSphere(), SETTINGS)
    assert run.take(contact(1.0, 1.08) + contact(2.0, 2.04) + contact(3.0, 3.01)) == []


def test_every_reading_is_accounted_for():
    run = HandGuidedRun(OneSphere(), SETTINGS)
    run.take([reading(0.1, 0.0, NOWHERE), reading(0.2, 0.0, UNTOUCHED), reading(0.3, 0.0)])
    assert run.tally.refused == {NO_SPHERE: 1, NO_TOUCH: 1}
    assert '3 readings, 1 paired, 2 refused (' in run.tally.line()


def test_the_sphere_is_the_one_whose_nominal_centre_is_near(kr5, probe, gauge, placements):
    """Postures from random joints; the gauge is put where one of its spheres is probed."""
    rng = np.random.default_rng(5)
    q, s = rng.uniform(-0.5, 0.5, (6,)), np.zeros((1, 3))
    p_flange = probe.flange_T_probe.apply(probe.centers(s, gauge.sphere_diameter))
    p_base = points(kr5, q[None], p_flange)[0]
    place = placements[3]
    for off, row in ((0.0, 1), (0.009, 1), (0.011, NOWHERE)):
        moved = type(place)(
            place.translation + p_base - place.apply(gauge.center(10)) + [off, 0, 0],
            place.rotation_vector,
        )
        finder = SphereFinder(kr5, probe, gauge, {3: moved}, (1, 10))
        assert finder.rows(q[None], s).tolist() == [row]
    torn = np.array([[0.0, 0.0, 0.0], [5.0, -5.0, 5.0]])
    assert finder.rows(np.stack([q, q]), torn).tolist() == [NOWHERE, UNTOUCHED]
    assert SphereFinder(kr5, probe, gauge, {}).rows(q[None], s).tolist() == [NOWHERE]


def test_a_note_comes_back_bit_for_bit(placements):
    asked = HandGuidedRecord(
        HandGuidedSettings(0.1 + 0.2, 1 / 3, 0.017, 1e-9), placements, (1, 14), -123
    )
    found = HandGuidedRecord.read(asked.content(), 'bag')
    assert (found.settings, found.spheres, found.shift) == (asked.settings, (1, 14), -123)
    for number, place in placements.items():
        assert np.array_equal(found.placements[number].matrix(), place.matrix())
    assert HandGuidedRecord.read({}, 'bag') is None
    with pytest.raises(BagError, match='bag: calib_capture led: .*spacing'):
        HandGuidedRecord.read({**asked.content(), 'spacing': 'spacing?'}, 'bag')


def test_clocks_that_cannot_agree_are_named():
    assert apart(10 * SECOND, 10 * SECOND + SECOND // 2) == ''
    assert apart(0, 10 * SECOND) == ''
    assert '-3600.0 s from those of joint states' in apart(7200 * SECOND, 3600 * SECOND)
