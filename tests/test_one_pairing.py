# SPDX-License-Identifier: Apache-2.0
"""The same poses live, by `pair` and by `identify --raw`: to the last bit, whatever went wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_capture.commands.pair import pair, pair_hand_guided_bag
from calib_capture.recording import HandGuidedPose, HandGuidedRecord, HandGuidedRun
from calib_capture.replaying import read_recording
from calib_model.bags import BagWriter, cdr, write_descriptions
from calib_model.labelling import Instruments, RawSettings, SphereFinder, label_bag
from calib_model.measurement import ProbingSet
from calib_model.pairing import (
    HAND_GUIDED_NOTE,
    OUT_OF_ORDER,
    REASONS,
    Gaps,
    HandGuidedPairing,
    HandGuidedSettings,
    JointSample,
    Pairing,
    Reading,
    RecordedStreams,
    SteadyPose,
    SteadySettings,
    pair_readings,
    recorded_outcomes,
)
from calib_model.stamps import SECOND
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS
from selfcenter_probe.operator import HandGuided, MotionSettings, Scene, guided, read_scene

ROOT = Path(__file__).resolve().parents[1]
DEMO = ROOT / 'bags' / 'demo' / 'identification'
CONFIG = ROOT / 'ros2_ws/src/calib_bringup/config'
WORLD = ROOT / 'ros2_ws/src/selfcenter_probe/config/world_faro.yaml'
PROBES = {'active': 'active_trihedron_faro', 'passive': 'passive_seat_faro'}
SPHERES = (6, 10)
TOGETHER = 11  # readings: a tick of the capture node gathers about so many
pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]
Message = JointSample | Reading


def scene_of(kind: str) -> Scene:
    files = {
        'arm': 'arms/faro_sterling',
        'gauge': 'gauges/ball_bar_1500',
        'placements': 'locations/faro',
    }
    paths: dict[str, Path | None] = {key: CONFIG / f'{file}.yaml' for key, file in files.items()}
    return read_scene(str(CONFIG / f'probes/{PROBES[kind]}.yaml'), {**paths, 'world': WORLD})


def hand_guided(scene: Scene) -> list[Message]:
    """What arm and probe send, in the order of the stamps; no joint state on a reading."""
    world = scene.world(1)
    motion = guided(world, {3: scene.placements[3]}, SPHERES, MotionSettings(30, 2.0, 1))
    found: list[Message] = []
    for stretch in HandGuided(world, motion, 1).raw():
        found += map(JointSample, stretch.stamp.tolist(), stretch.joints)
        read = stretch.readings
        status = map(tuple, read.status.tolist())
        found += map(Reading, (read.stamp + 700_000).tolist(), read.displacement, status)
    return sorted(found, key=lambda each: each.stamp)


def as_sent(messages: list[Message]) -> list[Message]:
    return messages


def lossy(messages: list[Message]) -> list[Message]:
    """One in fifty is lost, doubled or late, and the arm is silent for a while."""
    rng = np.random.default_rng(4)
    begin = messages[len(messages) // 3].stamp
    silent = (begin, begin + 70_000_000)
    arriving: list[tuple[int, Message]] = []
    for each in messages:
        fate = rng.random()
        if isinstance(each, JointSample) and silent[0] < each.stamp < silent[1] or fate < 0.02:
            continue
        arriving.append((each.stamp, each))
        if fate < 0.04:
            arriving.append((each.stamp + 900_000, each))
        elif fate < 0.06:
            arriving[-1] = (each.stamp + int(rng.integers(1, 30_000_000)), each)
    return [each for _, each in sorted(arriving, key=lambda one: one[0])]


def record(scene: Scene, note: HandGuidedRecord, messages: list[Message], path: Path) -> None:
    names, frame = list(scene.arm.joint_names), scene.arm.base_frame
    with BagWriter(path, chunk_size=1 << 20) as bag:
        write_descriptions(bag, scene.arm, scene.probe, scene.gauge, 0)
        bag.note(HAND_GUIDED_NOTE, note.content())
        for number, each in enumerate(messages):
            if isinstance(each, JointSample):
                state = cdr.joint_state(each.stamp, frame, names, each.joints)
                bag.write_message(JOINT_STATES, state, number)
                continue
            status = np.array(each.status, dtype=np.uint8)
            read = cdr.displacements(each.stamp, 'probe', each.displacement, status)
            bag.write_message(PROBE_DISPLACEMENTS, read, number)


def live(scene: Scene, note: HandGuidedRecord, messages: list[Message]) -> list[HandGuidedPose]:
    """As a capture takes them."""
    finder = SphereFinder(scene.arm, scene.probe, scene.gauge, note.placements, note.spheres)
    run, pairing = HandGuidedRun(finder, note.settings), HandGuidedPairing(note.settings)
    poses: list[HandGuidedPose] = []
    for begin in range(0, len(messages), TOGETHER):
        paired = []
        for each in messages[begin : begin + TOGETHER]:
            add = pairing.add_reading if isinstance(each, Reading) else pairing.add_joints
            paired += add(each)  # type: ignore[arg-type]
        poses += run.take(paired)
    return poses + run.take(pairing.finish())


@pytest.mark.parametrize(
    ('kind', 'happens', 'lateness'),
    [
        ('active', as_sent, 0.0),
        ('active', lossy, 0.02),
        ('passive', as_sent, 0.02),
        ('passive', lossy, 0.0),
    ],
)
def test_a_hand_guided_arm_gives_the_same_poses_in_all_three_ways(
    kind: str,
    happens: Callable[[list[Message]], list[Message]],
    lateness: float,
    tmp_path: Path,
) -> None:
    scene = scene_of(kind)
    settings_ = HandGuidedSettings(spacing=0.15, seated=0.04, lateness=lateness)
    note = HandGuidedRecord(settings_, {3: scene.placements[3]}, SPHERES)
    messages = happens(hand_guided(scene))
    record(scene, note, messages, tmp_path / 'bag')
    taken = live(scene, note, messages)
    assert len(taken) > 50
    again = pair_hand_guided_bag(tmp_path / 'bag', tmp_path / 'again', note).measured.poses
    choice = RawSettings(spheres=SPHERES, standing=False)
    raw = in_time(label_bag(tmp_path / 'bag', choice, Instruments()).measured.poses)
    for poses in (again, raw):
        assert poses.stamp.tolist() == [each.stamp for each in taken]
        assert np.array_equal(poses.joints, [each.joints for each in taken])
        assert np.array_equal(poses.displacement, [each.displacement for each in taken])
    assert again.sphere.tolist() == [each.sphere for each in taken]


def in_time(poses: ProbingSet) -> ProbingSet:
    order = np.argsort(poses.stamp)
    return ProbingSet(
        *(
            getattr(poses, name)[order]
            for name in ('location', 'sphere', 'joints', 'displacement', 'stamp', 'readings')
        )
    )


def messages_of(streams: RecordedStreams) -> Iterator[Message]:
    """Joint states and readings in the order they were received."""
    arm = zip(streams.joint_stamp.tolist(), streams.joints, strict=True)
    probe = zip(
        streams.reading_stamp.tolist(),
        streams.displacement,
        map(tuple, streams.status.tolist()),
        strict=True,
    )
    numbered: list[tuple[int, Message]] = [
        *zip(streams.joint_number.tolist(), (JointSample(*each) for each in arm), strict=True),
        *zip(streams.reading_number.tolist(), (Reading(*each) for each in probe), strict=True),
    ]
    yield from (each for _, each in sorted(numbered, key=lambda one: one[0]))


def stopped(messages: Iterator[Message], steady: SteadySettings) -> list[object]:
    """What comes of the stops, as a capture pairs them."""
    pairing = Pairing(steady)
    outcomes: list[object] = []
    for each in messages:
        add = pairing.add_reading if isinstance(each, Reading) else pairing.add_joints
        outcomes += add(each)  # type: ignore[arg-type]
    outcomes += pairing.finish()
    return [*outcomes, pairing.too_late]


def test_an_arm_that_stops_gives_the_same_poses_in_all_three_ways(tmp_path: Path) -> None:
    *outcomes, _ = stopped(messages_of(read_recording(DEMO).streams), SteadySettings())
    taken = [each for each in outcomes if isinstance(each, SteadyPose)]
    again = pair(DEMO, tmp_path / 'again', SteadySettings()).measured.poses
    raw = in_time(label_bag(DEMO, RawSettings(), Instruments()).measured.poses)
    assert len(taken) == 560
    for poses in (again, raw):
        assert poses.stamp.tolist() == [each.stamp for each in taken]
        assert np.array_equal(poses.joints, [each.joints for each in taken])
        assert np.array_equal(poses.displacement, [each.displacement for each in taken])
        assert poses.readings.tolist() == [each.readings for each in taken]


@pytest.fixture(scope='module')
def demo() -> RecordedStreams:
    """The first stops of the demo."""
    return read_recording(DEMO).streams.received(0, 900)


DISORDER = {
    'seed': st.integers(0, 2**32 - 1),
    'lost': st.sampled_from([0.0, 0.02, 0.3]),
    'late': st.integers(0, 40_000_000),
    'lateness': st.sampled_from([0.0, 0.01, 0.05]),
    'back': st.sampled_from([0, 3 * SECOND]),
}


def disordered(
    messages: list[Message], rng: np.random.Generator, lost: float, late: int
) -> list[Message]:
    """Messages as they arrive: some lost, some twice, some by up to `late` (ns)."""
    sent = [each for each in messages if rng.random() >= lost]
    sent += [each for each in sent if rng.random() < 0.02]
    delay = [rng.integers(0, late + 1) if rng.random() < 0.05 else 0 for _ in sent]
    return [sent[i] for i in np.argsort([m.stamp for m in sent] + np.array(delay))]


@settings(max_examples=25, deadline=None)
@given(**DISORDER)
def test_stops_are_paired_of_a_recording_as_they_are_live(
    demo: RecordedStreams, seed: int, lost: float, late: int, lateness: float, back: int
) -> None:
    """Messages lost, late and twice; a clock that is set back in the midst of it."""
    rng = np.random.default_rng(seed)
    arriving = disordered(messages_of(demo), rng, lost, late)
    turn = arriving[len(arriving) // 2].stamp
    arriving = [m._replace(stamp=m.stamp - back * (m.stamp > turn)) for m in arriving]
    steady = SteadySettings(lateness=lateness)
    *outcomes, too_late = stopped(iter(arriving), steady)
    found, left_out = recorded_outcomes(recorded(arriving), steady)
    assert left_out == too_late
    assert [repr(each) for each in found] == [repr(each) for each in outcomes]


def recorded(messages: list[Message]) -> RecordedStreams:
    """Messages as a bag gives them back."""
    states = [(i, m) for i, m in enumerate(messages) if isinstance(m, JointSample)]
    readings = [(i, m) for i, m in enumerate(messages) if isinstance(m, Reading)]
    return RecordedStreams(
        np.array([i for i, _ in states]),
        np.array([m.stamp for _, m in states]),
        np.array([m.joints for _, m in states]),
        np.array([i for i, _ in readings]),
        np.array([m.stamp for _, m in readings]),
        np.array([m.displacement for _, m in readings]),
        np.array([m.status for _, m in readings], dtype=np.uint8),
    )


@settings(max_examples=35, deadline=None)
@given(**DISORDER, shift=st.sampled_from([0, -3_000_000]))
def test_readings_are_paired_of_a_recording_as_they_are_live(
    seed: int, lost: float, late: int, lateness: float, back: int, shift: int
) -> None:
    """Of an arm in motion, every reading: the same joints or the same reason."""
    rng = np.random.default_rng(seed)
    arm = [JointSample(t, np.sin([t * 2e-9, t * 3e-9])) for t in range(0, SECOND, 4_000_000)]
    probe = [
        Reading(t, rng.normal(size=3), (int(rng.random() < 0.05), 0, 0))
        for t in range(700_000, SECOND, 2_000_000)
    ]
    arriving = disordered([*arm, *probe], rng, lost, late)
    arriving = [
        m._replace(stamp=m.stamp + 10 * SECOND - back * (m.stamp > SECOND // 2)) for m in arriving
    ]
    pairing = HandGuidedPairing(HandGuidedSettings(lateness=lateness), shift)
    found = []
    for each in arriving:
        add = pairing.add_reading if isinstance(each, Reading) else pairing.add_joints
        found += add(each)  # type: ignore[arg-type]
    found += pairing.finish()
    expected: list[tuple[int, str, bytes]] = []
    gaps, late_joints, late_readings = Gaps(), 0, 0
    for stretch in recorded(arriving).stretches():
        streams = stretch.ordered(lateness)
        paired = pair_readings(streams, HandGuidedSettings().max_gap, shift)
        gaps.see(paired.gap)
        late_joints += streams.late_joints
        late_readings += streams.late_readings
        for stamp, reason, joints in zip(paired.stamp, paired.reason, paired.joints, strict=True):
            expected.append(
                (int(stamp), REASONS[reason], b'' if REASONS[reason] else bytes(joints))
            )
    assert sorted(
        (each.stamp, each.reason, b'' if each.joints is None else bytes(each.joints))
        for each in found
        if each.reason != OUT_OF_ORDER
    ) == sorted(expected)
    assert late_readings == sum(each.reason == OUT_OF_ORDER for each in found)
    assert (late_joints, gaps.bridged) == (pairing.late_joints, pairing.bridged)
