# SPDX-License-Identifier: Apache-2.0
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_capture.replaying.playback import OfferedQos, Timing, offered_qos, read_playback
from calib_model.bags import BagWriter, cdr
from calib_model.errors import BagError
from calib_model.topics import (
    ARM_DESCRIPTION,
    GAUGE_DESCRIPTION,
    JOINT_STATES,
    PROBE_DISPLACEMENTS,
    TRAJECTORY,
    Topic,
)


@pytest.mark.parametrize('topic', [ARM_DESCRIPTION, JOINT_STATES, PROBE_DISPLACEMENTS])
def test_offered_qos_is_that_of_the_topic(topic: Topic, tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write_message(topic, cdr.string('x'), 1)
    playback = read_playback(tmp_path / 'bag')
    (message,) = playback.latched or playback.timed()
    found = offered_qos(message.offered_qos)
    assert found == OfferedQos(topic.depth, topic.reliable, topic.latched)


def test_older_bags_numbers_are_understood() -> None:
    text = '- history: 1\n  depth: 7\n  reliability: 2\n  durability: 1\n'
    assert offered_qos(text) == OfferedQos(depth=7, reliable=False, latched=True)


@pytest.mark.parametrize('text', ['', 'x', '[]', '[3]', '{', '- depth: -1', '- depth: many'])
def test_without_usable_qos_every_volatile_subscriber_is_served(text: str) -> None:
    assert offered_qos(text) == OfferedQos(depth=100, reliable=True, latched=False)


def test_latched_first_then_by_log_time_whatever_the_files_order(tmp_path: Path) -> None:
    def state(i: int) -> object:
        return cdr.joint_state(i, '', [], np.zeros(0))

    with BagWriter(tmp_path / 'bag') as bag:
        for i in (30, 10, 20):
            bag.write_message(JOINT_STATES, state(i), i)
        bag.write_message(ARM_DESCRIPTION, cdr.string('first'), 25)
        bag.write_message(ARM_DESCRIPTION, cdr.string('second'), 40)
    playback = read_playback(tmp_path / 'bag')
    assert [cdr.decode(m.type, m.data).data for m in playback.latched] == ['first']
    assert [m.log_time for m in playback.timed()] == [10, 20, 30, 40]
    assert playback.span == (10, 40)
    assert len(playback) == 5


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([JOINT_STATES, ARM_DESCRIPTION, GAUGE_DESCRIPTION]), st.integers(0, 9)
        ),
        min_size=1,
        max_size=30,
    )
)
def test_any_order_of_the_files_is_played_in_that_of_time(written) -> None:
    with TemporaryDirectory() as folder:
        with BagWriter(Path(folder) / 'bag') as bag:
            for place, (topic, time_) in enumerate(written):
                bag.write(topic, place.to_bytes(8, 'little'), time_, time_)
        playback = read_playback(Path(folder) / 'bag')
        played = [int.from_bytes(m.data[:8], 'little') for m in playback.timed()]
        again = [int.from_bytes(m.data[:8], 'little') for m in playback.timed()]
        latched = [int.from_bytes(m.data[:8], 'little') for m in playback.latched]
    by_time = sorted(range(len(written)), key=lambda place: written[place][1])
    first = {}
    for place in by_time:
        if written[place][0].latched:
            first.setdefault(written[place][0].name, place)
    assert sorted(latched) == sorted(first.values())
    assert played == again == [place for place in by_time if place not in first.values()]
    assert len(playback) == len(written)


def test_what_would_move_an_arm_is_left_out_under_any_name(tmp_path: Path) -> None:
    names = ('/kuka/joint_trajectory', '/robot1/anything')
    with BagWriter(tmp_path / 'bag') as bag:
        for i, name in enumerate(names):
            bag.write(Topic(name, TRAJECTORY), bytes(64), i, i)
    with pytest.raises(BagError, match='no messages but commands'):
        read_playback(tmp_path / 'bag')
    with BagWriter(tmp_path / 'other') as bag:
        bag.write(Topic(names[0], TRAJECTORY), bytes(64), 3, 3)
        bag.write_message(JOINT_STATES, cdr.joint_state(5, '', [], np.zeros(0)), 5)
    playback = read_playback(tmp_path / 'other')
    assert [message.topic for message in playback.timed()] == [JOINT_STATES.name]
    assert playback.commands == names[:1]


def test_a_bag_without_messages_is_refused(tmp_path: Path) -> None:
    BagWriter(tmp_path / 'bag').close()
    with pytest.raises(BagError, match='no messages'):
        read_playback(tmp_path / 'bag')


def test_time_passes_at_the_rate_and_never_early() -> None:
    ticks: list[int] = []
    begun = time.monotonic()
    timing = Timing(5_000_000_000, 10.0, ticks.append)
    timing.wait_until(5_000_000_000)
    timing.wait_until(8_000_000_000)
    assert time.monotonic() - begun >= 0.3
    assert timing.now() >= 8_000_000_000
    assert ticks == sorted(ticks)
    assert 2 <= len(ticks) <= 40
    assert ticks[0] >= 5_000_000_000
