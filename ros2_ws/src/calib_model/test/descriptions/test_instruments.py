# SPDX-License-Identifier: Apache-2.0
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, strategies as st

from calib_model.descriptions import (
    arm_yaml,
    gauge_yaml,
    parse_arm,
    parse_gauge,
    parse_placements,
    parse_probe,
    probe_yaml,
    read_description,
)
from calib_model.errors import DescriptionError
from calib_model.instruments import (
    CONVENTIONS,
    JOINT_TYPES,
    ActiveProbe,
    Arm,
    ControllerAxis,
    Coupling,
    Gauge,
    Joint,
    PassiveProbe,
    Stylus,
)
from calib_model.transforms import RigidTransform

NUMBER = st.floats(allow_nan=False, allow_infinity=False)
TRIPLE = st.tuples(NUMBER, NUMBER, NUMBER)
TRANSFORM = st.builds(RigidTransform, st.builds(np.array, TRIPLE), st.builds(np.array, TRIPLE))
NAME = st.text(st.characters(codec='utf-8', exclude_categories=('Cs', 'Cc')), min_size=1)

ARM = """\
name: two
joints:
  - {name: j1, a: 0.1, alpha: 0.2, d: 0.3, theta_0: 0.4, limits: [-1, 1], velocity: 2}
  - {name: j2, a: 0.1, alpha: 0.2, d: 0.3, theta_0: 0.4}
"""
PROBE = """\
name: p
kind: active
flange_T_probe: {translation: [0, 0, 0.1], rotation_vector: [0, 0, 0]}
styli:
  - {origin: [0.01, 0, 0], direction: [1, 0, 0], tip_radius: 0.003, stroke: [-0.003, 0.003]}
  - {origin: [0, 0.01, 0], direction: [0, 1, 0], tip_radius: 0.003, stroke: [-0.003, 0.003]}
  - {origin: [0, 0, 0.01], direction: [0, 0, 1], tip_radius: 0.003, stroke: [-0.003, 0.003]}
"""
GAUGE = """\
name: bar
sphere_diameter: 0.022
spheres: [{number: 1, center: [0, 0, 0]}, {number: 6, center: [0.5, 0, 0]}]
uncertainty: {constant: 1e-6, proportional: 1e-6}
"""


@st.composite
def arms(draw: st.DrawFn) -> Arm:
    names = draw(st.lists(NAME, min_size=1, max_size=4, unique=True))
    joints = []
    for name in names:
        low, high = sorted(draw(st.tuples(NUMBER, NUMBER)))
        limits = (low, high) if low < high else (-np.inf, np.inf)
        velocity = draw(st.floats(1e-300, 1e300) | st.just(np.inf))
        values = draw(st.tuples(NUMBER, NUMBER, NUMBER, NUMBER, NUMBER))
        direction = st.sampled_from((1, -1))
        axis = draw(st.none() | st.builds(ControllerAxis, NAME, direction, NUMBER))
        hasty = [draw(st.floats(1e-3, 1e6) | st.just(np.inf)) for _ in range(2)]
        joints.append(Joint(name, *values, draw(direction), limits, velocity, axis, *hasty))
    kind = draw(st.sampled_from(JOINT_TYPES))
    joints = [replace(joint, type=kind) for joint in joints]
    if len(joints) > 1 and draw(st.booleans()):
        joints[1] = replace(joints[1], coupling=Coupling(names[0], draw(NUMBER)))
    placed = [draw(TRANSFORM) for _ in range(3)]
    described_in = draw(st.sampled_from(CONVENTIONS))
    return Arm(draw(NAME), tuple(joints), draw(NAME), draw(NAME), *placed, described_in)


@pytest.mark.slow
@given(arms())
def test_arms_come_back_bit_for_bit(arm: Arm) -> None:
    again = parse_arm(arm_yaml(arm))
    assert again == arm
    assert again.geometry.tobytes() == arm.geometry.tobytes()


@given(NAME, TRIPLE, TRIPLE, TRIPLE)
def test_passive_probes_come_back_bit_for_bit(name: str, t: tuple, r: tuple, c: tuple) -> None:
    probe = PassiveProbe(name, RigidTransform(t, r), np.array(c))
    again = parse_probe(probe_yaml(probe))
    assert isinstance(again, PassiveProbe)
    assert again.name == name
    assert again.center.tobytes() == probe.center.tobytes()
    assert again.flange_T_probe.translation.tobytes() == np.array(t).tobytes()
    assert again.flange_T_probe.rotation_vector.tobytes() == np.array(r).tobytes()


@given(NAME, st.tuples(*[st.tuples(TRIPLE, st.floats(0, 1))] * 3))
def test_active_probes_come_back_bit_for_bit(name: str, shapes: tuple) -> None:
    styli = tuple(Stylus(o, (0.1, 0.7, -0.3), radius, (-0.1, 0.3)) for o, radius in shapes)
    again = parse_probe(probe_yaml(ActiveProbe(name, RigidTransform(), styli)))
    assert isinstance(again, ActiveProbe)
    assert again.styli == styli


