# SPDX-License-Identifier: Apache-2.0
"""An offset put between the clocks comes out again; streams that cannot tell give none."""

from dataclasses import replace

import numpy as np
import pytest

from calib_capture.commands.pair import pair
from calib_capture.program import Planner, ProgramSettings
from calib_model.bags import BagWriter, cdr, read_measurement, write_descriptions
from calib_model.descriptions import placements_yaml
from calib_model.kinematics import points
from calib_model.pairing import (
    WAITING,
    ClockEstimate,
    JointSample,
    RawStreams,
    Reading,
    SteadySettings,
    estimate_clock_offset,
)
from calib_model.stamps import SECOND
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS

pytestmark = pytest.mark.timeout(60)
T0 = 1_700_000_000 * SECOND


def stamp(seconds):
    return T0 + round(seconds * SECOND)


@pytest.fixture(scope='module')
def postures(kr5, probe, gauge, placements):
    settings = ProgramSettings(spheres=(1, 10), poses_per_sphere=4)
    program = Planner(kr5, probe, gauge, settings).program(placements, [3])
    return [(pose.joints, placements[3].apply(gauge.center(pose.sphere))) for pose in program.poses]


def streams(kr5, probe, gauge, postures, offset, swing=1.2e-2, seed=1):
    """The true arm, off by mm from the nominal, sways around each posture for a second."""
    rng = np.random.default_rng(seed)
    true = replace(
        kr5,
        joints=tuple(
            replace(
                joint,
                a=joint.a + rng.normal(0, 3e-4),
                d=joint.d + rng.normal(0, 3e-4),
                theta_0=joint.theta_0 + rng.normal(0, 5e-4),
            )
            for joint in kr5.joints
        ),
    )
    joints, readings = [], []
    for number, (middle, sphere) in enumerate(postures):
        phase, begin = rng.uniform(0, 6, 6), 3.0 * number

        def at(t, middle=middle, phase=phase, begin=begin):
            return middle + swing * 0.2 * np.sin(6 * (t[:, None] - begin) + phase)

        t = begin + np.arange(0, 1, 1 / 250)
        noisy = at(t) + rng.normal(0, 5e-6, (len(t), 6))
        joints += map(JointSample, map(stamp, t), noisy)
        t = begin + np.arange(0.0013, 1, 1 / 500)
        s = touched(true, probe, gauge, at(t), sphere + points_off(true, kr5, probe, middle))
        noisy = s + rng.normal(0, 2e-6, s.shape)
        readings += [
            Reading(stamp(each - offset), displacement, (0, 0, 0))
            for each, displacement in zip(t, noisy, strict=True)
        ]
    return joints, readings


def points_off(true, nominal, probe, middle):
    """By how much the true arm misses: the gauge stands where it really is probed."""
    p = probe.flange_T_probe.apply(np.zeros((1, 3)))
    return (points(true, middle[None], p) - points(nominal, middle[None], p))[0]


def touched(arm, probe, gauge, joints, p_base):
    """Where the styli are at postures (N, n) on a sphere at `p_base` (3,)."""
    frame = np.vstack([np.zeros(3), np.eye(3)])
    p_flange = probe.flange_T_probe.apply(frame)
    origin, *axes = (points(arm, joints, each[None]) for each in p_flange)
    axes = np.stack([axis - origin for axis in axes], axis=1)
    p_probe = np.einsum('nki,ni->nk', axes, p_base - origin)
    return probe.displacements(p_probe, gauge.sphere_diameter)


@pytest.fixture(scope='module')
def in_step(kr5, probe, gauge, postures):
    """Joints and readings by one clock."""
    return streams(kr5, probe, gauge, postures, 0.0)


def late(in_step, offset):
    """The same with a probe whose clock is `offset` s behind."""
    joints, readings = in_step
    shift = round(offset * SECOND)
    return joints, [each._replace(stamp=each.stamp - shift) for each in readings]


def columns(joints, readings):
    """Both streams as arrays."""
    return RawStreams(
        np.array([each.stamp for each in joints]),
        np.array([each.joints for each in joints]),
        np.array([each.stamp for each in readings]),
        np.array([each.displacement for each in readings]),
        np.array([each.status for each in readings]),
    )


