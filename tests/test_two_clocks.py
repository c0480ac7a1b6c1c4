# SPDX-License-Identifier: Apache-2.0
"""A probe whose clock is 3 ms behind: found, corrected, and the calibration is as good as ever."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_capture.commands.pair import pair_hand_guided_bag
from calib_capture.recording import HandGuidedRecord
from calib_capture.replaying import PairedHandGuided, read_recording
from calib_model.bags import BagWriter, cdr, write_descriptions
from calib_model.pairing import (
    ClockEstimate,
    HandGuidedSettings,
    JointSample,
    Reading,
    interpolated,
)
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS
from calib_solver.identification import identify
from calib_solver.problem import Problem
from calib_solver.quality import assess
from selfcenter_probe.operator import (
    HandGuided,
    MotionSettings,
    RawStretch,
    Scene,
    guided,
    read_scene,
)

CONFIG = Path(__file__).resolve().parents[1] / 'ros2_ws/src/calib_bringup/config'
WORLD = CONFIG.parents[1] / 'selfcenter_probe/config/world_faro.yaml'
BEHIND = 3_000_000  # ns
OWN, HELD_OUT = (1, 5, 6), (8,)
SPHERES = (1, 10)
pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]


@pytest.fixture(scope='module')
def scene() -> Scene:
    files = {
        'arm': 'arms/faro_sterling',
        'gauge': 'gauges/ball_bar_1500',
        'placements': 'locations/faro',
    }
    paths: dict[str, Path | None] = {key: CONFIG / f'{file}.yaml' for key, file in files.items()}
    return read_scene(str(CONFIG / 'probes/active_trihedron_faro.yaml'), {**paths, 'world': WORLD})


def record(scene: Scene, locations: tuple[int, ...], path: Path) -> None:
    """The raw streams of a hand in a hurry, readings stamped by a clock that is behind."""
    world = scene.world(1)
    sides = {number: scene.placements[number] for number in locations}
    hand = HandGuided(world, guided(world, sides, SPHERES, MotionSettings(60, 6.0, 1)), 1)
    names, base, frame = list(scene.arm.joint_names), scene.arm.base_frame, scene.probe.name
    with BagWriter(path, chunk_size=1 << 20) as bag:
        write_descriptions(bag, scene.arm, scene.probe, scene.gauge, 0)
        for stretch in hand.raw():
            for stamp, q in zip(stretch.stamp.tolist(), stretch.joints, strict=True):
                bag.write_message(JOINT_STATES, cdr.joint_state(stamp, base, names, q), stamp)
            read = stretch.readings.shifted(-BEHIND)
            for stamp, *values in zip(
                read.stamp.tolist(), read.displacement, read.status, strict=True
            ):
                message = cdr.displacements(stamp, frame, *values)
                bag.write_message(PROBE_DISPLACEMENTS, message, stamp + BEHIND)


@pytest.fixture(scope='module')
def paired(scene, tmp_path_factory):
    """What identifies and what is held out, corrected and as by one clock."""
    folder = tmp_path_factory.mktemp('clocks')
    record(scene, OWN, folder / 'own')
    record(scene, HELD_OUT, folder / 'held_out')

    def pair(name: str, how: str, shift: int, correct: bool = False) -> PairedHandGuided:
        note = HandGuidedRecord(HandGuidedSettings(spacing=0.2), scene.placements, SPHERES, shift)
        return pair_hand_guided_bag(folder / name, folder / f'{name}_{how}', note, correct)

    own = pair('own', 'corrected', 0, correct=True)
    sets = {'corrected': (own.measured, pair('held_out', 'corrected', own.shift).measured)}
    sets['one clock'] = tuple(
        pair(name, 'one_clock', BEHIND).measured for name in ('own', 'held_out')
    )
    return sets, own.clock, read_recording(folder / 'own').streams


def test_the_offset_is_estimated_to_a_fifth_of_a_millisecond(paired):
    _, clock, _ = paired
    assert abs(clock.seconds - BEHIND * 1e-9) < 2e-4
    assert clock.standard_uncertainty < 2e-4


def messages(stretch: RawStretch) -> list[JointSample | Reading]:
    """Both streams in the order of their stamps."""
    read = stretch.readings
    both: list[JointSample | Reading] = [
        JointSample(*each) for each in zip(stretch.stamp.tolist(), stretch.joints, strict=True)
    ]
    both += [
        Reading(stamp, displacement, tuple(status))
        for stamp, displacement, status in zip(
            read.stamp.tolist(), read.displacement, read.status.tolist(), strict=True
        )
    ]
    return sorted(both, key=lambda each: each.stamp)


@pytest.mark.parametrize('seed', range(1, 4))
def test_half_a_minute_at_one_sphere_promises_no_more_than_it_can(scene, seed):
    """All of the arm's parameters bend to one sphere: stretches of contact agree, and are wrong."""
    world, sides = scene.world(seed), {3: scene.placements[3]}
    hand = HandGuided(world, guided(world, sides, [6], MotionSettings(385, 1.0, seed)), seed)
    estimate = ClockEstimate(scene.arm, scene.probe, scene.gauge)
    told = {}
    for message in (message for stretch in hand.raw() for message in messages(stretch)):
        if isinstance(message, Reading):
            estimate.see_reading(message)
        else:
            estimate.see_joints(message)
        if estimate.chunks not in told:
            told[estimate.chunks] = estimate.estimate()
        if estimate.chunks == 20:
            break
    assert len(told) == 21
    sure = [each for each in told.values() if each is not None]
    assert all(abs(each.seconds) < 3 * each.standard_uncertainty for each in sure), sure


def test_corrected_joints_are_those_of_the_right_instant(paired):
    sets, _, streams = paired
    poses, known = sets['corrected'][0].poses, (streams.joint_stamp, streams.joints)
    off = {
        shift: np.abs(interpolated(*known, poses.stamp + shift, 0.02).joints - poses.joints).max()
        for shift in (0, BEHIND)
    }
    assert off[BEHIND] < 1e-3 < 5e-3 < off[0]


def test_the_calibration_is_as_good_as_by_one_clock(paired):
    sets, _, _ = paired
    held_out = {}
    for how, (own, other) in sets.items():
        done = identify(own)
        quality = assess(Problem.of(other), done.arm, done.probe)
        held_out[how] = np.array(
            [quality.spheres.two_sigma.mean(), np.sqrt((quality.distance**2).mean())]
        )
    print({how: np.round(each * 1e3, 4).tolist() for how, each in held_out.items()})
    assert (held_out['one clock'] < 2e-4).all()
    assert (held_out['corrected'] < 1.1 * held_out['one clock'] + 5e-6).all()
