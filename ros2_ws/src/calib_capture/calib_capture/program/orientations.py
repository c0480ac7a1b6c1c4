# SPDX-License-Identifier: Apache-2.0
"""Hand orientations and other choices spread evenly: every beginning of a sequence is even too."""

from __future__ import annotations

import numpy as np

from calib_model.arrays import Array


def even_sequence(count: int, dimensions: int, start: Array, skipped: int = 0) -> Array:
    """Points (count, dimensions) of the unit cube, each as far as can be from those before it.

    The additive recurrence on the generalised golden ratio; `start` (dimensions,) shifts it, so
    that two spheres do not get the same orientations. The first `skipped` points are left out.
    """
    ratio = 2.0
    for _ in range(32):
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    steps = ratio ** -np.arange(1, dimensions + 1)
    points: Array = (start + np.outer(np.arange(skipped + 1, skipped + count + 1), steps)) % 1.0
    return points


def cap_directions(height: Array, azimuth: Array, half_angle: float) -> Array:
    """Unit vectors (N, 3) even over the cap of `half_angle` (rad) around +z.

    `height` (N,) and `azimuth` (N,) are in [0, 1): equal areas of the cap for equal areas there.
    """
    cosine = 1 - height * (1 - np.cos(half_angle))
    sine = np.sqrt(1 - cosine**2)
    angle = 2 * np.pi * azimuth
    return np.stack([sine * np.cos(angle), sine * np.sin(angle), cosine], axis=-1)


def sphere_directions(height: Array, azimuth: Array) -> Array:
    """Unit vectors (N, 3) even over the whole sphere."""
    return cap_directions(height, azimuth, np.pi)


def looking_along(axis: Array, spin: float) -> Array:
    """A rotation (3, 3) whose z axis is the unit vector `axis` (3,), turned by `spin` (rad)."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    y = np.cross(axis, x)
    turned_x = np.cos(spin) * x + np.sin(spin) * y
    return np.stack([turned_x, np.cross(axis, turned_x), axis], axis=-1)
