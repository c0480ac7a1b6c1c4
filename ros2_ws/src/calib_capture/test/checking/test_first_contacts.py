# SPDX-License-Identifier: Apache-2.0
"""What the first stops and contacts of a capture tell, each by itself."""

import numpy as np
import pytest
from live_cell import LiveCell, Wrongs

from calib_capture.checking import FirstSeconds, small_turns_at
from calib_capture.motion import Leg, motion_limits
from calib_model.kinematics import points
from calib_model.pairing import JointSample, Reading
from calib_model.stamps import SECOND

POSTURE = np.array([-0.4, 0.8, -0.6, 0.5, 0.9, -0.7])
NOTHING, TOUCH, SIDEWAYS = (1, 1, 1), (0, 1, 1), (2, 0, 1)


@pytest.fixture
def said_of(kr5, probe, gauge):
    """What a capture objects to when it has been to one pose, and left it."""

    def said(**wrongs):
        cell = LiveCell(kr5, probe, gauge, POSTURE, Wrongs(**wrongs), seed=11)
        leg = Leg(POSTURE, motion_limits(kr5).share(0.3, 0.85, 0.85))
        leg.rest(0.2)
        leg.turn(small_turns_at(kr5, probe, POSTURE, np.full(3, 1e-3)))
        leg.to(POSTURE + [0.0, 0.04, 0.0, 0.0, 0.0, 0.0])
        cell.follow(leg.trajectory())
        place = points(kr5, POSTURE[None], probe.flange_T_probe.apply(np.zeros((1, 3))))
        first = FirstSeconds(kr5, probe, gauge, place)
        messages = [
            *zip(cell.heard.joints, cell.heard.joint_times, strict=True),
            *zip(cell.heard.readings, cell.heard.reading_times, strict=True),
        ]
        for message, now in sorted(messages, key=lambda each: each[1]):
            first.see(message, now + 7.0)
        return first.objection

    return said


@pytest.mark.parametrize(
    ('wrongs', 'words'),
    [
        ({'order': (0, 2, 1), 'joint_noise': 1e-5}, 'styli in the order 1 3 2: so the readings'),
        ({'turn': (0, 0, np.pi / 2)}, 'the probe is mounted turned by 90 deg about its z axis'),
        ({'flips': 1}, 'sign of joint_a2: so'),
        ({'clock': 0.09}, 'readings are stamped 90 ms too early for the joints'),
        ({'clock': -0.21, 'rate': 100.0}, 'readings are stamped 210 ms too late for the joints'),
        ({'noise': 3e-4}, 'um on a sphere, of a pose they may be 20 um apart'),
        ({'rate': 10.0}, ''),
        ({'joint_noise': 2e-5, 'noise': 5e-6, 'errors': 3.0}, ''),
        ({'jitter': 3e-3, 'rate': 100.0}, ''),
        ({'step': 2 * np.pi / 2**17, 'rate': 100.0}, ''),
    ],
)
def test_one_contact_tells_what_is_wrong_and_what_is_rough_is_not_wrong(said_of, wrongs, words):
    objection = said_of(**wrongs)
    assert words in objection
    assert bool(objection) == bool(words)


@pytest.fixture
def after_poses(kr5, probe, gauge):
    """What a capture objects to after it `saw` those statuses at one pose after the other, the
    sphere touched in the first, as described, `astray` (m) from where it should be."""

    def said(seen, astray=0.0):
        poses = np.array([POSTURE + 0.1 * k for k in range(3)])
        touched = np.full((1, 3), 1e-4)
        center = probe.centers(touched, gauge.sphere_diameter)
        place = points(kr5, poses[:1] + 0.05, probe.flange_T_probe.apply(center))
        first = FirstSeconds(kr5, probe, gauge, place + [0.0, astray, 0.0], poses)
        stamp = 50 * SECOND
        for k, status in enumerate(seen):
            on_the_way = (0, 0, 0) if k == 0 else status
            for there, here in ((poses[k] + 0.05, on_the_way), (poses[k], status)):
                for _ in range(12):
                    stamp += SECOND // 100
                    first.see(JointSample(stamp, there), stamp / SECOND)
                    first.see(Reading(stamp, touched[0], here), stamp / SECOND + 1e-3)
        return first.objection

    return said


@pytest.mark.parametrize(
    ('seen', 'objects'),
    [
        ([NOTHING, NOTHING], True),
        ([SIDEWAYS, NOTHING], True),
        ([NOTHING, TOUCH], False),
        ([SIDEWAYS, TOUCH], False),
        ([TOUCH, NOTHING, NOTHING], False),
        ([NOTHING], False),
    ],
)
def test_two_poses_that_meet_no_sphere_are_enough(after_poses, seen, objects):
    objection = after_poses(seen)
    assert objection.startswith('the first 2 poses met no sphere' if objects else '')
    assert bool(objection) == objects


def test_one_is_enough_after_a_touch_far_from_any_sphere(after_poses):
    objection = after_poses([NOTHING], astray=0.23)
    assert (
        "the first pose met no sphere within the styli's travel, but a touch came 0.23 m"
        in objection
    )
    assert not after_poses([NOTHING], astray=0.02)
    assert not after_poses([TOUCH, NOTHING], astray=0.23)


@pytest.mark.parametrize(('noise', 'objects'), [(4e-5, True), (1e-6, False)])
def test_readings_that_scatter_explain_poses_in_vain(kr5, probe, gauge, noise, objects):
    first, rng = FirstSeconds(kr5, probe, gauge, np.zeros((1, 3))), np.random.default_rng(8)
    for i in range(60):
        stamp = 9 * SECOND + i * SECOND // 100
        first.see(JointSample(stamp, POSTURE), stamp / SECOND)
        reading = Reading(stamp, rng.normal(size=3) * noise, (0, 0, 0))
        first.see(reading, stamp / SECOND + 1e-3)
    first.refused(0, {}, {'styli not steady': 1})
    assert not first.objection
    first.refused(0, {}, {'styli not steady': 2})
    assert ('readings scatter by' in first.objection) == objects
