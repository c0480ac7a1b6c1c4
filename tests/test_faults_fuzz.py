# SPDX-License-Identifier: Apache-2.0
"""Thousands of damaged inputs, the same in every run: each is refused in one line, or read right.

Never another exception, a warning, more than 1.5 GiB, or a figure that is no number.
"""

from __future__ import annotations

import json
import random
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import damaged_bags
import numpy as np
import pytest
from mutations import ROUNDS, changed_bytes, changed_yaml, dice, outcomes, refused_once

from calib_capture.commands.pose_table import read_table
from calib_capture.replaying import read_playback
from calib_model.bags import (
    read_measurement,
    read_messages,
    recover,
    repair,
)
from calib_model.descriptions import (
    arm_yaml,
    gauge_yaml,
    parse_arm,
    parse_correction,
    parse_gauge,
    parse_links,
    parse_placements,
    parse_probe,
    probe_yaml,
)
from calib_model.errors import BagError, CalibrationError, DescriptionError
from calib_model.kinematics import forward_kinematics
from calib_model.measurement import Measurement
from calib_model.urdf import (
    arm_from_urdf,
    arm_urdf,
    with_origins,
)
from calib_solver.calibration import Sources, load
from calib_solver.compensation import read_targets
from calib_solver.fitting import parse_prior
from calib_solver.identification import identify
from calib_solver.problem import Problem
from calib_solver.quality import assess
from calib_solver.results import (
    quality_record,
    result_record,
)

pytestmark = pytest.mark.timeout(120 * ROUNDS)
CONFIG = Path(__file__).parents[1] / 'ros2_ws' / 'src' / 'calib_bringup' / 'config'
LINKS = """\
gravity: [0, 0, -9.81]
links: [{joint: joint_a2, mass: 8.0, center: [0.1, 0.0, 0.0]}]
"""
CORRECTION = """\
joints: [j1, j2]
joint_errors:
  encoder: [{order: 1, cosine: [1.0e-5, 0], sine: [0, 2.0e-5]}]
"""


@cache
def measured() -> Measurement:
    """Every fourth pose of a real graph's bag."""
    whole = read_measurement(Path(__file__).parents[1] / 'bags' / 'demo' / 'held_out')
    return replace(whole, poses=whole.poses.take(np.arange(0, len(whole.poses), 4)))


def numbers_only(found: Measurement, rng: random.Random) -> None:
    """What is read can be worked with, and every figure of it is a number."""
    quality = assess(Problem.of(found), found.arm, found.probe)
    json.dumps(quality_record(quality), allow_nan=False)
    if rng.random() < 0.1:
        json.dumps(result_record(identify(found)), allow_nan=False)


DESCRIPTIONS = {
    'arm': (parse_arm, arm_yaml),
    'probe': (parse_probe, probe_yaml),
    'gauge': (parse_gauge, gauge_yaml),
}


@pytest.mark.slow
@pytest.mark.parametrize('name', DESCRIPTIONS)
def test_a_description_is_refused_or_gives_figures_that_are_numbers(name: str) -> None:
    parse, written = DESCRIPTIONS[name]
    text = written(getattr(measured(), name))

    def read(rng: random.Random) -> None:
        found = parse(changed_yaml(text, rng), 'mine.yaml')
        assert parse(written(found)) == found
        numbers_only(replace(measured(), **{name: found}).checked(), rng)

    well, refused = outcomes(name, 75, read)
    assert well and refused > 50


OTHERS = {
    'locations': (parse_placements, (CONFIG / 'locations' / 'kr5_bench.yaml')),
    'prior': (parse_prior, 'sigma: {a: 0.001, alpha: 0.002}\nstrength: 2.0\n'),
    'links': (lambda text, source='': parse_links(text, source, measured().arm), LINKS),
    'correction': (parse_correction, CORRECTION),
}


@pytest.mark.slow
@pytest.mark.parametrize('name', OTHERS)
def test_other_yaml_is_refused_or_read(name: str) -> None:
    parse, text = OTHERS[name]
    if isinstance(text, Path):
        text = sorted(text.parent.glob('*.yaml'))[0].read_text()
    parse(text)
    well, refused = outcomes(name, 100, lambda rng: parse(changed_yaml(text, rng), 'mine.yaml'))
    assert well and refused > 20


