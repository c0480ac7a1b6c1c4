# SPDX-License-Identifier: Apache-2.0
"""2 sigma of an arm that is off, while it is measured, against what is known of it."""

from __future__ import annotations

import numpy as np
import pytest

from calib_capture.measuring import MeasuringRun, RunSettings, TakenPose, Tally
from calib_capture.program import Planner, ProgramSettings
from calib_capture.showing import HandGuidedProgress, RefusalNews, RunningQuality, RunProgress
from calib_model.kinematics import DEFAULT_SIGMA, ParameterTable, probing_jacobian
from calib_model.measurement import ProbingSet
from calib_model.pairing import SteadyPose

SCATTER = 8e-6  # m


@pytest.fixture(scope='module')
def program(kr5, probe, gauge, placements):
    settings = ProgramSettings(spheres=(3, 12), poses_per_sphere=30, pool=1, bodies=None)
    return Planner(kr5, probe, gauge, settings).program(placements, [2])


@pytest.fixture(scope='module')
def read(kr5, probe, gauge, program):
    """What the styli read of each pose on an arm that is off as machined ones are: the nominal
    arm sees the sphere elsewhere in each."""
    rng = np.random.default_rng(6)
    table = ParameterTable.of(kr5, probe)
    sigma = np.array([DEFAULT_SIGMA[one.kind] for one in table.parameters])
    sigma[table.mount] = 1e-3
    off = rng.normal(size=len(sigma)) * sigma
    joints = np.array([pose.joints for pose in program.poses])
    seats = np.array([pose.p_probe_sphere for pose in program.poses])
    arm, mounted = table.apply(table.nominal + off, kr5, probe)
    truly, _ = probing_jacobian(arm, mounted, joints, seats)
    centers = np.array([truly[:30].mean(axis=0), truly[30:].mean(axis=0)])
    centers = np.repeat(centers, 30, axis=0) + rng.normal(size=truly.shape) * SCATTER
    # moved within the probe until the true arm has the sphere at one place
    T = np.array([_turn(arm, mounted, q) for q in joints])
    seats = seats + np.einsum('nji,nj->ni', T, centers - truly)
    return probe.displacements(seats, gauge.sphere_diameter)


def _turn(arm, probe, q):
    """Rotation of the probe in the base frame."""
    ends = np.vstack([np.zeros(3), np.eye(3)])
    places, _ = probing_jacobian(arm, probe, np.tile(q, (4, 1)), ends)
    return (places[1:] - places[0]).T


def test_the_identified_scatter_comes_down_to_the_noise_and_the_nominal_one_stays(
    kr5, probe, gauge, program, read
):
    running = RunningQuality(kr5, probe, gauge)
    assert running.spheres() == {}
    few = None
    for number, (pose, styli) in enumerate(zip(program.poses, read, strict=True)):
        running.add((pose.location, pose.sphere), pose.joints, styli)
        if number == 22:  # 23 poses: 66 coordinates over, 36 parameters
            few = running.spheres()[2, 3]
    assert np.isnan(few.identified).all()
    assert (few.nominal > 2e-4).all()
    found = running.spheres()
    assert set(found) == {(2, 3), (2, 12)}
    for scatter in found.values():
        assert (scatter.nominal > 2e-4).all()
        assert scatter.identified == pytest.approx(2 * SCATTER, rel=0.6)


def test_a_single_pose_and_a_reading_of_no_sphere_have_no_scatter(kr5, probe, gauge, program, read):
    running = RunningQuality(kr5, probe, gauge)
    running.add((2, 3), program.poses[0].joints, np.array([0.4, -0.9, 2.0]))
    assert np.isnan(running.spheres()[2, 3].nominal).all()
    running.add((2, 3), program.poses[0].joints, read[0])
    assert np.isnan(running.spheres()[2, 3].nominal).all()


def test_counts_of_spheres_add_up_with_what_was_in_the_bag_before(kr5, probe, gauge, program, read):
    run = MeasuringRun(kr5, program, RunSettings(), 0.0)
    first = program.poses[0]
    earlier = ProbingSet(
        np.array([2, 2]),
        np.array([3, 12]),
        np.array([first.joints, program.poses[-1].joints]),
        read[[0, -1]],
        np.arange(2),
        np.full(2, 3),
    )
    progress = RunProgress(program, kr5, probe, gauge, earlier)
    for pose, styli in zip(program.poses[1:4], read[1:4], strict=True):
        run.taken.append(TakenPose(pose, SteadyPose(1, pose.joints, styli, 3)))
    run.tally.refused_at[2, 12, 'no contact'] = 2
    for _ in range(2):  # asked twice, counted once
        one, other = progress.spheres(run)
    assert (one.location, one.sphere, one.planned, one.taken, one.refused) == (2, 3, 30, 4, {})
    assert (other.sphere, other.taken, other.refused) == (12, 1, {'no contact': 2})
    assert one.left == other.left == 30
    assert (one.two_sigma.nominal > 1e-5).all()


def test_a_hand_guided_arm_is_told_of_sphere_by_sphere_as_well(kr5, probe, gauge, program, read):
    first = program.poses[0]
    earlier = ProbingSet(
        np.array([2]),
        np.array([3]),
        first.joints[None],
        read[:1],
        np.arange(1),
        np.full(1, 3),
    )
    progress = HandGuidedProgress({(2, 3): 5, (2, 12): 1}, kr5, probe, gauge, earlier)
    taken = [
        ((2, 3 * (number < 3)), pose.joints, styli)
        for number, (pose, styli) in enumerate(zip(program.poses[1:6], read[1:6], strict=True))
    ]
    untold, one, other = progress.spheres(taken)
    assert (untold.sphere, untold.planned, untold.taken, untold.left) == (0, 0, 2, 0)
    assert np.isnan(untold.two_sigma.nominal).all()
    assert (one.sphere, one.planned, one.taken, one.left) == (3, 5, 4, 1)
    assert (one.two_sigma.nominal > 1e-5).all()
    assert (other.sphere, other.taken, other.left) == (12, 0, 1)
    assert [each.taken for each in progress.spheres([])] == [1, 0]  # what was taken back


def test_a_refusal_is_told_once_for_its_reason_and_with_where_it_was():
    tally, news = Tally(9), RefusalNews()
    assert news.of(tally) == []
    for sphere, reason in ((4, 'no contact'), (7, 'no contact'), (7, 'over-travel')):
        tally.refused[reason] += 1
        tally.refused_at[3, sphere, reason] += 1
    one, other = news.of(tally)
    assert one.startswith('location 3, sphere 4: a pose is refused, no contact')
    assert other.startswith('location 3, sphere 7: a pose is refused, over-travel')
    tally.refused['no contact'] += 1
    tally.refused_at[5, 1, 'no contact'] += 1
    assert news.of(tally) == []
    assert tally.so_far() == '0 taken, 4 refused (3 no contact, 1 over-travel), 5 to go'