@pytest.mark.parametrize('offset', [0.003, -0.0041, 0.0])
def test_an_injected_offset_is_found_to_a_fifth_of_a_millisecond(
    offset, kr5, probe, gauge, in_step
):
    found = estimate_clock_offset(kr5, probe, gauge, [columns(*late(in_step, offset))])
    assert abs(found.seconds - offset) < 2e-4
    assert found.standard_uncertainty < 2e-4


def fed(estimate, joints, readings):
    for message in sorted([*joints, *readings], key=lambda each: each.stamp):
        if isinstance(message, Reading):
            estimate.see_reading(message)
        else:
            estimate.see_joints(message)
    return estimate


def test_what_is_told_while_it_goes_on_is_what_is_told_of_the_whole(kr5, probe, gauge, in_step):
    joints, readings = late(in_step, 0.003)
    estimate = ClockEstimate(kr5, probe, gauge)
    assert estimate.estimate() is None
    told = []
    for message in sorted([*joints, *readings], key=lambda each: each.stamp):
        if isinstance(message, Reading):
            estimate.see_reading(message)
        else:
            estimate.see_joints(message)
        if len(told) < estimate.chunks - 6:
            told.append(estimate.estimate())
    estimate.finish()
    whole = estimate_clock_offset(kr5, probe, gauge, [columns(joints, readings)])
    assert estimate.estimate().seconds == pytest.approx(whole.seconds, abs=2e-5)
    unasked = fed(ClockEstimate(kr5, probe, gauge), joints, readings)
    unasked.finish()
    assert unasked.estimate() == whole
    assert told
    assert all(each is None or abs(each.seconds - 0.003) < 5e-4 for each in told)


def test_readings_of_another_day_tell_nothing_and_are_not_hoarded(kr5, probe, gauge, in_step):
    joints, readings = late(in_step, 86400.0)
    assert estimate_clock_offset(kr5, probe, gauge, [columns(joints, readings)]) is None
    estimate = ClockEstimate(kr5, probe, gauge)
    for reading in readings:
        estimate.see_reading(reading)
    assert len(estimate._waiting) <= WAITING


def test_an_arm_that_never_moves_in_contact_tells_nothing(kr5, probe, gauge, postures):
    still = streams(kr5, probe, gauge, postures, 0.003, swing=0.0)
    assert estimate_clock_offset(kr5, probe, gauge, [columns(*still)]) is None


def test_streams_without_contact_tell_nothing(kr5, probe, gauge, in_step):
    joints, readings = in_step
    away = [reading._replace(status=(1, 1, 1)) for reading in readings]
    assert estimate_clock_offset(kr5, probe, gauge, [columns(joints, away)]) is None


def test_pair_reports_the_offset_and_corrects_it_when_asked(
    kr5, probe, gauge, placements, in_step, tmp_path
):
    """Streams in motion throughout, taken for stops: the joints are those of the right instant."""
    joints, readings = late(in_step, 0.003)
    with BagWriter(tmp_path / 'raw') as bag:
        write_descriptions(bag, kr5, probe, gauge, T0)
        for each in joints:
            message = cdr.joint_state(each.stamp, 'base', list(kr5.joint_names), each.joints)
            bag.write_message(JOINT_STATES, message, each.stamp)
        for each in readings:
            status = np.array(each.status, dtype=np.uint8)
            message = cdr.displacements(each.stamp, 'probe', each.displacement, status)
            bag.write_message(PROBE_DISPLACEMENTS, message, each.stamp)
    (tmp_path / 'places.yaml').write_text(placements_yaml(placements))
    anything = SteadySettings(settle=0.01, dwell=0.05, max_speed=1.0, max_spread=1.0)
    spread = {}
    for corrected in (False, True):
        out = tmp_path / f'corrected_{corrected}'
        done = pair(tmp_path / 'raw', out, anything, tmp_path / 'places.yaml', corrected)
        assert abs(done.clock.seconds - 0.003) < 2e-4
        poses = read_measurement(out).poses
        at = [(each.stamp - T0) / SECOND for each in joints]
        for shift in (0.0, 0.003):
            t = (poses.stamp - T0) / SECOND + shift
            right = [np.interp(t, at, [each.joints[i] for each in joints]) for i in range(6)]
            spread[corrected, shift] = np.abs(np.transpose(right) - poses.joints).max()
    assert spread[False, 0.0] < 1e-7
    assert spread[True, 0.003] < 2e-6 < spread[False, 0.003]
