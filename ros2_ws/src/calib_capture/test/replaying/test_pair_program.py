# SPDX-License-Identifier: Apache-2.0
"""Pairing redone from the raw topics of a bag, and bags that were cut, as commands."""

import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from calib_capture.commands import pair as pair_command, recover as recover_command
from calib_capture.commands.pair import pair
from calib_model.bags import BagWriter, cdr, read_measurement, read_messages, write_measurement
from calib_model.errors import BagError
from calib_model.pairing import SteadySettings, note_of, settings_of
from calib_model.topics import CAPTURE_POSES, DESCRIPTIONS, JOINT_STATES, PROBE_DISPLACEMENTS

pytestmark = pytest.mark.timeout(60)
RECORDED = Path(__file__).resolve().parents[5] / 'bags' / 'demo' / 'identification'


@pytest.fixture
def live():
    """The poses as they were paired live, in time order."""
    poses = read_measurement(RECORDED).poses
    order = np.argsort(poses.stamp)
    return {each.name: getattr(poses, each.name)[order] for each in fields(poses)}


@pytest.fixture
def unlabelled(tmp_path):
    """The recorded bag without its poses, as one who recorded the raw topics alone has it."""
    topics = {t.name: t for t in (*DESCRIPTIONS, JOINT_STATES, PROBE_DISPLACEMENTS)}
    with BagWriter(tmp_path / 'raw') as bag:
        for m in read_messages(RECORDED, set(topics)):
            bag.write(topics[m.topic], m.data, m.log_time, m.publish_time)
    return tmp_path / 'raw'


def assert_same(path, live):
    poses = read_measurement(path).poses
    for each in fields(poses):
        found = getattr(poses, each.name)
        assert found.shape == live[each.name].shape, each.name
        assert np.abs(found - live[each.name]).max() <= 1e-12, each.name


def test_redone_pairing_gives_the_poses_that_it_gave_live(live, tmp_path):
    repeated = pair(RECORDED, tmp_path / 'out', SteadySettings())
    assert_same(tmp_path / 'out', live)
    assert (repeated.recorded, repeated.missed, repeated.unknown) == (560, 0, 0)


def test_where_the_gauge_stood_tells_the_spheres_of_a_bag_without_poses(
    live, unlabelled, config, tmp_path
):
    places = config / 'locations' / 'kr5.yaml'
    pair(unlabelled, tmp_path / 'out', SteadySettings(), places)
    assert_same(tmp_path / 'out', live)
    with pytest.raises(BagError, match='say where the gauge stood'):
        pair(unlabelled, tmp_path / 'other', SteadySettings())


def test_other_settings_give_other_averages_of_the_same_stops(live, tmp_path):
    pair(RECORDED, tmp_path / 'out', SteadySettings(settle=0.0, dwell=0.045))
    poses = read_measurement(tmp_path / 'out').poses
    assert np.array_equal(poses.sphere, live['sphere'])
    assert (poses.readings > live['readings']).mean() > 0.9
    assert np.abs(poses.joints - live['joints']).max() < 1e-6


def test_an_arm_started_anew_with_an_earlier_clock_is_paired_too(live, tmp_path):
    """Two captures in one bag, the second with stamps from before the first."""
    topics = {t.name: t for t in (*DESCRIPTIONS, JOINT_STATES, PROBE_DISPLACEMENTS, CAPTURE_POSES)}
    messages = list(read_messages(RECORDED, set(topics)))
    stops = live['stamp'][280]

    def early(message):
        if message.topic not in (JOINT_STATES.name, PROBE_DISPLACEMENTS.name, CAPTURE_POSES.name):
            return True
        return cdr.stamp_of(cdr.decode(message.type, message.data)) <= stops + 5_000_000

    with BagWriter(tmp_path / 'turned') as bag:
        ordered = [m for m in messages if not early(m)] + [m for m in messages if early(m)]
        for m in ordered:
            bag.write(topics[m.topic], m.data, m.log_time, m.publish_time)
    pair(tmp_path / 'turned', tmp_path / 'out', SteadySettings())
    found = set(read_measurement(tmp_path / 'out').poses.stamp.tolist())
    assert len(found) >= 558  # the stop that was torn apart may be lost, no other


