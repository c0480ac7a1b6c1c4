# SPDX-License-Identifier: Apache-2.0
"""How far a planned posture keeps off everything, by other means than the planner's.

The bodies' sizes are the planner's, for they say what is asked; where they are and how near they
come is found anew: D-H frames instead of Pinocchio, distances between segments instead of coal.
"""

from __future__ import annotations

import numpy as np

from calib_model.kinematics import joint_frames


def segment_distances(p1, p2, q1, q2):
    """Distances (N,) between segments p1 p2 and q1 q2, each (N, 3).

    The distance is a convex function of both parameters in the unit square: where the lines'
    own nearest points are not inside, it is least on one of the four sides.
    """
    u, v, w = p2 - p1, q2 - q1, p1 - q1
    a, b, c = (np.einsum('nk,nk->n', *pair) for pair in ((u, u), (u, v), (v, v)))
    d, e = np.einsum('nk,nk->n', u, w), np.einsum('nk,nk->n', v, w)

    def at(s, t):
        return np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)

    def ratio(above, below):
        return np.clip(np.divide(above, below, out=np.zeros_like(a), where=below > 1e-18), 0, 1)

    zero, one = np.zeros_like(a), np.ones_like(a)
    sides = [
        at(zero, ratio(e, c)),
        at(one, ratio(e + b, c)),
        at(ratio(-d, a), zero),
        at(ratio(b - d, a), one),
    ]
    below = a * c - b * b
    inner = below > 1e-12 * np.maximum(a * c, 1e-18)
    s = np.divide(b * e - c * d, below, out=zero - 1, where=inner)
    t = np.divide(a * e - b * d, below, out=zero - 1, where=inner)
    inside = (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    return np.minimum(np.min(sides, axis=0), np.where(inside, at(s, t), np.inf))


def placed(arm, bodies, q, T_base_gauge):
    """Ends of the bodies' segments: moving (N, B, 2, 3) at postures q (N, n), gauge (G, 2, 3)."""
    frames = list(joint_frames(arm, q))
    moving = np.empty((len(q), len(bodies.moving), 2, 3))
    for i, body in enumerate(bodies.moving):
        frame = frames[body.frame - 1]
        x0 = frames[body.frame - 2].rotation if body.frame > 1 else np.eye(3)[None]
        angle = arm.direction[body.frame - 1] * q[:, body.frame - 1]
        c, s, o = np.cos(angle), np.sin(angle), np.zeros_like(angle)
        turn = np.stack(
            [np.stack([c, -s, o], -1), np.stack([s, c, o], -1), np.stack([o, o, o + 1], -1)],
            axis=-2,
        )
        rotation = x0 @ turn
        for end, point in enumerate((body.start, body.end)):
            moving[:, i, end] = frame.origin_joint + np.einsum('nij,j->ni', rotation, point)
    fixed = np.array([[body.start, body.end] for body in bodies.gauge])
    return moving, T_base_gauge.apply(fixed)


def smallest_clearance(arm, bodies, q, T_base_gauge, probed):
    """The smallest gap (N,) between bodies that may not touch, m; negative when they overlap.

    The styli may touch sphere `probed`, None for no sphere.
    """
    moving, fixed = placed(arm, bodies, q, T_base_gauge)
    least = np.full(len(q), np.inf)

    def take(one, other, ends):
        p, r = moving[:, one], np.broadcast_to(ends, (len(q), 2, 3))
        gap = segment_distances(p[:, 0], p[:, 1], r[:, 0], r[:, 1])
        np.minimum(least, gap - bodies.moving[one].radius - other.radius, out=least)

    for i, body in enumerate(bodies.moving):
        for j, other in enumerate(bodies.gauge):
            if not (body.stylus and other.sphere == probed):
                take(i, other, fixed[j])
    for i, j in bodies.self_pairs:
        take(i, bodies.moving[j], moving[:, j])
    floor = bodies.settings.floor
    for i, body in enumerate(bodies.moving):
        if floor is not None and (body.frame > 2 or body.kind == 'probe'):
            height = moving[:, i, :, 2].min(axis=1) - body.radius - floor
            np.minimum(least, height, out=least)
    return least
