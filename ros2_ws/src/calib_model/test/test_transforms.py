# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from calib_model.transforms import (
    RigidTransform,
    nearest_rotation,
    quaternion_rotations,
    rotation_matrix,
    rotation_vector,
    rotation_vector_quaternion,
    rotation_vectors,
)

NUMBERS = st.floats(-10, 10, allow_subnormal=False)
VECTORS = arrays(np.float64, 3, elements=NUMBERS)


@given(VECTORS)
def test_rotation_matrix_is_scipys(r: np.ndarray) -> None:
    np.testing.assert_allclose(rotation_matrix(r), Rotation.from_rotvec(r).as_matrix(), atol=5e-15)


@given(VECTORS)
def test_rotation_vector_round_trip(r: np.ndarray) -> None:
    matrix = rotation_matrix(r)
    back = rotation_vector(matrix)
    assert np.linalg.norm(back) <= np.pi + 1e-15
    np.testing.assert_allclose(rotation_matrix(back), matrix, rtol=0, atol=2e-14)


@pytest.mark.parametrize('angle', [0.0, 1e-300, 1e-16, 1e-9, 9.99e-3, 1.001e-2, 1.0, 3.0])
@pytest.mark.parametrize('axis', [(1, 0, 0), (0, -1, 0), (0.6, 0.0, -0.8), (0.48, 0.6, 0.64)])
def test_small_and_large_angles_come_back(angle: float, axis: tuple[float, ...]) -> None:
    r = angle * np.array(axis)
    np.testing.assert_allclose(rotation_vector(rotation_matrix(r)), r, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize('axis', [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, -0.8, 0.0)])
@pytest.mark.parametrize('short_of_pi', [0.0, 1e-12, 1e-8, 1e-4])
def test_half_turns_come_back(axis: tuple[float, ...], short_of_pi: float) -> None:
    matrix = rotation_matrix((np.pi - short_of_pi) * np.array(axis))
    np.testing.assert_allclose(rotation_matrix(rotation_vector(matrix)), matrix, atol=1e-15)


@given(VECTORS, arrays(np.float64, (3, 3), elements=st.floats(-0.05, 0.05)))
def test_nearest_rotation_is_procrustes_and_proper(r: np.ndarray, noise: np.ndarray) -> None:
    matrix = rotation_matrix(r) + noise
    nearest = nearest_rotation(matrix)
    np.testing.assert_allclose(nearest.T @ nearest, np.eye(3), atol=1e-14)
    assert np.linalg.det(nearest) > 0
    # stationary: nearest' matrix is symmetric exactly at the best rotation
    product = nearest.T @ matrix
    np.testing.assert_allclose(product, product.T, atol=1e-13)


@given(VECTORS, VECTORS, VECTORS)
def test_a_transform_and_its_inverse_cancel(
    t: np.ndarray, r: np.ndarray, point: np.ndarray
) -> None:
    transform = RigidTransform(t, r)
    moved = transform.apply(point)
    np.testing.assert_allclose(transform.inverse().apply(moved), point, atol=1e-13)
    expected = transform.matrix() @ np.append(point, 1)
    np.testing.assert_allclose(moved, expected[:3], atol=1e-13)
    again = RigidTransform.from_matrix(transform.matrix())
    np.testing.assert_allclose(again.matrix(), transform.matrix(), atol=2e-14)


def test_transforms_cannot_be_changed_from_outside() -> None:
    source = np.zeros(3)
    transform = RigidTransform(source)
    source[0] = 1.0
    assert transform.translation[0] == 0.0
    with pytest.raises(ValueError, match='read-only'):
        transform.translation[0] = 1.0


@given(VECTORS)
def test_quaternions_and_many_rotations_are_those_of_rodrigues(r):
    matrix = rotation_matrix(r)
    quaternion = rotation_vector_quaternion(r)
    assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(quaternion_rotations(3 * quaternion[None])[0], matrix, atol=1e-12)
    many = rotation_vectors(np.array([matrix, np.eye(3)]))
    np.testing.assert_allclose(rotation_matrix(many[0]), matrix, atol=1e-12)
    assert not many[1].any()
