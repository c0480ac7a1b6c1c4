# SPDX-License-Identifier: Apache-2.0
"""What was identified beyond D-H, joint errors and eq. 12, as YAML."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib_model.arrays import Array
from calib_model.descriptions.links import links_of, links_rows
from calib_model.descriptions.text import yaml_text
from calib_model.errors import DescriptionError
from calib_model.files import Fields, load_mapping
from calib_model.kinematics import (
    Attitude,
    Correction,
    JointErrors,
    JointTerms,
    Shift,
)

COORDINATES = ('x', 'y', 'z')


def parse_correction(text: str, source: str = 'correction') -> Correction:
    """A correction from its YAML text.

    Raises:
        DescriptionError: a key is missing, unknown, or has a value of the wrong kind.
    """
    top = load_mapping(text, source, ('joints', 'joint_errors', 'repeatability'))
    names = top.content.get('joints')
    if not isinstance(names, list) or not names or not all(isinstance(x, str) for x in names):
        raise top.refuse('joints', "expected the list of the joints' names")
    joints = tuple(names)
    errors = turn = shift = attitude = None
    if 'joint_errors' in top:
        row = top.mapping('joint_errors', ('encoder', 'scale', 'compliance', 'load'))
        errors = _joint_errors(row, joints)
    if 'repeatability' in top:
        rows = top.mapping('repeatability', ('turn', 'shift', 'attitude'))
        if 'turn' in rows:
            values = _harmonics(rows, 'turn', ('cosine', 'sine'), len(joints))
            turn = JointErrors(JointTerms(len(values) // 2), values)
        if 'shift' in rows:
            keys = tuple(f'{part}_{c}' for part in ('cosine', 'sine') for c in COORDINATES)
            series = _harmonics(rows, 'shift', keys, len(joints))
            shift = Shift(series.reshape(-1, 3, len(joints)))
        if 'attitude' in rows:
            of = rows.mapping('attitude', COORDINATES)
            values = np.array([of.numbers(c, 9) for c in COORDINATES])
            attitude = Attitude(values.reshape(3, 3, 3))
    if all(part is None for part in (errors, turn, shift, attitude)):
        raise DescriptionError(source, '', "expected 'joint_errors' or 'repeatability'")
    return Correction(joints, errors, turn, shift, attitude)


def _joint_errors(row: Fields, joints: tuple[str, ...]) -> JointErrors:
    values, harmonics, links = [], 0, None
    if 'encoder' in row:
        encoder = _harmonics(row, 'encoder', ('cosine', 'sine'), len(joints))
        values.append(encoder)
        harmonics = len(encoder) // 2
    if 'scale' in row:
        values.append(np.array([row.numbers('scale', len(joints))]))
    if 'compliance' in row:
        values.append(np.array([row.numbers('compliance', len(joints))]))
        links = links_of(row.mapping('load', ('gravity', 'links')), joints)
    if not values:
        wanted = "expected 'encoder', 'scale' or 'compliance'"
        raise DescriptionError(row.source, row.where, wanted)
    return JointErrors(JointTerms(harmonics, links, 'scale' in row), np.concatenate(values))


def _harmonics(top: Fields, key: str, parts: tuple[str, ...], n: int) -> Array:
    """Rows of one order each, from 1 on, as an array (orders * len(parts), n)."""
    found = []
    for order, row in enumerate(top.rows(key, ('order', *parts)), start=1):
        if row.number('order') != order:
            raise row.refuse('order', f'expected {order}: the orders from 1 on, in turn')
        found += [row.numbers(part, n) for part in parts]
    return np.array(found)


def correction_yaml(correction: Correction) -> str:
    """The YAML text of a correction; every number comes back bit for bit."""
    top: dict[str, Any] = {'joints': list(correction.joint_names)}
    errors = correction.joint_errors
    if errors is not None:
        rows: dict[str, Any] = {}
        if errors.terms.harmonics:
            rows['encoder'] = _orders(errors.values[: 2 * errors.terms.harmonics], ('',))
        if errors.terms.scale:
            rows['scale'] = errors.values[2 * errors.terms.harmonics].tolist()
        if errors.terms.links is not None:
            rows['compliance'] = errors.values[-1].tolist()
            rows['load'] = links_rows(errors.terms.links, correction.joint_names)
        top['joint_errors'] = rows
    found: dict[str, Any] = {}
    if correction.turn is not None:
        found['turn'] = _orders(correction.turn.values, ('',))
    if correction.shift is not None:
        values = correction.shift.values
        found['shift'] = _orders(
            values.reshape(-1, values.shape[-1]), tuple(f'_{c}' for c in COORDINATES)
        )
    if correction.attitude is not None:
        rows_9 = correction.attitude.values.reshape(3, 9).tolist()
        found['attitude'] = dict(zip(COORDINATES, rows_9, strict=True))
    if found:
        top['repeatability'] = found
    return yaml_text(top)


def _orders(values: Array, endings: tuple[str, ...]) -> list[dict[str, Any]]:
    """What `_harmonics` reads."""
    parts = [f'{part}{ending}' for part in ('cosine', 'sine') for ending in endings]
    rows = []
    for order, block in enumerate(values.reshape(-1, len(parts), values.shape[-1]), start=1):
        named = {part: row.tolist() for part, row in zip(parts, block, strict=True)}
        rows.append({'order': order, **named})
    return rows
