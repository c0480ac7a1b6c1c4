# SPDX-License-Identifier: Apache-2.0
"""The description of an arm as YAML: the same text in files, on topics and in results."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib_model.descriptions.modified_dh import classic_of_modified
from calib_model.descriptions.text import transform_of, transform_row, yaml_text
from calib_model.errors import DataError, DescriptionError
from calib_model.files import Fields, load_mapping
from calib_model.instruments import (
    CLASSIC,
    CONVENTIONS,
    JOINT_TYPES,
    MODIFIED,
    REVOLUTE,
    Arm,
    ControllerAxis,
    Coupling,
    Joint,
)
from calib_model.transforms import RigidTransform

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
MOST_JOINTS = 100


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
        transform_of(top, key) if key in top else RigidTransform() for key in ARM_TRANSFORMS
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
            top[key] = transform_row(getattr(arm, key))
    return yaml_text({**top, 'joints': joints})
