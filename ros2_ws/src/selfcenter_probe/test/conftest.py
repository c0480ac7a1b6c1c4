# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from calib_model.arrays import Array
from calib_model.descriptions import read_description
from calib_model.instruments import ActiveProbe, Arm, Gauge, Joint, trihedron
from calib_model.kinematics import forward_kinematics, point_derivatives
from calib_model.transforms import RigidTransform
from selfcenter_probe.simulation import Magnitudes, World, parse_magnitudes

QUARTER = np.pi / 2


@dataclass(frozen=True)
class Scene:
    """What everyone is told: nominal instruments, and postures (N, 6) that should be in contact.

    Posture i should have the sphere at `p_probe_sphere[i]`, sphere `sphere[i]` of location
    `location[i]`.
    """

    arm: Arm
    probe: ActiveProbe
    gauge: Gauge
    placements: dict[int, RigidTransform]
    joints: Array
    p_probe_sphere: Array
    location: np.ndarray
    sphere: np.ndarray

    def world(self, magnitudes: Magnitudes, seed: int = 1) -> World:
        generator = np.random.default_rng(seed)
        return World.drawn(self.arm, self.probe, self.gauge, self.placements, magnitudes, generator)


def kr5() -> Arm:
    """The KR 5 sixx R650 by the chapter's convention."""
    rows = [
        ('a1', 0.075, -QUARTER, 0.335, 0.0),
        ('a2', 0.27, 0.0, 0.0, QUARTER),
        ('a3', 0.09, QUARTER, 0.0, 0.0),
        ('a4', 0.0, -QUARTER, -0.295, 0.0),
        ('a5', 0.0, QUARTER, 0.0, 0.0),
        ('a6', 0.0, np.pi, -0.08, 0.0),
    ]
    return Arm('kr5', tuple(Joint(*row) for row in rows))


def reaching(
    arm: Arm, probe: ActiveProbe, p_base: Array, p_probe: Array, start: Array
) -> Array | None:
    """A posture with `p_probe` of the probe at `p_base`, by Newton steps from `start`."""
    p_flange = probe.flange_T_probe.apply(p_probe)
    q = start[None, :]
    for _ in range(50):
        now = point_derivatives(arm, q, p_flange)
        miss = p_base - now.p_base[0]
        if np.linalg.norm(miss) < 1e-13:
            return q[0]
        step = np.linalg.pinv(now.joints[0]) @ miss
        q = q + step * min(1.0, 0.5 / np.linalg.norm(step))
    return None


@pytest.fixture(scope='session')
def scene() -> Scene:
    arm = kr5()
    probe = trihedron(RigidTransform(np.array([0.0, 0.0, 0.1]), np.zeros(3)))
    centers = [(1, 0.0), (6, 0.2), (10, 0.36), (14, 0.52)]
    gauge = Gauge('bar', 0.022, tuple((k, (x, 0.0, 0.0)) for k, x in centers), 1e-6, 1e-6)
    placements = {
        1: RigidTransform(np.array([0.4, -0.28, 0.2]), np.array([0.0, 0.0, QUARTER])),
        4: RigidTransform(np.array([0.35, -0.28, 0.45]), np.array([0.0, 0.3, QUARTER])),
    }
    generator = np.random.default_rng(20)
    joints, seen, names = [], [], []
    for location, stand in placements.items():
        for sphere, _ in centers:
            p_base = stand.apply(gauge.center(sphere))
            postures = 0
            while postures < 10:
                p_probe = generator.uniform(-0.8e-3, 0.8e-3, 3)
                start = np.array([0, 0.5, -1.5, 0, 1.0, 0]) + generator.uniform(-0.6, 0.6, 6)
                q = reaching(arm, probe, p_base, p_probe, start)
                if q is not None:
                    joints.append(q)
                    seen.append(p_probe)
                    names.append((location, sphere))
                    postures += 1
    location, sphere = np.array(names).T
    return Scene(arm, probe, gauge, placements, np.array(joints), np.array(seen), location, sphere)


@pytest.fixture(scope='session')
def away(scene: Scene) -> Array:
    """A posture (6,) with no sphere within a decimetre of the probe."""
    q = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    p_base_probe = (forward_kinematics(scene.arm, q) @ scene.probe.flange_T_probe.matrix())[
        0, :3, 3
    ]
    for stand in scene.placements.values():
        for number in scene.gauge.numbers:
            center = stand.apply(scene.gauge.center(number))
            assert np.linalg.norm(center - p_base_probe) > 0.1
    return q


@pytest.fixture(scope='session')
def default_world_file() -> Path:
    return Path(__file__).resolve().parents[1] / 'config' / 'world.yaml'


@pytest.fixture(scope='session')
def magnitudes(default_world_file: Path) -> Magnitudes:
    """The magnitudes that come with the package."""
    return read_description(default_world_file, parse_magnitudes)