@given(NAME, st.floats(1e-300, 1e300), st.dictionaries(st.integers(0, 65535), TRIPLE, min_size=1))
def test_gauges_come_back_bit_for_bit(name: str, diameter: float, spheres: dict) -> None:
    gauge = Gauge(name, diameter, tuple(spheres.items()), 1e-6, 3e-7)
    assert parse_gauge(gauge_yaml(gauge)) == gauge


def test_everything_in_the_configuration_loads_and_is_named_after_its_file(config: Path) -> None:
    parsers = {'arms': parse_arm, 'probes': parse_probe, 'gauges': parse_gauge}
    for folder, parse in parsers.items():
        files = sorted((config / folder).glob('*.yaml'))
        assert len(files) >= 3
        for file in files:
            assert read_description(file, parse).name == file.stem


def test_the_configuration_is_plain_yaml_for_others_too(config: Path) -> None:
    """An exponent without a point is text to YAML 1.1 readers."""

    def numbers(value: object, key: str = '') -> None:
        if isinstance(value, dict):
            for name, item in value.items():
                numbers(item, name)
        elif isinstance(value, list):
            for item in value:
                numbers(item, key)
        elif key not in ('name', 'kind', 'base_frame', 'flange_frame', 'axis'):
            assert isinstance(value, int | float), f'{key}: {value!r}'

    for folder in ('arms', 'probes', 'gauges'):
        for file in (config / folder).glob('*.yaml'):
            numbers(yaml.safe_load(file.read_text()))


def test_what_is_optional_may_be_left_out() -> None:
    first, second = parse_arm(ARM).joints
    assert (first.limits, first.velocity, first.beta, first.direction) == ((-1.0, 1.0), 2.0, 0.0, 1)
    assert second.limits == (-np.inf, np.inf)
    assert parse_arm(ARM).base_frame == 'base_link'
    assert (first.controller, parse_arm(ARM).base_T_dh.is_identity) == (None, True)


def test_an_arm_without_transforms_is_written_as_before() -> None:
    assert '_T_' not in arm_yaml(parse_arm(ARM))
    assert 'controller' not in arm_yaml(parse_arm(ARM))


@pytest.mark.parametrize(
    ('parse', 'text', 'old', 'new', 'message'),
    [
        (parse_arm, ARM, 'd: 0.3, theta_0: 0.4}', 'theta_0: 0.4}', "joints[2]: missing key 'd'"),
        (parse_arm, ARM, 'a: 0.1', 'a: wide', "joints[1].a: expected a number, got 'wide'"),
        (parse_arm, ARM, 'a: 0.1', 'a: true', 'joints[1].a: expected a number, got true/false'),
        (parse_arm, ARM, 'a: 0.1', 'a: .nan', 'joints[1].a: expected a finite number'),
        (parse_arm, ARM, 'a: 0.1', 'a: .inf', 'joints[1].a: expected a finite number'),
        (parse_arm, ARM, 'a: 0.1', 'a: [1]', 'joints[1].a: expected a number, got a list'),
        (parse_arm, ARM, 'alpha: 0.2', 'alhpa: 0.2', "unknown key 'alhpa': is it 'alpha'?"),
        (parse_arm, ARM, 'name: j2', 'name: j1', "two joints are called 'j1'"),
        (parse_arm, ARM, '[-1, 1]', '[1, -1]', 'joints[1].limits: expected [lower, upper]'),
        (parse_arm, ARM, '[-1, 1]', '[1]', 'joints[1].limits: expected 2 numbers, got 1'),
        (parse_arm, ARM, 'velocity: 2', 'velocity: 0', 'expected a speed above zero'),
        (parse_arm, ARM, 'velocity: 2', 'acceleration: -3', 'expected a number above zero'),
        (parse_arm, ARM, 'velocity: 2', 'jerk: .nan', 'jerk'),
        (parse_arm, ARM, 'a: 0.1', 'direction: 2, a: 0.1', 'direction: expected 1 or -1'),
        (parse_arm, ARM, 'a: 0.1', 'type: sliding, a: 0.1', 'expected revolute or prismatic, got'),
        (parse_arm, ARM, 'a: 0.1', 'coupling: {joint: j3}, a: 0.1', "coupled to 'j3', expected"),
        (parse_arm, ARM, 'a: 0.1', 'coupling: {joint: j1}, a: 0.1', 'another joint that has none'),
        (parse_arm, ARM, 'a: 0.1', 'coupling: {factor: 1}, a: 0.1', "missing key 'joint'"),
        (parse_arm, ARM, 'joints:', 'convention: craig\njoints:', 'expected classic or modified'),
        (parse_arm, ARM, 'name: two', 'name: &x two', 'aliases are not supported'),
        (parse_arm, ARM, 'name: two', 'name: !!str two', 'line 1: YAML tags are not supported'),
        (parse_arm, ARM, 'a: 0.1', 'a: 0.1, a: 0.2', "line 3: not valid YAML: key 'a' is"),
        (parse_arm, ARM, 'name: two\n', '', "missing key 'name'"),
        (parse_arm, ARM, 'joints:', 'joints: {', 'not valid YAML'),
        (parse_probe, PROBE, 'kind: active', 'kind: clever', "expected 'active' or 'passive'"),
        (parse_probe, PROBE, 'direction: [1, 0, 0]', 'direction: [0, 0, 0]', 'not zero'),
        (parse_probe, PROBE, 'tip_radius: 0.003', 'tip_radius: -1', 'styli[1].tip_radius'),
        (parse_probe, PROBE, '[-0.003, 0.003]', '[0.003, -0.003]', 'styli[1].stroke: expected'),
        (parse_probe, PROBE, PROBE.splitlines()[-1], '', 'expected 3 styli, got 2'),
        (parse_probe, PROBE, '[0, 0, 0.1]', '[0, 0.1]', 'expected 3 numbers, got 2'),
        (parse_probe, PROBE, 'flange_T_probe', 'flange_t_probe', "is it 'flange_T_probe'?"),
        (parse_gauge, GAUGE, 'number: 6', 'number: 1', 'sphere 1 is listed twice'),
        (parse_gauge, GAUGE, 'number: 6', 'number: 6.5', 'expected a whole number'),
        (parse_gauge, GAUGE, 'number: 6', 'number: 70000', 'from 0 to 65535'),
        (parse_gauge, GAUGE, '0.022', '-0.022', 'expected a diameter above zero'),
        (parse_gauge, GAUGE, '0.022', '1e999', 'expected a finite number'),
        (parse_gauge, GAUGE, 'constant: 1e-6', 'constant: abc', 'uncertainty.constant: expected'),
    ],
)
def test_errors_name_the_source_the_place_and_what_is_due(
    parse: Callable[[str, str], object], text: str, old: str, new: str, message: str
) -> None:
    assert old in text
    changed = text.replace(old, new, 1)
    if 'aliases' in message:
        changed = changed.replace('name: j1', 'name: *x')
    with pytest.raises(DescriptionError) as caught:
        parse(changed, 'mine.yaml')
    assert str(caught.value).startswith('mine.yaml')
    assert message in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize('parse', [parse_arm, parse_probe, parse_gauge, parse_placements])
