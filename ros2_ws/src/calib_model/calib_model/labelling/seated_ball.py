# SPDX-License-Identifier: Apache-2.0
"""Where on the flange a ball is that was seated in sockets, as far as postures alone tell.

A ball on a bracket is known to a few centimetres: too little to tell sockets apart that are five
apart. While it sits in one, the arm turns about its centre, so p_base = p + R c is the same for
most pairs of successive postures. Only sorting uses this c: the calibration finds its own.
"""

from __future__ import annotations

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_model.kinematics import forward_kinematics
from calib_model.labelling.joint_stops import SEAT, beats, spaced
from calib_model.labelling.sphere_clusters import NEAR, visits
from calib_model.pairing import Rows
from calib_model.stamps import SECOND

LOOSE = 0.1  # m by which the ball may be elsewhere than described
SEEN = 1e-3  # m by which an arm not yet calibrated sees a seated ball move, about
ROUNDS = 60
APART = 0.1  # rad between postures that tell where the ball is
TRIM = 0.05  # s at both ends of a seat in which the ball may not sit yet
FAR = 4.0  # median distances from the middle of a seat beyond which its ends are left out


def ball_on_flange(arm: Arm, described: Array, joints: Array) -> Array:
    """`p_flange_ball` (3,), m, from postures (N, n) in time order; `described` (3,) where they do
    not tell it better.

    Least squares of |(R_k+1 - R_k) c + p_k+1 - p_k| with weights that leave out pairs across two
    sockets, held to what is described by `LOOSE`.
    """
    if len(joints) < 3:
        return described
    flange = forward_kinematics(arm, joints)
    turned = np.diff(flange[:, :3, :3], axis=0)
    moved = np.diff(flange[:, :3, 3], axis=0)
    found = described
    for limit in np.geomspace(LOOSE, SEEN, ROUNDS):
        off = np.linalg.norm(turned @ found + moved, axis=1)
        weight = 1 / (1 + (off / limit) ** 2) ** 2
        normal = np.einsum('k,kij,kil->jl', weight, turned, turned)
        right = -np.einsum('k,kij,ki->j', weight, turned, moved + turned @ described)
        hold = (SEEN / LOOSE) ** 2
        found = described + np.linalg.solve(normal + hold * np.eye(3), right)
    near = [
        int((np.linalg.norm(turned @ c + moved, axis=1) <= NEAR).sum()) for c in (described, found)
    ]
    return found if near[1] >= near[0] else described


def seats(arm: Arm, described: Array, stamp: Rows, joints: Array, spacing: float) -> Rows:
    """Rows of the states (M, n) at `stamp` (M,), ns, at which a led arm had its ball in a socket,
    `spacing` (rad) apart: where the ball's centre stays while the arm turns about it."""
    looked = beats(stamp)
    t, q = stamp[looked], joints[looked]
    flange = forward_kinematics(arm, q)
    c = ball_on_flange(arm, described, q[spaced(q, APART)])
    p = flange[:, :3, :3] @ c + flange[:, :3, 3]
    found: list[Rows] = []
    for visit in visits(p, NEAR / 2):
        rows = np.array(visit)
        if t[rows[-1]] - t[rows[0]] < SEAT * SECOND:
            continue
        rows = _seated(t, p, rows)
        found.append(rows[spaced(q[rows], spacing)])
    return looked[np.concatenate(found)] if found else looked[:0]


def _seated(t: Rows, p: Array, rows: Rows) -> Rows:
    """A visit without its ends, in which the ball comes and goes."""
    inner = (t[rows] >= t[rows[0]] + TRIM * SECOND) & (t[rows] <= t[rows[-1]] - TRIM * SECOND)
    rows = rows[inner]
    off = np.linalg.norm(p[rows] - np.median(p[rows], axis=0), axis=1)
    sits = np.flatnonzero(off <= max(FAR * float(np.median(off)), SEEN))
    return rows[sits[0] : sits[-1] + 1]
