# SPDX-License-Identifier: Apache-2.0
"""Scenes whose encoders and joints err, and how they are told apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from simulated_calibration import Scene

from calib_model.kinematics import COMPLIANCE, ENCODER, JointErrors, JointTerms, Links
from calib_solver.problem import Problem

LINKS = Links(np.array([5.0, 4.0, 4.0, 2.0, 1.0, 3.0]), np.tile([0.0, 0.01, -0.05], (6, 1)))

NOISE = 2e-5
#: of joints that turn
KINDS = (ENCODER, COMPLIANCE)


def off_by(scene: Scene, errors: JointErrors, noise: float = NOISE) -> Scene:
    """The scene as encoders and joints with these errors have it, with noise (rad)."""
    true = scene.measured.poses.joints
    read = true
    for _ in range(5):
        read = true - errors.angles(scene.true, read)
    read = read + noise * np.random.default_rng(8).normal(size=read.shape)
    poses = replace(scene.measured.poses, joints=read)
    return replace(scene, measured=replace(scene.measured, poses=poses))


def true_errors(kinds=KINDS, size: float = 1.0) -> JointErrors:
    rng = np.random.default_rng(7)
    values = []
    if 'encoder' in kinds:
        values.append(8e-5 * rng.normal(size=(4, 6)))
    if 'compliance' in kinds:
        values.append(rng.uniform(5e-6, 3e-5, (1, 6)))
    terms = JointTerms(2 if 'encoder' in kinds else 0, LINKS if 'compliance' in kinds else None)
    return JointErrors(terms, size * np.concatenate(values))


def parts(scene: Scene):
    """What is identified from, and the problem that is held out."""
    poses = scene.measured.poses
    seen, unseen = (
        replace(scene.measured, poses=poses.take(which))
        for which in (poses.location < 7, poses.location == 7)
    )
    return seen, Problem.of(unseen)
