# SPDX-License-Identifier: Apache-2.0
"""Eq. 12's correction on the simulated FARO, and on the same arm with geometric errors alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib_model.measurement import Measurement
from calib_solver.fitting import Options
from calib_solver.identification import identify
from calib_solver.problem import Problem
from calib_solver.quality import assess
from selfcenter_probe.operator import HandGuided, MotionSettings, guided, probing_set, read_scene
from selfcenter_probe.simulation import Encoders, World

POSES, SEED = 20, 3
PLACES = {'used': ((1, 2, 3, 4, 5, 6, 7), (1, 6, 10, 14)), 'never': ((8,), (2, 5, 9, 13))}
AUTO = Options(correction='auto', joint_errors=())
pytestmark = pytest.mark.timeout(120)


@cache
def scene_and_motions():
    """The scene, its world, and the way the arm is led, at the locations used and at another."""
    scene = read_scene('active', {})
    world = scene.world(SEED)
    motions = {
        name: guided(
            world,
            {number: scene.placements[number] for number in numbers},
            spheres,
            MotionSettings(POSES, seed=SEED),
        )
        for name, (numbers, spheres) in PLACES.items()
    }
    return scene, world, motions


def measured(world: World, name: str) -> Measurement:
    scene, _, motions = scene_and_motions()
    hand = HandGuided(world, motions[name], SEED)
    taken = [(seating, hand.poses_of(i)) for i, seating in enumerate(motions[name].seatings)]
    return Measurement(scene.arm, scene.probe, scene.gauge, probing_set(taken))


@pytest.mark.slow
def test_eccentric_encoders_are_corrected_by_a_fifth_and_more_where_never_used():
    world = scene_and_motions()[1]
    assert world.encoders.cosine.any()
    done = identify(measured(world, 'used'), AUTO)
    assert done.choice_12.accepted
    held_out = Problem.of(measured(world, 'never'))
    before = assess(held_out, done.arm, done.probe).spheres.two_sigma.mean()
    after = assess(held_out, done.arm, done.probe, done.correction).spheres.two_sigma.mean()
    assert after < 0.8 * before


@pytest.mark.slow
def test_the_same_arm_with_geometric_errors_alone_gets_no_correction():
    world = scene_and_motions()[1]
    nothing, magnitudes = np.zeros((2, world.arm.n)), world.magnitudes
    straight = replace(
        world,
        encoders=Encoders(nothing, nothing),
        magnitudes=replace(
            magnitudes,
            arm=replace(magnitudes.arm, compliance=0.0),
            gauge=replace(magnitudes.gauge, give_level=0.0, give_vertical=0.0),
        ),
    )
    done = identify(measured(straight, 'used'), AUTO)
    assert not done.choice_12.accepted
    assert 'refused' in done.choice_12.verdict
    assert done.correction is None
