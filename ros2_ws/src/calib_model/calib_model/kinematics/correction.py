# SPDX-License-Identifier: Apache-2.0
"""What is corrected beyond the D-H parameters: joint errors, and the functions of eq. 12."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from calib_model.arm import Arm
from calib_model.description import yaml_text
from calib_model.errors import DataError, DescriptionError
from calib_model.fields import Fields, load_mapping
from calib_model.gravity import links_of, links_rows
from calib_model.joint_errors import JointErrors, JointTerms, harmonic_basis
from calib_model.kinematics import forward
from calib_model.rotation import Array, frozen

COORDINATES = ('x', 'y', 'z')


@dataclass(frozen=True, eq=False)
class Shift:
    """A harmonic series in every joint for each coordinate of the base frame, m.

    `values` (2 K, 3, n): cosine and sine, in turn, of 1 .. K times each joint's angle.
    """

    values: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, 'values', frozen(self.values))

    def at(self, q: Array) -> Array:
        """The shift (N, 3), m, at postures q (N, n), rad."""
        basis = harmonic_basis(q, len(self.values) // 2)
        shift: Array = np.einsum('ntj,tkj->nk', basis, self.values)
        return shift


@dataclass(frozen=True, eq=False)
class Attitude:
    """For each coordinate of the base frame a sum of how the flange is turned, m.

    `values` (3, 3, 3): of coordinate c with element (a, b) of the flange's rotation in the base.
    A gauge that yields to a probe moves with the direction it is pushed from.
    """

    values: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, 'values', frozen(self.values))

    def at(self, arm: Arm, q: Array) -> Array:
        """The shift (N, 3), m, at postures q (N, n), rad."""
        shift: Array = np.einsum('nab,cab->nc', forward(arm, q)[:, :3, :3], self.values)
        return shift


@dataclass(frozen=True, eq=False)
class Correction:
    """What to add to the D-H model of the arm with these joints.

    `joint_errors` were identified together with the parameters. The correction of eq. 12, found
    afterwards from what was left, is f(q) = p(q + turn(q)) - p(q) + shift(q) + attitude(q): `turn`
    says what follows a joint's lever over the workspace, `shift` what does not, and `attitude`
    what depends on how the probe is held.
    """

    joint_names: tuple[str, ...]
    joint_errors: JointErrors | None = None
    turn: JointErrors | None = None
    shift: Shift | None = None
    attitude: Attitude | None = None

    def checked(self, arm: Arm) -> Correction:
        """Itself, when it is one for `arm`.

        Raises:
            DataError: the joints are other ones.
        """
        if self.joint_names != arm.joint_names:
            raise DataError(
                f'correction: is for joints {", ".join(self.joint_names)}, '
                f'{arm.name} has {", ".join(arm.joint_names)}'
            )
        return self

    def joints(self, arm: Arm, q: Array) -> Array:
        """Where the joints are (N, n), rad, when the encoders read q (N, n).

        Raises:
            DataError: `q` has not the arm's number of joints.
        """
        there = arm.check_joints(q)
        for errors in (self.joint_errors, self.turn):
            if errors is not None:
                there = there + errors.angles(arm, q)
        return there

    def shifts(self, arm: Arm, q: Array) -> Array:
        """What is added to the position of the probed point (N, 3), m, base frame.

        Raises:
            DataError: `q` has not the arm's number of joints.
        """
        q = arm.check_joints(q)
        added: Array = np.zeros((len(q), 3))
        if self.shift is not None:
            added += self.shift.at(q)
        if self.attitude is not None:
            added += self.attitude.at(arm, q)
        return added


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
        row = top.mapping('joint_errors', ('encoder', 'compliance', 'load'))
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
    if 'compliance' in row:
        values.append(np.array([row.numbers('compliance', len(joints))]))
        links = links_of(row.mapping('load', ('gravity', 'links')), joints)
    if not values:
        raise DescriptionError(row.source, row.where, "expected 'encoder' or 'compliance'")
    return JointErrors(JointTerms(harmonics, links), np.concatenate(values))


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
