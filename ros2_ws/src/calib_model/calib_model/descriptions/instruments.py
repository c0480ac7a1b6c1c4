# SPDX-License-Identifier: Apache-2.0
"""Arm, probe and gauge descriptions as YAML: the same text in files, on topics and in results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml

from calib_model.descriptions.modified_dh import classic_of_modified
from calib_model.errors import DataError, DescriptionError
from calib_model.files import LARGEST_TEXT, Fields, file_content, load_mapping
from calib_model.instruments import (
    CLASSIC,
    CONVENTIONS,
    JOINT_TYPES,
    MODIFIED,
    REVOLUTE,
    STYLI,
    ActiveProbe,
    Arm,
    ControllerAxis,
    Coupling,
    Expansion,
    Gauge,
    Joint,
    PassiveProbe,
    Probe,
    Stylus,
)
from calib_model.transforms import RigidTransform

T = TypeVar('T')
ARM_TRANSFORMS = ('base_T_dh', 'dh_T_flange', 'flange_T_controller')
JOINT_KEYS = (
    'name',
    'a',
    'alpha',
    'd',
    'theta_0',
    'beta',
    'direction',
    'limits',
    'velocity',
    'acceleration',
    'jerk',
    'controller',
    'type',
    'coupling',
)
TRANSFORM_KEYS = ('translation', 'rotation_vector')
LARGEST_BYTES = 4 * LARGEST_TEXT  # of a file, whatever the characters
MOST_JOINTS = 100
MOST_SPHERES = 1000
LARGEST_EXPANSION = 1e-3  # 1/K: forty times that of aluminium


def read_description(path: str | Path, parse: Callable[[str, str], T]) -> T:
    """The description in a file, by one of the parsers below.

    Raises:
        DescriptionError: the file cannot be read or its content cannot be used.
    """
    path = Path(path)
    try:
        text = file_content(path, LARGEST_BYTES).decode('utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'not a text file'
        raise DescriptionError(str(path), '', f'cannot be read: {reason}') from error
    return parse(text, str(path))


def parse_arm(text: str, source: str = 'arm description') -> Arm:
    """An arm from its YAML text; `source` is what error messages call it.

    Raises:
        DescriptionError: a key is missing, unknown, or has a value of the wrong kind.
    """
    keys = ('name', 'base_frame', 'flange_frame', 'convention', 'joints', *ARM_TRANSFORMS)
    top = load_mapping(text, source, keys)
    rows = top.rows('joints', JOINT_KEYS)
    if len(rows) > MOST_JOINTS:
        raise top.refuse('joints', f'expected {MOST_JOINTS} at most, got {len(rows)}')
    joints = tuple(_joint(row) for row in rows)
    names = [joint.name for joint in joints]
    for name in names:
        if names.count(name) > 1:
            raise DescriptionError(source, 'joints', f'two joints are called {name!r}')
    base, flange, controller = (
        _transform(top, key) if key in top else RigidTransform() for key in ARM_TRANSFORMS
    )
    convention, described_in = _convention(top, 'convention'), _convention(top, 'described_in')
    if convention == MODIFIED:
        joints, base = classic_of_modified(joints, base)
        described_in = MODIFIED
    frames = top.text('base_frame', 'base_link'), top.text('flange_frame', 'tool0')
    try:
        return Arm(top.text('name'), joints, *frames, base, flange, controller, described_in)
    except DataError as error:  # joints that are not coupled as joints can be
        raise DescriptionError(source, 'joints', str(error)) from error


def _convention(top: Fields, key: str) -> str:
    """Classic parameters are turned about z first, modified ones (Craig's) about x."""
    convention = top.text(key, CLASSIC)
    if convention not in CONVENTIONS:
        raise top.refuse(key, f'expected {" or ".join(CONVENTIONS)}, got {convention[:40]!r}')
    return convention


def _transform(top: Fields, key: str) -> RigidTransform:
    """A rigid transform, m and rad; what is not there is zero."""
    row = top.mapping(key, TRANSFORM_KEYS)
    translation, turn = (row.numbers(name, 3, (0.0, 0.0, 0.0)) for name in TRANSFORM_KEYS)
    return RigidTransform(np.array(translation), np.array(turn))


def _direction(row: Fields) -> int:
    direction = row.number('direction', 1.0)
    if direction not in (1.0, -1.0):
        raise row.refuse('direction', 'expected 1 or -1')
    return int(direction)


def _controller(row: Fields) -> ControllerAxis | None:
    if 'controller' not in row:
        return None
    axis = row.mapping('controller', ('axis', 'direction', 'zero'))
    return ControllerAxis(axis.text('axis'), _direction(axis), axis.number('zero', 0.0))


def _type(row: Fields) -> str:
    kind = row.text('type', REVOLUTE)
    if kind not in JOINT_TYPES:
        raise row.refuse('type', f'expected {" or ".join(JOINT_TYPES)}, got {kind[:40]!r}')
    return kind


def _coupling(row: Fields) -> Coupling | None:
    if 'coupling' not in row:
        return None
    other = row.mapping('coupling', ('joint', 'factor'))
    return Coupling(other.text('joint'), other.number('factor', 1.0))


def _joint(row: Fields) -> Joint:
    direction = _direction(row)
    lower, upper = row.numbers('limits', 2, (-np.inf, np.inf), finite=False)
    if not lower < upper:
        raise row.refuse('limits', 'expected [lower, upper] with lower < upper')
    velocity = row.number('velocity', np.inf, finite=False)
    if not velocity > 0:
        raise row.refuse('velocity', 'expected a speed above zero')
    a, alpha, d, theta_0 = (row.number(key) for key in ('a', 'alpha', 'd', 'theta_0'))
    return Joint(
        row.text('name'),
        a,
        alpha,
        d,
        theta_0,
        row.number('beta', 0.0),
        direction,
        (lower, upper),
        velocity,
        _controller(row),
        _above_zero(row, 'acceleration'),
        _above_zero(row, 'jerk'),
        _type(row),
        _coupling(row),
    )


def _above_zero(row: Fields, key: str) -> float:
    """A limit of motion; none where it is not given."""
    limit = row.number(key, np.inf, finite=False)
    if not limit > 0:
        raise row.refuse(key, 'expected a number above zero')
    return limit


def parse_probe(text: str, source: str = 'probe description') -> Probe:
    """A probe from its YAML text.

    Raises:
        DescriptionError: a key is missing, unknown, or has a value of the wrong kind.
    """
    top = load_mapping(
        text, source, ('name', 'kind', 'flange_T_probe', 'styli', 'center', 'simulated')
    )
    name, kind = top.text('name'), top.text('kind')
    flange_T_probe = _transform(top, 'flange_T_probe')
    simulated = top.content.get('simulated', False)
    if not isinstance(simulated, bool):
        raise top.refuse('simulated', f'expected true or false, got {simulated!r:.40}')
    if kind == 'passive':
        center = top.numbers('center', 3, (0.0, 0.0, 0.0))
        return PassiveProbe(name, flange_T_probe, np.array(center), simulated)
    if kind != 'active':
        raise top.refuse('kind', f"expected 'active' or 'passive', got {kind[:40]!r}")
    rows = top.rows('styli', ('origin', 'direction', 'tip_radius', 'stroke'))
    if len(rows) != STYLI:
        raise top.refuse('styli', f'expected {STYLI} styli, got {len(rows)}')
    first, second, third = (_stylus(row) for row in rows)
    return ActiveProbe(name, flange_T_probe, (first, second, third), simulated)


def _stylus(row: Fields) -> Stylus:
    origin, direction = row.numbers('origin', 3), row.numbers('direction', 3)
    if not 1e-9 < max(map(abs, direction)) < 1e9:
        raise row.refuse('direction', 'expected a vector that is not zero, nor huge')
    lower, upper = row.numbers('stroke', 2)
    if not lower < upper:
        raise row.refuse('stroke', 'expected [free, blocked] with free < blocked')
    tip_radius = row.number('tip_radius')
    if tip_radius < 0:
        raise row.refuse('tip_radius', 'expected a radius, not a negative number')
    return Stylus(_triple(origin), _triple(direction), tip_radius, (lower, upper))


def parse_gauge(text: str, source: str = 'gauge description') -> Gauge:
    """A gauge from its YAML text.

    Raises:
        DescriptionError: a key is missing, unknown, or has a value of the wrong kind.
    """
    top = load_mapping(
        text, source, ('name', 'sphere_diameter', 'spheres', 'uncertainty', 'expansion')
    )
    diameter = top.number('sphere_diameter')
    if not diameter > 0:
        raise top.refuse('sphere_diameter', 'expected a diameter above zero')
    spheres: list[tuple[int, tuple[float, float, float]]] = []
    rows = top.rows('spheres', ('number', 'center'))
    if len(rows) > MOST_SPHERES:
        raise top.refuse('spheres', f'expected {MOST_SPHERES} at most, got {len(rows)}')
    for row in rows:
        number = row.number('number')
        if number != int(number) or not 0 <= number <= 65535:
            raise row.refuse('number', 'expected a whole number from 0 to 65535')
        if int(number) in [known for known, _ in spheres]:
            raise row.refuse('number', f'sphere {int(number)} is listed twice')
        spheres.append((int(number), _triple(row.numbers('center', 3))))
    constant, proportional = 0.0, 0.0
    if 'uncertainty' in top:
        uncertainty = top.mapping('uncertainty', ('constant', 'proportional'))
        constant = uncertainty.number('constant', 0.0)
        proportional = uncertainty.number('proportional', 0.0)
    expansion = _expansion(top) if 'expansion' in top else None
    return Gauge(top.text('name'), diameter, tuple(spheres), constant, proportional, expansion)


def _expansion(top: Fields) -> Expansion:
    row = top.mapping('expansion', ('coefficient', 'uncertainty', 'reference'))
    coefficient, uncertainty = row.number('coefficient'), row.number('uncertainty', 0.0)
    if not abs(coefficient) <= LARGEST_EXPANSION:
        span = f'-{LARGEST_EXPANSION:g} to {LARGEST_EXPANSION:g}'
        raise row.refuse('coefficient', f'expected 1/K from {span}, as in 11.5e-6 of steel')
    if not 0 <= uncertainty <= LARGEST_EXPANSION:
        raise row.refuse('uncertainty', f'expected 1/K from 0 to {LARGEST_EXPANSION:g}')
    reference = row.number('reference', 20.0)
    if not -100 <= reference <= 200:
        raise row.refuse('reference', 'expected deg C, as in 20.0')
    return Expansion(coefficient, uncertainty, reference)


def _triple(values: tuple[float, ...]) -> tuple[float, float, float]:
    x, y, z = values
    return (x, y, z)


def arm_yaml(arm: Arm) -> str:
    """The YAML text of an arm; every number comes back bit for bit."""
    joints = []
    for joint in arm.joints:
        row: dict[str, Any] = {'name': joint.name}
        row |= {key: getattr(joint, key) for key in ('a', 'alpha', 'd', 'theta_0')}
        row |= {'beta': joint.beta, 'direction': joint.direction}
        if joint.prismatic:
            row['type'] = joint.type
        if joint.coupling is not None:
            row['coupling'] = {'joint': joint.coupling.joint, 'factor': joint.coupling.factor}
        if np.isfinite(joint.limits).any():
            row['limits'] = list(joint.limits)
        for key in ('velocity', 'acceleration', 'jerk'):
            if np.isfinite(getattr(joint, key)):
                row[key] = getattr(joint, key)
        if joint.controller is not None:
            axis = joint.controller
            row['controller'] = {'axis': axis.name, 'direction': axis.direction, 'zero': axis.zero}
        joints.append(row)
    top: dict[str, Any] = {
        'name': arm.name,
        'base_frame': arm.base_frame,
        'flange_frame': arm.flange_frame,
    }
    if arm.described_in != CLASSIC:
        # what stands here is classic all the same
        top |= {'convention': CLASSIC, 'described_in': arm.described_in}
    for key in ARM_TRANSFORMS:
        if not getattr(arm, key).is_identity:
            top[key] = _transform_row(getattr(arm, key))
    return yaml_text({**top, 'joints': joints})


def _transform_row(transform: RigidTransform) -> dict[str, list[float]]:
    return {key: getattr(transform, key).tolist() for key in TRANSFORM_KEYS}


def probe_yaml(probe: Probe) -> str:
    """The YAML text of a probe; every number comes back bit for bit."""
    top: dict[str, Any] = {'name': probe.name, 'kind': probe.kind}
    top['flange_T_probe'] = _transform_row(probe.flange_T_probe)
    if isinstance(probe, PassiveProbe):
        top['center'] = probe.center.tolist()
    else:
        top['styli'] = [
            {
                'origin': list(s.origin),
                'direction': list(s.direction),
                'tip_radius': s.tip_radius,
                'stroke': list(s.stroke),
            }
            for s in probe.styli
        ]
    if probe.simulated:
        top['simulated'] = True
    return yaml_text(top)


def gauge_yaml(gauge: Gauge) -> str:
    """The YAML text of a gauge; every number comes back bit for bit."""
    content: dict[str, Any] = {
        'name': gauge.name,
        'sphere_diameter': gauge.sphere_diameter,
        'spheres': [{'number': n, 'center': list(center)} for n, center in gauge.spheres],
        'uncertainty': {'constant': gauge.constant, 'proportional': gauge.proportional},
    }
    if gauge.expansion is not None:
        content['expansion'] = vars(gauge.expansion)
    return yaml_text(content)


class _Dumper(yaml.SafeDumper):
    """Numbers as YAML 1.1 reads them back: an exponent wants a point before it."""


def _float(dumper: yaml.SafeDumper, value: float) -> yaml.ScalarNode:
    return yaml.SafeDumper.represent_float(dumper, float(value))


_Dumper.add_multi_representer(float, _float)  # numpy floats are floats too


def yaml_text(value: dict[str, Any]) -> str:
    """YAML text that reads back bit for bit, keys in their order."""
    text: str = yaml.dump(
        value, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=100
    )
    return text
