# SPDX-License-Identifier: Apache-2.0
"""What was wired, counted or written down wrong is named, or shown to do no harm."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib_model.bags import read_measurement
from calib_model.errors import DataError
from calib_model.kinematics import forward_kinematics
from calib_solver.identification import identify
from calib_solver.problem import Problem
from calib_solver.quality import assess

DEMO = Path(__file__).parents[1] / 'bags' / 'demo'
HALF = 280  # of the bag's 560 poses, 80 a location, 20 a sphere


@cache
def measured():
    return read_measurement(DEMO / 'identification')


def with_joints(change):
    poses = measured().poses
    return replace(measured(), poses=replace(poses, joints=change(np.array(poses.joints))))


def with_readings(change):
    poses = measured().poses
    changed = change(np.array(poses.displacement))
    return replace(measured(), poses=replace(poses, displacement=changed))


def with_centers(change):
    gauge = measured().gauge
    spheres = tuple((n, tuple(change(n, np.array(c)))) for n, c in gauge.spheres)
    return replace(measured(), gauge=replace(gauge, spheres=spheres))


def with_numbers(change):
    poses = measured().poses
    location, sphere = change(np.array(poses.location), np.array(poses.sphere))
    return replace(measured(), poses=replace(poses, location=location, sphere=sphere))


def scaled(column, factor, first=0):
    def change(values):
        values[first:, column] *= factor
        return values

    return change


def shifted(column, step, first=HALF, last=None):
    def change(values):
        values[first:last, column] += step
        return values

    return change


def held_at(column, value, first=0):
    def change(values):
        values[first:, column] = value
        return values

    return change


def exchanged(i, j):
    def change(values):
        values[:, [i, j]] = values[:, [j, i]]
        return values

    return change


def exchange_6_and_14(sphere):
    return np.where(sphere == 6, 14, np.where(sphere == 14, 6, sphere))


def with_moved_gauge(first, last):
    """As if somebody had pushed the gauge by 0.5 mm before pose `first`, until pose `last`."""
    poses, arm, probe = measured().poses, measured().arm, measured().probe
    T_base_probe = forward_kinematics(arm, poses.joints)[:, :3, :3] @ probe.flange_T_probe.rotation
    centers = np.array(measured().centers())
    pushed = slice(first, last + 1)
    centers[pushed] += np.einsum('nji,j->ni', T_base_probe[pushed], [3e-4, 4e-4, 0])
    readings = probe.displacements(centers, measured().gauge.sphere_diameter)
    return replace(measured(), poses=replace(poses, displacement=readings))


def with_a_stuck_stylus(measured, column, first, last):
    displacement = np.array(measured.poses.displacement)
    displacement[first:last, column] = -4e-4
    return replace(measured, poses=replace(measured.poses, displacement=displacement))


def measured_diameter():
    return measured().gauge.sphere_diameter


def on_an_uneven_bar(count):
    """The same poses on a gauge whose spheres stand at other distances where none was probed."""
    probed = np.unique(measured().poses.sphere)
    gauge = measured().gauge
    spheres = tuple(
        (n, tuple(np.array(c) + [7e-3 * np.sin(3 * n) * (n not in probed), 0, 0]))
        for n, c in gauge.spheres
    )
    poses = measured().poses
    return replace(
        measured(),
        gauge=replace(gauge, spheres=spheres),
        poses=replace(poses, sphere=count(np.array(poses.sphere))),
    )


NAMED = {
    'a stylus stuck': (lambda: with_readings(held_at(1, 7e-4)), r'^stylus 2 reads 0.7000 mm in'),
    'a stylus stuck in mid-measurement': (
        lambda: with_readings(held_at(1, 7e-4, 180)),
        r'^stylus 2 reads 0.7000 mm in poses 181 to 560 .*: stuck; they are left out',
    ),
    'styli exchanged': (lambda: with_readings(exchanged(0, 1)), r'styli 1 and 2 exchanged'),
    'a stylus reversed': (lambda: with_readings(scaled(0, -1)), r'sign of stylus 1 reversed'),
    'a gain 2 % off': (
        lambda: with_readings(scaled(2, 1.02)),
        r'^stylus 3 reads (1\.9|2\.0).% too much',
    ),
    'an encoder that jumped': (
        lambda: with_joints(shifted(2, 2e-3)),
        r'joint_a3 .*jumped by \+(1\.9|2\.0)\d+ mrad near pose 28\d',
    ),
    'an encoder that jumped far': (
        lambda: with_joints(shifted(1, -0.3)),
        r'joint_a2 .*jumped by -(300\.0|299\.9)\d* mrad near pose 28\d',
    ),
    'an encoder that was off for a while': (
        lambda: with_joints(shifted(3, 5e-3, 200, 320)),
        r'joint_a4 .*jumped by \+(4\.9|5\.0).* mrad near pose 20\d and back near (31|32)\d',
    ),
    'joints exchanged': (lambda: with_joints(exchanged(3, 4)), r'joint_a4 and joint_a5 exchanged'),
    'a joint reversed': (lambda: with_joints(scaled(3, -1)), r'joint_a4 counted the other way'),
    'a joint in degrees': (
        lambda: with_joints(scaled(2, 180 / np.pi)),
        r'joint_a3 taken as degrees',
    ),
    'turned to radians twice': (
        lambda: with_joints(np.radians),
        r'joint positions taken as turned to radians twice',
    ),
    'a joint counted from elsewhere': (
        lambda: with_joints(shifted(2, np.pi / 2, 0)),
        r'-90 deg added to joint joint_a3',
    ),
    'degrees for radians': (lambda: with_joints(np.degrees), r'joint positions taken as degrees'),
    'a wrong certificate': (
        lambda: with_centers(lambda n, c: c + [2e-4 * (n == 6), 0, 0]),
        r'^sphere 6 is 0\.(199|200)\d mm from its place on the certificate',
    ),
    'a wrong certificate at an end': (
        lambda: with_centers(lambda n, c: c + [2e-3 * (n == 14), 0, 0]),
        r'^sphere 14 is (1\.9|2\.0).* mm from its place on the certificate',
    ),
    'a wrong diameter': (
        lambda: replace(
            measured(), gauge=replace(measured().gauge, sphere_diameter=measured_diameter() - 2e-4)
        ),
        r"^the spheres' diameter is \+0\.(19|20)\d mm from the gauge's 21\.8 mm",
    ),
    'numbers shifted by one along an uneven bar': (
        lambda: on_an_uneven_bar(lambda n: n + 1),
        r'better with every sphere number lower by 1',
    ),
    'an uneven bar the other way round': (
        lambda: on_an_uneven_bar(lambda n: 16 - n),
        r'better with spheres counted from the other',
    ),
    'another gauge': (
        lambda: with_centers(lambda n, c: c + [0.01 * np.sin(n), 0.01 * np.cos(n), 0]),
        r'^distances between spheres still differ by .* mm \(rms\) .*not to be used',
    ),
    'a certificate 2 % too long': (
        lambda: with_centers(lambda n, c: 1.02 * c),
        r'^the lengths of the arm come out (1\.9|2\.0).% longer throughout',
    ),
    'two locations under one number': (
        lambda: with_numbers(lambda loc, s: (np.where(loc == 2, 1, loc), s)),
        r'still lie .* mm apart .*two places under one location number',
    ),
    'two spheres of a location exchanged': (
        lambda: with_numbers(lambda loc, s: (loc, np.where(loc == 2, exchange_6_and_14(s), s))),
        r'^location 2: sphere .*mislabelled, or the gauge moved',
    ),
    'a gauge moved in mid-location': (
        lambda: with_moved_gauge(200, 239),
        r'^location 3: sphere .*or the gauge moved',
    ),
    'a gauge pushed while a stylus stuck later': (
        lambda: with_a_stuck_stylus(with_moved_gauge(90, 559), 2, 300, 420),
        r'^the gauge at location 2 was pushed by 0\.(49|50)\d mm near pose 9\d: that alone',
    ),
    'a gauge moved in mid-sphere': (lambda: with_moved_gauge(212, 239), r'gauge moved|left out'),
}


@pytest.mark.slow
@pytest.mark.parametrize('fault', NAMED)
def test_it_is_named(fault):
    make, expected = NAMED[fault]
    warnings = identify(make()).warnings
    assert any(re.search(expected, line) for line in warnings), warnings


@pytest.mark.parametrize(
    ('make', 'expected'),
    [
        (lambda: with_centers(lambda n, c: c * 1000), 'lengths of .* and .* both in m'),
        (lambda: with_readings(lambda s: s * 1000), 'mm for m'),
    ],
)
def test_mm_for_m_is_refused(make, expected):
    with pytest.raises(DataError, match=expected):
        identify(make())


def mean_distance_error(done):
    held_out = Problem.of(read_measurement(DEMO / 'held_out'))
    return float(np.abs(assess(held_out, done.arm, done.probe).distance).mean())


def test_numbers_shifted_by_one_along_an_even_bar_do_no_harm():
    wrong = with_numbers(lambda location, sphere: (location, sphere + (location == 2)))
    assert (wrong.poses.sphere != measured().poses.sphere).sum() == 80
    assert mean_distance_error(identify(wrong)) < 1.5 * mean_distance_error(identify(measured()))


def test_nothing_is_named_where_nothing_is_wrong():
    assert identify(measured()).warnings == ()
