# SPDX-License-Identifier: Apache-2.0
"""Laying the certificate over measured centres: the best-fit placement of one gauge location."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.transforms import nearest_rotation, skew


@dataclass(frozen=True)
class Placed:
    """The certificate's points (k, 3) as placed, m, and `motion` (k, 3, 6): how they move with a
    small translation and a small rotation of the gauge about its measured centre; `rotation` (3, 3)
    is the gauge's."""

    points: Array
    motion: Array
    rotation: Array


def place_gauge(certified: Array, measured: Array, weight: Array) -> Placed:
    """The rigid placement of `certified` (k, 3) nearest to `measured` (k, 3), by weights (k,).

    Kabsch's solution; with one or two spheres the turn that nothing shows is left out.
    """
    share = weight / weight.sum()
    from_mean = certified - share @ certified
    center = share @ measured
    covariance = np.einsum('k,ki,kj->ij', weight, measured - center, from_mean)
    rotation = nearest_rotation(covariance)
    points = from_mean @ rotation.T
    motion = np.concatenate(
        [np.broadcast_to(np.eye(3), (len(points), 3, 3)), -skew(points)], axis=2
    )
    return Placed(center + points, motion, rotation)
