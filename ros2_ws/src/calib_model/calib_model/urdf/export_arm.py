# SPDX-License-Identifier: Apache-2.0
"""A D-H arm as URDF: what robot_state_publisher, RViz and Pinocchio read."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm, Coupling, Joint
from calib_model.transforms import RigidTransform, rotation_matrix

# what a joint without limits gets: readers that count joints by `revolute` keep one number each
FAR = 4 * np.pi
FAST = 1000.0
EFFORT = 1000.0  # URDF wants one; the D-H description knows none


def arm_urdf(arm: Arm, radius: float = 0.03) -> str:
    """The URDF text of an arm, numbers with all their digits.

    Frames: `base_frame`, `link_1` .. `link_n` (the moving frame of each joint, on its axis) and
    `flange_frame`. Joint positions are the arm's q; URDF has no word for a joint that moves with
    another, so of a coupled arm they are what each joint itself has moved (`Arm.uncoupled`), and
    a comment says so. Links are drawn as cylinders of `radius` (m)
    from joint to joint, not at all with 0; there are no masses, for none are known.
    """
    robot = ElementTree.Element('robot', name=arm.name)
    for joint in arm.joints:
        if joint.coupling is not None:
            robot.append(ElementTree.Comment(_coupled(joint, joint.coupling)))
    arm = arm.without_coupling
    links = [arm.base_frame, *_link_names(arm), arm.flange_frame]
    offsets = rigid_parts(arm)
    for name, to_next in zip(links, [*offsets, None], strict=True):
        link = ElementTree.SubElement(robot, 'link', name=name)
        if to_next is not None and radius > 0:
            _draw(link, to_next[:3, 3], radius)
    for i, joint in enumerate(arm.joints):
        element = _joint(robot, joint.name, joint.type, links[i], links[i + 1], offsets[i])
        ElementTree.SubElement(element, 'axis', xyz=f'0 0 {joint.direction}')
        lower, upper = joint.limits
        ElementTree.SubElement(
            element,
            'limit',
            lower=number_text([lower if np.isfinite(lower) else -FAR]),
            upper=number_text([upper if np.isfinite(upper) else FAR]),
            velocity=number_text([joint.velocity if np.isfinite(joint.velocity) else FAST]),
            effort=number_text([EFFORT]),
        )
    mount = _unused(f'{arm.flange_frame}_mount', arm.joint_names)
    _joint(robot, mount, 'fixed', links[-2], links[-1], offsets[-1])
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding='unicode') + '\n'


def _coupled(joint: Joint, coupling: Coupling) -> str:
    text = f' {joint.name} here is {joint.name} + {coupling.factor!r} * {coupling.joint} of the '
    return text.replace('--', '- -') + 'arm description: each joint as it moves itself '


def rigid_parts(arm: Arm) -> list[Array]:
    """What is rigid between an arm's joints, each of which turns by Rz(direction * q) or slides by
    Tz(direction * q): n + 1 matrices (4, 4), base first."""
    before = [_before_turn(arm, i) for i in range(arm.n)]
    return [*before, _after_turn(arm.joints[-1]) @ arm.dh_T_flange.matrix()]


def rpy(rotation: Array) -> Array:
    """URDF's roll, pitch, yaw (3,) in rad of a rotation (3, 3) = Rz(yaw) Ry(pitch) Rx(roll).

    Where the pitch is near 90 deg, roll and yaw are hardly told apart: the roll is taken from what
    yaw and pitch leave, so that the product is the rotation to the last digits all the same.
    """
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    rest = (_about_z(yaw) @ _about_y(pitch)).T @ rotation
    return np.array([np.arctan2(rest[2, 1], rest[1, 1]), pitch, yaw])


def _after_turn(joint: Joint) -> Array:
    """Tx(a) Rx(alpha) Ry(beta): what eq. 2 does after the joint has turned, (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(np.array([joint.alpha, 0.0, 0.0])) @ _about_y(joint.beta)
    matrix[0, 3] = joint.a
    return matrix


def _before_turn(arm: Arm, i: int) -> Array:
    """The fixed offset from joint i's predecessor (or the base) to its own frame, (4, 4)."""
    own = RigidTransform(np.array([0.0, 0.0, arm.joints[i].d])).matrix()
    own[:3, :3] = _about_z(-arm.joints[i].theta_0)
    return (arm.base_T_dh.matrix() if i == 0 else _after_turn(arm.joints[i - 1])) @ own


def _about_y(angle: float) -> Array:
    return rotation_matrix(np.array([0.0, angle, 0.0]))


def _about_z(angle: float) -> Array:
    return rotation_matrix(np.array([0.0, 0.0, angle]))


def _link_names(arm: Arm) -> list[str]:
    taken = (arm.base_frame, arm.flange_frame)
    return [_unused(f'link_{i}', taken) for i in range(1, arm.n + 1)]


def _unused(name: str, taken: tuple[str, ...]) -> str:
    while name in taken:
        name += '_'
    return name


def _joint(
    robot: ElementTree.Element, name: str, kind: str, parent: str, child: str, offset: Array
) -> ElementTree.Element:
    element = ElementTree.SubElement(robot, 'joint', name=name, type=kind)
    ElementTree.SubElement(element, 'parent', link=parent)
    ElementTree.SubElement(element, 'child', link=child)
    _origin(element, offset)
    return element


def _origin(parent: ElementTree.Element, offset: Array) -> None:
    ElementTree.SubElement(
        parent, 'origin', xyz=number_text(offset[:3, 3]), rpy=number_text(rpy(offset[:3, :3]))
    )


def _draw(link: ElementTree.Element, to_next: Array, radius: float) -> None:
    """A cylinder from the link's origin to the next joint's, if there is a way between."""
    length = float(np.linalg.norm(to_next))
    if length < 1e-3:
        return
    across = np.cross([0.0, 0.0, 1.0], to_next / length)
    turn = np.arctan2(np.linalg.norm(across), to_next[2] / length)
    axis = across / np.linalg.norm(across) if np.linalg.norm(across) > 1e-12 else np.eye(3)[0]
    placed = RigidTransform(to_next / 2, turn * axis).matrix()
    visual = ElementTree.SubElement(link, 'visual')
    _origin(visual, placed)
    geometry = ElementTree.SubElement(visual, 'geometry')
    size = {'radius': number_text([radius]), 'length': number_text([length])}
    ElementTree.SubElement(geometry, 'cylinder', size)


def number_text(numbers: Array | list[float]) -> str:
    """Numbers as URDF lists them, with all their digits."""
    return ' '.join(repr(float(number)) for number in numbers)