BOMBS = {
    'aliases that unfold': 'a: &a [x, x]\n'
    + ''.join(
        f'b{i}: &b{i} [{", ".join([f"*b{i - 1}"] * 9 if i else ["*a"] * 9)}]\n' for i in range(12)
    ),
    'merges that unfold': 'a: &a {k: 1}\n'
    + ''.join(
        f'b{i}: &b{i} {{<<: [{", ".join([f"*b{i - 1}"] * 9 if i else ["*a"] * 9)}]}}\n'
        for i in range(12)
    ),
    'an alias of itself': 'a: &a [*a]\n',
    'lists in lists': 'name: ' + '[' * 100_000,
    'mappings in mappings': '\n'.join(' ' * i + 'a:' for i in range(900)),
    'keys without end': ''.join(f'k{i}: {i}\n' for i in range(40_000)),
    'a number without end': 'name: ' + '9' * 400_000,
    'a sum of sixties': 'name: ' + ':'.join(['59'] * 100_000),
    'megabytes': 'x' * 20_000_000,
    'a tag that asks for code': 'name: !!python/object/apply:os.system [true]',
    'tabs': 'name:\tx\n\tjoints:\t[]',
    'a zero byte': 'name: \x00',
    'joints without end': 'name: x\njoints:\n' + '- {name: j, a: 1, alpha: 1, d: 1}\n' * 5000,
    'spheres without end': 'name: x\nsphere_diameter: 0.02\nspheres:\n'
    + '- {number: 1}\n' * 12_000,
}


@pytest.mark.slow
@pytest.mark.parametrize('bomb', BOMBS)
def test_a_text_that_stands_for_more_than_it_is_is_refused(bomb: str) -> None:
    for parse in (parse_arm, parse_gauge):
        assert refused_once(bomb, lambda parse=parse: parse(BOMBS[bomb], 'mine.yaml'))


@pytest.mark.slow
def test_a_bag_that_was_damaged_never_reads_as_another(tmp_path: Path) -> None:
    whole = damaged_bags.bytes_of(measured(), tmp_path / 'whole')
    file = tmp_path / 'bad.mcap'
    expected = measured().poses

    def read(rng: random.Random) -> None:
        file.write_bytes(changed_bytes(whole, rng))
        found = read_measurement(file)
        assert (found.arm, found.gauge) == (measured().arm, measured().gauge)
        for column in fields(expected):
            ours = getattr(expected, column.name)[: len(found.poses)]
            assert (getattr(found.poses, column.name) == ours).all(), column.name

    well, refused = outcomes('bag', 200, read)
    assert well and refused > 100


@pytest.mark.slow
def test_what_is_recovered_of_a_damaged_bag_was_in_it_and_opens(tmp_path: Path) -> None:
    whole = damaged_bags.bytes_of(measured(), tmp_path / 'whole')
    expected = set(read_messages(tmp_path / 'whole'))
    numbers = iter(range(10_000_000))

    def read(rng: random.Random) -> None:
        place = tmp_path / f'case_{next(numbers)}'
        place.mkdir()
        (place / 'bad_0.mcap').write_bytes(changed_bytes(whole, rng))
        found = recover(place / 'bad_0.mcap', place / 'out')
        there = list(read_messages(place / 'out', cut_allowed=False))
        assert len(there) == found.messages
        if not set(there) <= expected:  # damage outside of chunks has no checksum of its own
            raise BagError('another message')
        assert found.lossy or len(there) >= len(expected)
        repair(place)

    well, refused = outcomes('recover', 60, read)
    assert well > 30 and refused


@pytest.mark.slow
def test_messages_of_any_content_are_refused_or_give_figures_that_are_numbers(
    tmp_path: Path,
) -> None:
    numbers = iter(range(10_000_000))

    def read(rng: random.Random) -> None:
        path = tmp_path / f'case_{next(numbers)}'
        damaged_bags.with_odd_messages(measured(), path, rng)
        numbers_only(read_measurement(path), rng)

    well, refused = outcomes('messages', 75, read)
    assert well and refused > 40