def test_a_bag_of_poses_alone_has_nothing_to_pair(tmp_path):
    write_measurement(tmp_path / 'poses', read_measurement(RECORDED))
    with pytest.raises(BagError, match='no raw messages on /joint_states'):
        pair(tmp_path / 'poses', tmp_path / 'out', SteadySettings())
    assert not (tmp_path / 'out').exists()


def test_settings_come_back_from_a_bag_bit_for_bit():
    asked = SteadySettings(settle=0.1 + 0.2, dwell=1 / 3, min_readings=5, lateness=1e-3)
    assert settings_of(note_of(asked)) == asked
    assert settings_of({}) == SteadySettings()
    for value in ('x', 'nan', 'inf', '-1', '1e9'):
        with pytest.raises(BagError, match=f"dwell is '{value}', expected a number from 0 to 60"):
            settings_of({'dwell': value})


def said(monkeypatch, capsys, main, *arguments):
    monkeypatch.setattr(sys, 'argv', ['command', *map(str, arguments)])
    code = main()
    return code, capsys.readouterr()


def test_commands_report_counts_and_end_with_three_where_something_is_missing(
    monkeypatch, capsys, tmp_path
):
    whole = (RECORDED / 'identification_0.mcap').read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole[: len(whole) // 2])
    there = list(read_messages(cut))
    code, out = said(monkeypatch, capsys, recover_command.main, cut, tmp_path / 'back')
    assert code == 3
    assert f'{len(there)} messages recovered, missing: no end of the recording' in out.out
    assert list(read_messages(tmp_path / 'back', cut_allowed=False)) == there
    code, out = said(monkeypatch, capsys, recover_command.main, RECORDED, tmp_path / 'copy')
    assert (code, out.out.splitlines()[-1]) == (
        0,
        f'{tmp_path}/copy: 6501 messages recovered, missing: nothing',
    )
    code, out = said(monkeypatch, capsys, recover_command.main, tmp_path / 'no', tmp_path / 'x')
    assert (code, out.err) == (2, f'{tmp_path}/no: no such bag\n')
    code, out = said(monkeypatch, capsys, pair_command.main, tmp_path / 'back', tmp_path / 'p')
    poses = sum(message.topic == CAPTURE_POSES.name for message in there)
    assert code == 0
    assert f'{poses} poses were recorded, 0 have no pose now' in out.out
    code, out = said(monkeypatch, capsys, pair_command.main, RECORDED, tmp_path / 'p')
    assert (code, out.err) == (2, f'{tmp_path}/p: exists already, a bag is never overwritten\n')


def test_a_bag_whose_headers_tell_no_time_goes_by_when_it_was_recorded(live, config, tmp_path):
    topics = {t.name: t for t in (*DESCRIPTIONS, JOINT_STATES, PROBE_DISPLACEMENTS)}
    with BagWriter(tmp_path / 'unstamped') as bag:
        for m in read_messages(RECORDED, set(topics)):
            data, logged = m.data, m.log_time
            if topics[m.topic] in (JOINT_STATES, PROBE_DISPLACEMENTS):
                logged = cdr.stamp_of(cdr.decode(m.type, data))
                data = data[:4] + bytes(8) + data[12:]
            bag.write(topics[m.topic], data, logged, logged)
    places = config / 'locations' / 'kr5.yaml'
    paired = pair(tmp_path / 'unstamped', tmp_path / 'out', SteadySettings(), places)
    assert_same(tmp_path / 'out', live)
    assert 'go by when they were recorded (--stamps record)' in paired.lines()[0]
    with pytest.raises(BagError, match='no stamps, they are all 0'):
        pair(tmp_path / 'unstamped', tmp_path / 'o', SteadySettings(), places, stamps='header')
