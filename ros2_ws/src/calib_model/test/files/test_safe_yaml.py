# SPDX-License-Identifier: Apache-2.0
"""Numbers in YAML files are what people mean, or refused with their line."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from calib_model.descriptions import parse_arm, parse_gauge, parse_placements
from calib_model.errors import DescriptionError
from calib_model.files import load_mapping, load_plain

GAUGE = """\
name: bar
sphere_diameter: {diameter}
uncertainty: {{constant: 1.0e-6, proportional: 0.0}}
spheres:
  - {{number: {number}, center: [0.0, 0.0, 0.0]}}
  - {{number: 12, center: [{x}, 0.0, 0.0]}}
"""


def gauge(diameter: str = '0.02', number: str = '3', x: str = '0.3') -> str:
    return GAUGE.format(diameter=diameter, number=number, x=x)


@pytest.mark.parametrize(
    ('text', 'line', 'value'),
    [
        (gauge(number='011'), 5, '011'),
        (gauge(number='-07'), 5, '-07'),
        (gauge(number='09'), 5, '09'),
        (gauge(x='2:15'), 6, '2:15'),
        (gauge(x='1:30.5'), 6, '1:30.5'),
        (gauge(diameter='+1:05:10'), 2, '+1:05:10'),
        (gauge(diameter='00'), 2, '00'),
    ],
)
def test_a_number_that_yaml_reads_otherwise_is_refused_with_file_and_line(
    text: str, line: int, value: str
) -> None:
    with pytest.raises(DescriptionError) as refused:
        parse_gauge(text, 'bar.yaml')
    said = str(refused.value)
    assert 'bar.yaml' in said
    assert f'line {line}' in said
    assert value in said
    assert '\n' not in said


def test_the_line_is_that_of_the_value_in_a_long_list() -> None:
    rows = ''.join(f'  - {{name: j{i}, a: 0.1, alpha: 0, d: {i}, theta_0: 0}}\n' for i in range(9))
    text = f'name: x\nbase_frame: b\nflange_frame: f\njoints:\n{rows}'
    assert parse_arm(text, 'arm.yaml').n == 9
    with pytest.raises(DescriptionError, match=r'arm\.yaml: line 11\b.*\b06\b'):
        parse_arm(text.replace('d: 6,', 'd: 06,'), 'arm.yaml')


def test_locations_are_read_likewise() -> None:
    text = (
        'base_frame: base\nlocations:\n'
        '  - {number: 010, translation: [0, 0, 0], rotation_vector: [0, 0, 0]}\n'
    )
    with pytest.raises(DescriptionError, match=r'places\.yaml: line 3\b.*\b010\b'):
        parse_placements(text, 'places.yaml')


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('0', 0),
        ('-0', 0),
        ('10', 10),
        ('0.022', 0.022),
        ('00.5', 0.5),
        ('"022"', '022'),
        ("'1:30'", '1:30'),
        ('12:30 o clock', '12:30 o clock'),
        ('00:1a:2b:33', '00:1a:2b:33'),
        ('2026-11-05', '2026-11-05'),
        ('1_000', 1000),
    ],
)
def test_what_people_and_yaml_read_alike_is_taken(text: str, value: object) -> None:
    found = load_mapping(f'key: {text}\n', 'file', ('key',)).content['key']
    assert (str(found) if isinstance(value, str) else found) == value


def test_files_of_others_keep_their_own_counting() -> None:
    """What rosbag2 and rclpy write is nothing that a person counted."""
    assert load_plain('mode: 022\ntime: 12:30\n', 'metadata.yaml') == {'mode': 18, 'time': 750}


@given(st.integers(-(10**9), 10**9), st.integers(1, 4))
def test_an_integer_is_itself_and_with_zeros_before_it_refused(number: int, zeros: int) -> None:
    assert load_mapping(f'key: {number}', 'file', ('key',)).content == {'key': number}
    sign = '-' if number < 0 else ''
    with pytest.raises(DescriptionError, match='line 2'):
        load_mapping(f'\nkey: {sign}{"0" * zeros}{abs(number)}', 'file', ('key',))
