# SPDX-License-Identifier: Apache-2.0
"""Rotation vectors and rigid transforms."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from calib_model.arrays import Array, frozen


def skew(v: Array) -> Array:
    """The matrix [v]_x with [v]_x w = v x w, shape (..., 3, 3) of v (..., 3)."""
    matrix = np.zeros((*v.shape, 3))
    matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    matrix[..., 1, 2], matrix[..., 2, 0], matrix[..., 0, 1] = -v[..., 0], -v[..., 1], -v[..., 2]
    return matrix


def cross(a: Array, b: Array) -> Array:
    """a x b, row by row, of (N, 3, ...) and the same: numpy's own sorts out shapes and axes first,
    which takes several times as long for a few hundred."""
    product = np.empty_like(b)
    product[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    product[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    product[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product


def _sine_terms(angle: float) -> tuple[float, float, float]:
    """sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3, by series where t is small."""
    square = angle * angle
    if angle < 1e-2:
        return (
            1 - square / 6 + square**2 / 120,
            0.5 - square / 24 + square**2 / 720,
            1 / 6 - square / 120 + square**2 / 5040,
        )
    return (
        np.sin(angle) / angle,
        2 * np.sin(angle / 2) ** 2 / square,
        (angle - np.sin(angle)) / (square * angle),
    )


def rotation_matrix(rotation_vector: Array) -> Array:
    """Rodrigues: the rotation (3, 3) by |r| rad about r (3,)."""
    r = np.asarray(rotation_vector, dtype=np.float64)
    first, second, _ = _sine_terms(float(np.linalg.norm(r)))
    cross = skew(r)
    matrix: Array = np.eye(3) + first * cross + second * cross @ cross
    return matrix


def left_jacobian(rotation_vector: Array) -> Array:
    """J (3, 3) with d(R v) = -[R v]_x J dr for the rotation vector r (3,), R = exp [r]_x."""
    r = np.asarray(rotation_vector, dtype=np.float64)
    _, second, third = _sine_terms(float(np.linalg.norm(r)))
    cross = skew(r)
    matrix: Array = np.eye(3) + second * cross + third * cross @ cross
    return matrix


def rotation_vector(matrix: Array) -> Array:
    """The rotation vector (3,), |r| <= pi, of a rotation matrix (3, 3), by way of a quaternion."""
    m = np.asarray(matrix, dtype=np.float64)
    # the largest of the four quaternion components is computed first: no division by almost zero
    candidates = np.array([np.trace(m), m[0, 0], m[1, 1], m[2, 2]])
    largest = int(np.argmax(candidates))
    vector = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    if largest == 0:
        quaternion = np.append(1 + np.trace(m), vector)
    else:
        i = largest - 1
        column = m[:, i] + m[i, :]
        column[i] = 1 + 2 * m[i, i] - np.trace(m)
        quaternion = np.append(vector[i], column)
    quaternion = quaternion / np.linalg.norm(quaternion)
    if quaternion[0] < 0:
        quaternion = -quaternion
    sine = float(np.linalg.norm(quaternion[1:]))
    angle = 2 * np.arctan2(sine, quaternion[0])
    factor = angle / sine if sine > 1e-12 else 2.0
    result: Array = factor * quaternion[1:]
    return result


def rotation_vector_quaternion(rotation_vector: Array) -> Array:
    """The unit quaternion (4,) x y z w of a rotation vector (3,), rad."""
    angle = float(np.linalg.norm(rotation_vector))
    # sin(t/2) / t = sinc / 2, which numpy has without dividing by zero
    part = 0.5 * np.sinc(angle / (2 * np.pi)) * np.asarray(rotation_vector, dtype=np.float64)
    return np.append(part, np.cos(angle / 2))


def quaternion_rotations(quaternion: Array) -> Array:
    """The rotations (N, 3, 3) of quaternions (N, 4) x y z w, of any length but zero."""
    x, y, z, w = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_vectors(matrices: Array) -> Array:
    """The rotation vectors (N, 3), rad, of rotations (N, 3, 3): `rotation_vector` for many.

    By atan2 of the skew part and the trace, which keeps its digits near zero; near half a turn the
    axis comes from the single form.
    """
    skewed = 0.5 * np.stack(
        [
            matrices[:, 2, 1] - matrices[:, 1, 2],
            matrices[:, 0, 2] - matrices[:, 2, 0],
            matrices[:, 1, 0] - matrices[:, 0, 1],
        ],
        axis=1,
    )
    sine = np.linalg.norm(skewed, axis=1)
    cosine = 0.5 * (np.trace(matrices, axis1=1, axis2=2) - 1)
    factor = np.where(sine > 1e-12, np.arctan2(sine, cosine) / np.maximum(sine, 1e-300), 1.0)
    vectors: Array = factor[:, None] * skewed
    for row in np.flatnonzero(cosine < -0.9):
        vectors[row] = rotation_vector(matrices[row])
    return vectors


def nearest_rotation(matrix: Array) -> Array:
    """The rotation (3, 3) nearest to `matrix` in the Frobenius norm (orthogonal Procrustes)."""
    u, _, vt = np.linalg.svd(matrix)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation: Array = u @ flip @ vt
    return rotation


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """A rotation vector (3,) in rad and a translation (3,) in m: x_parent = R x_child + t."""

    translation: Array = field(default_factory=lambda: frozen(np.zeros(3)))
    rotation_vector: Array = field(default_factory=lambda: frozen(np.zeros(3)))

    def __post_init__(self) -> None:
        object.__setattr__(self, 'translation', frozen(self.translation))
        object.__setattr__(self, 'rotation_vector', frozen(self.rotation_vector))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RigidTransform):
            return NotImplemented
        return self._numbers() == other._numbers()

    def __hash__(self) -> int:
        return hash(self._numbers())

    def _numbers(self) -> tuple[float, ...]:
        return (*self.translation.tolist(), *self.rotation_vector.tolist())

    @property
    def is_identity(self) -> bool:
        """Whether it moves nothing at all."""
        return not any(self._numbers())

    @classmethod
    def from_matrix(cls, matrix: Array) -> RigidTransform:
        """From a homogeneous matrix (4, 4) whose upper left block is a rotation."""
        return cls(matrix[:3, 3], rotation_vector(matrix[:3, :3]))

    @cached_property
    def rotation(self) -> Array:
        """The rotation matrix (3, 3)."""
        return frozen(rotation_matrix(self.rotation_vector))

    def matrix(self) -> Array:
        """The homogeneous matrix (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.translation
        return matrix

    def apply(self, points: Array) -> Array:
        """Points (..., 3) of the child frame in the parent frame, m."""
        moved: Array = points @ self.rotation.T + self.translation
        return moved

    def inverse(self) -> RigidTransform:
        """The transform from the parent frame to the child frame."""
        return RigidTransform(-self.rotation.T @ self.translation, -self.rotation_vector)
