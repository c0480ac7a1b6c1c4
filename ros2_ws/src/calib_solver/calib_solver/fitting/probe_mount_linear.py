# SPDX-License-Identifier: Apache-2.0
"""Eqs. 15 to 17 as written: the mount P from probe readings, linear in its twelve numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import RankError
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import nearest_rotation
from calib_solver.problem import Problem

#: singular values of the scaled A below this part of the largest are rounding
RANK_TOLERANCE = 1e-9
MOUNT_UNKNOWNS = 12


@dataclass(frozen=True)
class LinearFit:
    """The upper rows of P, `mount` (3, 4), not yet a rotation; the condition of A with its columns
    at unit length, the sphere centres eliminated."""

    mount: Array
    condition: float

    @property
    def rotation(self) -> Array:
        """The rotation (3, 3) nearest to P's."""
        return nearest_rotation(self.mount[:, :3])

    @property
    def orthogonality_error(self) -> float:
        """|R'R - 1| of P's upper left block, 0 for a rotation."""
        block = self.mount[:, :3]
        return float(np.linalg.norm(block.T @ block - np.eye(3)))


def linear_system(T_base_flange: Array, centers: Array) -> tuple[Array, Array]:
    """A (3N, 15) and b (3N,) of eqs. 16 and 17 for N poses of one sphere.

    `T_base_flange` (N, 4, 4), `centers` (N, 3) the sphere in the probe frame, m. The unknowns:
    p11 p12 p13 p14 p21 ... p34 X_R Y_R Z_R.
    """
    count = len(centers)
    extended = np.concatenate([centers, np.ones((count, 1))], axis=1)
    by_mount = np.einsum('nij,nk->nijk', T_base_flange[:, :3, :3], extended)
    by_center = np.broadcast_to(-np.eye(3), (count, 3, 3))
    matrix = np.concatenate([by_mount.reshape(count, 3, MOUNT_UNKNOWNS), by_center], axis=2)
    return matrix.reshape(3 * count, -1), -T_base_flange[:, :3, 3].reshape(-1)


@dataclass(frozen=True)
class MountSums:
    """All that N poses say of P's twelve numbers p, of S spheres: `triangle` (R, 13) has the sum of
    squares of A p - b about the spheres' means, |triangle (p, -1)|^2, and a sphere's mean point is
    `mean` (S, 3, 13) times (p, -1), m; `weight` (S,) is how many poses it has."""

    triangle: Array
    mean: Array
    weight: Array


def mount_sums(problem: Problem) -> MountSums:
    """Eqs. 16 and 17 of all poses, each sphere's centre eliminated.

    A centre takes up the mean of its sphere's rows, which is subtracted; what is left is reduced
    sphere by sphere to a triangle (QR).
    """
    spheres, width = len(problem.keys), MOUNT_UNKNOWNS + 1
    T_base_flange = forward_kinematics(problem.measured.arm, problem.joints)
    mean, weight = np.zeros((spheres, 3, width)), np.zeros(spheres)
    triangles = []
    for sphere in range(spheres):
        rows = problem.rows(sphere)
        matrix, right = linear_system(T_base_flange[rows], problem.centers[rows])
        stacked = np.concatenate([matrix[:, :MOUNT_UNKNOWNS], right[:, None]], axis=1)
        stacked = stacked.reshape(-1, 3, width)
        share = problem.weight[rows]
        weight[sphere] = share.sum()
        mean[sphere] = np.einsum('n,nkw->kw', share / max(weight[sphere], 1e-300), stacked)
        centred = (stacked - mean[sphere]) * np.sqrt(share)[:, None, None]
        triangles.append(np.linalg.qr(centred.reshape(-1, width), mode='r'))
    return MountSums(np.concatenate(triangles), mean, weight)


def solve_linear(problem: Problem, sums: MountSums | None = None) -> LinearFit:
    """The least-squares solution of eq. 15 over all spheres, each with its own centre.

    Raises:
        RankError: the readings or the postures vary too little to tell P.
    """
    source = problem.measured.source
    triangle = (sums or mount_sums(problem)).triangle
    matrix, right = triangle[:, :MOUNT_UNKNOWNS], triangle[:, MOUNT_UNKNOWNS]
    equations = 3 * int((problem.counts - 1).sum())
    if equations < MOUNT_UNKNOWNS:
        raise RankError(
            f'{source}: eq. 15 lacks rank: {len(problem.joints)} poses of {len(problem.keys)} '
            f'spheres give {equations} equations for the {MOUNT_UNKNOWNS} numbers of P'
        )
    length = np.linalg.norm(matrix, axis=0)
    # a column that is nothing but rounding must not be scaled up to look like data
    length[length < 1e-12 * length.max(initial=1e-300)] = 1.0
    u, values, vt = np.linalg.svd(matrix / length, full_matrices=False)
    rank = int((values > RANK_TOLERANCE * values[0]).sum())
    if rank < MOUNT_UNKNOWNS:
        raise RankError(
            f'{source}: eq. 15 lacks rank ({rank} of {MOUNT_UNKNOWNS}): '
            'the readings or the postures do not vary enough to tell P'
        )
    solution = (vt.T @ ((u.T @ right) / values)) / length
    return LinearFit(solution.reshape(3, 4), float(values[0] / values[-1]))