@pytest.mark.slow
def test_raw_messages_of_any_content_are_refused_or_read(tmp_path: Path) -> None:
    numbers = iter(range(10_000_000))

    def read(rng: random.Random) -> None:
        path = tmp_path / f'case_{next(numbers)}'
        damaged_bags.with_odd_raw_messages(measured(), path, rng)
        numbers_only(load(Sources((str(path),))), rng)

    assert outcomes('raw', 40, read)[1]


@pytest.mark.slow
@pytest.mark.parametrize('bomb', damaged_bags.BOMBS)
def test_a_bag_that_stands_for_more_than_it_is_is_refused(bomb: str, tmp_path: Path) -> None:
    path = damaged_bags.BOMBS[bomb](measured(), tmp_path)
    for read in (read_measurement, lambda path: load(Sources((str(path),)))):
        assert refused_once(bomb, lambda read=read: read(path))


@pytest.mark.slow
def test_metadata_of_any_content_is_refused_or_leads_to_the_bag(tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    damaged_bags.bytes_of(measured(), path)
    text = (path / 'metadata.yaml').read_text()

    def read(rng: random.Random) -> None:
        (path / 'metadata.yaml').write_text(changed_yaml(text, rng))
        assert len(read_measurement(path).poses) == len(measured().poses)
        read_playback(path)

    well, refused = outcomes('metadata', 30, read)
    assert well and refused


def test_an_sqlite_bag_of_any_content_is_refused_or_read(tmp_path: Path) -> None:
    whole = damaged_bags.sqlite_bag(measured(), tmp_path / 'whole')
    file = tmp_path / 'bad.db3'

    def read(rng: random.Random) -> None:
        file.write_bytes(changed_bytes(whole, rng))
        if rng.random() < 0.5:
            file.write_bytes(whole)
            damaged_bags.change_a_cell(file, rng)
        numbers_only(read_measurement(file), rng)

    assert len(read_measurement(tmp_path / 'whole').poses) == len(measured().poses)
    well, refused = outcomes('sqlite', 50, read)
    assert well and refused


def table() -> str:
    poses = measured().poses
    rows = zip(poses.location, poses.sphere, poses.joints, poses.displacement, strict=True)
    lines = ['location,sphere,q1,q2,q3,q4,q5,q6,s1,s2,s3']
    lines += [
        ','.join(map(str, (location, sphere, *q.tolist(), *s.tolist())))
        for location, sphere, q, s in list(rows)[:20]
    ]
    return '\n'.join(lines) + '\n'


CSV = {
    'semicolons': lambda text: text.replace(',', ';'),
    'commas as points': lambda text: text.replace(',', ';').replace('.', ','),
    'a row that is short': lambda text: text + '1,1,0\n',
    'a row that is long': lambda text: text + '1,1' + ',' * 500 + '\n',
    'a quote that is never closed': lambda text: text + '"' + 'x' * 1000,
    'a zero byte': lambda text: text.replace('0.1', '0\x00.1', 1),
    'a field of a megabyte': lambda text: text + 'x' * 1_000_000 + '\n',
    'a header of another table': lambda text: text.replace('location', 'place'),
    'no header': lambda text: text.split('\n', 1)[1],
    'nothing': lambda text: '',
    'a thousand columns': lambda text: ','.join(f'q{i}' for i in range(1000)),
    'infinity': lambda text: text + '1,1,inf,0,0,0,0,0,0,0,0\n',
    'degrees': lambda text: text + '1,1,90,0,0,0,0,0,0,0,0\n',
    'a location beyond 16 bits': lambda text: text + '70000,1,0,0,0,0,0,0,0,0,0\n',
}


@pytest.mark.parametrize('fault', CSV)
def test_a_table_that_is_wrong_is_refused(fault: str, tmp_path: Path) -> None:
    file = tmp_path / 'table.csv'
    file.write_text(CSV[fault](table()))
    m = measured()
    for read in (lambda: read_table(file, m.arm, m.probe, m.gauge), lambda: read_targets(file, 6)):
        assert refused_once(fault, read)


@pytest.mark.parametrize('ends', ['\n', '\r\n', '\r'])
def test_a_table_reads_the_same_with_other_line_ends_and_a_mark(ends: str, tmp_path: Path) -> None:
    file = tmp_path / 'table.csv'
    file.write_bytes(b'\xef\xbb\xbf' + table().replace('\n', ends).encode())
    found = read_table(file, measured().arm, measured().probe, measured().gauge)
    assert (found.joints == measured().poses.joints[:20]).all()


def test_a_table_of_any_content_is_refused_or_read(tmp_path: Path) -> None:
    file = tmp_path / 'table.csv'
    whole, m = table().encode(), measured()

    def read(rng: random.Random) -> None:
        file.write_bytes(changed_bytes(whole, rng))
        poses = read_table(file, m.arm, m.probe, m.gauge)
        numbers_only(replace(m, poses=poses).checked(), rng)

    well, refused = outcomes('table', 200, read)
    assert well and refused > 100


URDF = {
    'entities that unfold': '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">'
    + ''.join(f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(10))
    + ']><robot name="&k;"/>',
    'another file as an entity': '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
    '<robot name="&x;"/>',
    'elements in elements': '<robot name="r">' + '<link name="a">' * 100_000,
    'joints in a circle': '<robot name="r"><link name="a"/><link name="b"/>'
    '<joint name="1" type="revolute"><parent link="a"/><child link="b"/></joint>'
    '<joint name="2" type="revolute"><parent link="b"/><child link="a"/></joint></robot>',
    'numbers that are none': '<robot name="r"><link name="a"/><link name="b"/>'
    '<joint name="1" type="revolute"><origin xyz="nan inf x"/><parent link="a"/>'
    '<child link="b"/></joint></robot>',
}


@pytest.mark.parametrize('fault', URDF)
@pytest.mark.parametrize('encoding', ['utf-8', 'utf-16'])
def test_a_urdf_that_is_wrong_is_refused(fault: str, encoding: str) -> None:
    text = URDF[fault].encode(encoding)
    assert refused_once(fault, lambda: arm_from_urdf(text, source='my.urdf'))


def test_a_urdf_of_any_content_is_refused_or_read_exactly() -> None:
    whole = arm_urdf(measured().arm).encode()

    def read(rng: random.Random) -> None:
        text = changed_bytes(whole, rng)
        arm = arm_from_urdf(text, source='my.urdf')
        assert np.isfinite(forward_kinematics(arm, np.zeros((1, arm.n)))).all()
        with_origins(text, {arm.joint_names[0]: np.eye(4)}, 'my.urdf')

    well, refused = outcomes('urdf', 60, read)
    assert well and refused > 30


def test_the_same_number_is_the_same_damage() -> None:
    text = arm_yaml(measured().arm)
    assert changed_yaml(text, dice('arm', 7)) == changed_yaml(text, dice('arm', 7))
    assert len({changed_yaml(text, dice('arm', i)) for i in range(50)}) > 40


def test_an_error_is_one_line_of_bounded_length_that_no_terminal_obeys() -> None:
    line = str(CalibrationError('a\nb\r\x1b[2J\u2028' + 'x' * 100_000))
    assert len(line) < 1100 and line.isprintable() and line.startswith('a b \ufffd[2J ')


def test_only_errors_of_ours_in_one_line_are_let_pass() -> None:
    def raising(error: Exception):
        def work(rng: random.Random) -> None:
            raise error

        return work

    ours = raising(DescriptionError('f', 'a', 'b'))
    assert outcomes('ours', 3, ours, rounds=1) == (0, 3)
    for error in (ValueError('x'), MemoryError(), RecursionError(), RuntimeWarning('x')):
        with pytest.raises(AssertionError):
            outcomes('not ours', 1, raising(error))
    with pytest.raises(AssertionError):
        outcomes('room', 1, lambda rng: bytearray(2 << 30))
