# SPDX-License-Identifier: Apache-2.0
"""URDFs to try things on: public ones that come with PyPI packages, and random ones."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import numpy as np
import pinocchio
import pytest

PUBLIC = {
    'kuka_kr16_2': ('rtb-data', 'kuka_kr16/urdf/kr16_2.urdf', 'base_link', 'tool0'),
    'kuka_iiwa_14': ('rtb-data', 'lbr_iiwa_14_r820.urdf', 'base_link', 'tool0'),
    'ur5': ('example-robot-data', 'urdf/ur5_robot.urdf', 'base_link', 'tool0'),
    'panda': ('example-robot-data', 'urdf/panda.urdf', 'panda_link0', 'panda_link8'),
    'kinova_j2s6s200': ('example-robot-data', 'kinova.urdf', 'base', 'j2s6s200_end_effector'),
}


def public_urdf(name: str) -> tuple[Path, str, str]:
    """A public URDF's path, base and flange link; the test is skipped where it is not there."""
    package, ending, base, flange = PUBLIC[name]
    try:
        files = importlib.metadata.files(package) or []
    except importlib.metadata.PackageNotFoundError:
        pytest.skip(f'{package} of requirements-dev.txt is not installed')
    (found,) = (file for file in files if str(file).endswith(f'/{ending}'))
    return Path(str(found.locate())), base, flange


def joint_text(
    name: str, kind: str, parent: str, child: str, origin: str = '', inside: str = ''
) -> str:
    """A <joint> element."""
    return (
        f'  <joint name="{name}" type="{kind}">\n    <parent link="{parent}"/>\n'
        f'    <child link="{child}"/>\n{origin}{inside}  </joint>\n'
    )


def random_urdf(rng: np.random.Generator, joints: int) -> str:
    """A chain of moving and fixed joints anyhow, parallel and crossing axes among them."""
    right = np.pi / 2
    text, links = '', ['base']
    for _ in range(joints):
        for kind in rng.choice(['fixed', 'turning'], p=[0.2, 0.8], size=2):
            links.append(f'link_{len(links)}')
            turn = rng.choice([-right, 0, right, np.pi], size=3)
            if rng.random() < 0.3:
                turn = turn + rng.choice([1e-13, 1e-9, 1e-5, 1e-2, 1.0]) * rng.normal(size=3)
            move = rng.choice([0, 0, 0.1, 0.4], size=3) * rng.choice([1, -1, rng.normal()], size=3)
            origin = (
                f'    <origin xyz="{" ".join(map(repr, map(float, move)))}" '
                f'rpy="{" ".join(map(repr, map(float, turn)))}"/>\n'
            )
            axis = rng.choice(
                [[0, 0, 1], [0, 0, -1], [0, 1, 0], [1, 0, 0], rng.normal(size=3)][
                    : 5 if rng.random() < 0.2 else 4
                ]
            )
            inside = ''
            if kind == 'turning':
                kind = rng.choice(['revolute', 'continuous', 'prismatic'])
                inside = (
                    f'    <axis xyz="{" ".join(map(repr, map(float, axis)))}"/>\n'
                    '    <limit lower="-3" upper="3" velocity="2" effort="1"/>\n'
                )
            text += joint_text(f'joint_{len(links)}', kind, links[-2], links[-1], origin, inside)
    links.append('flange')
    inside = '    <axis xyz="0 0 1"/>\n    <limit lower="-1" upper="1" velocity="1" effort="1"/>\n'
    text += joint_text('the_last', 'revolute', links[-2], links[-1], '', inside)
    body = ''.join(f'  <link name="{name}"/>\n' for name in links)
    return f'<?xml version="1.0"?>\n<robot name="anyhow">\n{body}{text}</robot>\n'


def through_pinocchio(
    text: str, base: str, flange: str, names: tuple[str, ...], q: np.ndarray
) -> np.ndarray:
    """T_base_flange (N, 4, 4) of a URDF as Pinocchio reads it, joints q (N, n) by name."""
    model = pinocchio.buildModelFromXML(text)
    data = model.createData()
    from_base, to_flange = (
        model.getFrameId(link, pinocchio.FrameType.BODY) for link in (base, flange)
    )
    found = []
    for row in q:
        full = pinocchio.neutral(model)
        for name, value in zip(names, row, strict=True):
            joint = model.joints[model.getJointId(name)]
            turn = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
            full[joint.idx_q : joint.idx_q + joint.nq] = turn
        pinocchio.framesForwardKinematics(model, data, full)
        found.append((data.oMf[from_base].inverse() * data.oMf[to_flange]).homogeneous)
    return np.array(found)