@pytest.mark.parametrize(
    'text',
    [
        '',
        '3',
        '[]',
        'null',
        'a: b: c',
        '\x00',
        '{' * 5000,
        '- ' * 5000,
        '2020-13-45: 1',
        '? [1]',
        '!!python/object/apply:os.system [true]',
        'x' * 5_000_000,
        '<<: 3',
        '"\\ud800": 1',
        '? {a: b}',
        'name: 2020-99-99',
        'name: !!binary "@"',
        'name: !!timestamp x',
        'name: !!int x',
        'name: !!bool x',
        'name: !!int ""',
        '1: 2',
    ],
)
def test_whatever_the_text_it_is_a_description_error(parse: Callable, text: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        parse(text, 'mine.yaml')
    assert '\n' not in str(caught.value)


@given(st.data())
def test_damaged_text_is_refused_or_read_never_a_crash(data: st.DataObject) -> None:
    parse, text = data.draw(
        st.sampled_from(((parse_arm, ARM), (parse_probe, PROBE), (parse_gauge, GAUGE)))
    )
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 12)))
    changed = text[:start] + data.draw(st.text(max_size=6)) + text[end:]
    try:
        parse(changed, 'mine.yaml')
    except DescriptionError as error:
        assert str(error).startswith('mine.yaml')


def test_a_number_written_as_1e_minus_6_is_a_number() -> None:
    assert parse_gauge(GAUGE).constant == 1e-6


def test_a_file_that_cannot_be_read_says_so(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r'none\.yaml: cannot be read: No such file'):
        read_description(tmp_path / 'none.yaml', parse_arm)
    (tmp_path / 'binary.yaml').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(DescriptionError, match=r'binary\.yaml: cannot be read: not a text file'):
        read_description(tmp_path / 'binary.yaml', parse_arm)
    with pytest.raises(DescriptionError, match='cannot be read: Is a directory'):
        read_description(tmp_path, parse_arm)


def test_placements_are_read_by_location_number() -> None:
    text = 'locations: [{number: 2, translation: [1, 2, 3], rotation_vector: [0, 0, 1]}]'
    ((number, placed),) = parse_placements(text).items()
    assert number == 2
    assert placed.translation.tolist() == [1, 2, 3]
    with pytest.raises(DescriptionError, match='location 2 is listed twice'):
        parse_placements(text.replace(']}]', ']}, ' + text[12:].lstrip('[')))
