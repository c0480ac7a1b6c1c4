# SPDX-License-Identifier: Apache-2.0
"""Descriptions in Craig's convention stand where his matrices put them."""

from __future__ import annotations

import numpy as np
import pytest

from calib_model.descriptions import arm_yaml, parse_arm
from calib_model.kinematics import forward_kinematics

#: a, alpha, d, theta_0 row by row, as the makers of a seven-axis arm publish them (m, rad)
PUBLISHED = (
    (0.0, 0.0, 0.333, 0.0),
    (0.0, -np.pi / 2, 0.0, 0.0),
    (0.0, np.pi / 2, 0.316, 0.0),
    (0.0825, np.pi / 2, 0.0, 0.0),
    (-0.0825, -np.pi / 2, 0.384, 0.0),
    (0.0, np.pi / 2, 0.0, 0.0),
    (0.088, np.pi / 2, 0.107, 0.0),
)


def craig(rows: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """The product of Craig's matrices (his eq. 3.6), element by element."""
    matrix = np.eye(4)
    for (a, alpha, d, theta_0), turn in zip(rows, moved, strict=True):
        c, s, ca, sa = np.cos(turn - theta_0), np.sin(turn - theta_0), np.cos(alpha), np.sin(alpha)
        step = [
            [c, -s, 0, a],
            [s * ca, c * ca, -sa, -d * sa],
            [s * sa, c * sa, ca, d * ca],
            [0, 0, 0, 1],
        ]
        matrix = matrix @ np.array(step)
    return matrix


def text(rows: np.ndarray, directions: np.ndarray, top: str = '') -> str:
    lines = [
        f'  - {{name: j{i}, a: {a!r}, alpha: {alpha!r}, d: {d!r}, theta_0: {zero!r}, '
        f'direction: {direction}}}'
        for i, ((a, alpha, d, zero), direction) in enumerate(
            zip(rows.tolist(), directions, strict=True)
        )
    ]
    return '\n'.join(['name: craigs', f'convention: modified\n{top}joints:', *lines])


def arms() -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(1)
    anyhow = [(rng.uniform(-2, 2, (5, 4)), rng.choice([-1, 1], 5)) for _ in range(5)]
    return [(np.array(PUBLISHED), np.ones(7, dtype=int)), *anyhow]


@pytest.mark.parametrize('case', range(6))
def test_the_flange_is_where_craigs_matrices_put_it(case: int) -> None:
    rows, directions = arms()[case]
    arm = parse_arm(text(rows, directions))
    q = np.random.default_rng(2).uniform(-3, 3, (20, len(rows)))
    expected = [craig(rows, directions * row) for row in q]
    np.testing.assert_allclose(forward_kinematics(arm, q), expected, rtol=0, atol=1e-14)


def test_transforms_before_and_behind_stay_where_they_are() -> None:
    rows, directions = arms()[3]
    base = 'base_T_dh: {translation: [1, 2, 3], rotation_vector: [0.1, 0.2, 0.3]}\n'
    flange = 'dh_T_flange: {translation: [0.1, 0, 0.2], rotation_vector: [0.3, 0, -0.3]}\n'
    bare, arm = parse_arm(text(rows, directions)), parse_arm(text(rows, directions, base + flange))
    q = np.random.default_rng(3).uniform(-3, 3, (5, len(rows)))
    given = parse_arm(
        f'{base}{flange}name: x\njoints: [{{name: j, a: 0, alpha: 0, d: 0, theta_0: 0}}]'
    )
    expected = given.base_T_dh.matrix() @ forward_kinematics(bare, q) @ given.dh_T_flange.matrix()
    np.testing.assert_allclose(forward_kinematics(arm, q), expected, rtol=0, atol=1e-14)


def test_what_is_written_is_classic_and_says_where_it_is_from() -> None:
    rows, directions = arms()[0]
    arm = parse_arm(text(rows, directions))
    assert arm.described_in == 'modified'
    assert 'convention: classic\ndescribed_in: modified\n' in arm_yaml(arm)
    assert parse_arm(arm_yaml(arm)) == arm
