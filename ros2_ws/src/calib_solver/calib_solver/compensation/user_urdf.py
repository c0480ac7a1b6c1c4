# SPDX-License-Identifier: Apache-2.0
"""The user's own URDF with its joint origins corrected, and read back to prove it."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import CalibrationError, DescriptionError
from calib_model.instruments import Arm
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import rotation_matrix
from calib_model.urdf import ChainJoint, SerialChain, read_chain, rigid_parts, with_origins

#: m: further apart, arm description and URDF do not mean the same arm or not the same joint zeros
SAME_ARM = 0.02
EXACT = 1e-9  # m, of the URDF read back
#: m and rad: what rounding makes of an origin that nothing has changed
UNCHANGED = 2e-11
POSTURES = 50


def corrected_urdf(text: bytes, nominal: Arm, identified: Arm, source: str = 'URDF') -> bytes:
    """The URDF whose flange is where the identified arm has it, for every posture.

    Only joint origins differ from `text`: joint axes, zeros and limits, links and comments stay.
    Of a coupled arm the URDF's positions are what each joint itself has moved. `nominal` is the arm
    that was started from, of the same base and flange links and joints.

    Raises:
        DescriptionError: the URDF has not these links and joints, or is of another arm.
        CalibrationError: what was identified cannot be said by its joint origins.
    """
    nominal, identified = nominal.without_coupling, identified.without_coupling
    chain = read_chain(text, identified.base_frame, identified.flange_frame, source)
    names = tuple(joint.name for joint in chain.moving)
    if names != identified.joint_names:
        raise DescriptionError(
            source,
            '',
            f'its joints are {", ".join(names)}: '
            f'expected {", ".join(identified.joint_names)} as in the arm description',
        )
    _refuse_another_arm(chain, nominal, source)
    new = with_origins(text, corrected_origins(chain, nominal, identified, source), source)
    q = _postures(identified)
    off = float(
        np.abs(
            pinocchio_poses(new, identified, q, source) - forward_kinematics(identified, q)
        ).max()
    )
    if not off < EXACT:
        raise CalibrationError(
            f'{source}: read back, the corrected origins are {off:.2g} m off the identified arm'
        )
    return new


def refuse_uncorrectable(text: bytes, nominal: Arm, source: str) -> None:
    """Nothing, where a URDF could be corrected for an arm that is a little off `nominal`: to be
    asked before the work.

    Raises:
        CalibrationError: as `corrected_urdf`.
    """
    off = 1e-4 * np.random.default_rng(0).normal(size=nominal.geometry.shape)
    off[4, nominal.geometry[4] == 0] = 0.0  # no angle of Hayati's where there was none
    corrected_urdf(text, nominal, nominal.with_geometry(nominal.geometry + off), source)


def corrected_origins(
    chain: SerialChain, nominal: Arm, identified: Arm, source: str = 'URDF'
) -> dict[str, Array]:
    """New origins (4, 4) by joint name, of those that change.

    The URDF's joint i turns by Rot(axis, q) = K_i Rz(direction q) K_i^-1, where K_i carries the
    D-H frame on that axis into the joint's frame; one that slides does so by K_i Tz(direction q)
    K_i^-1. With the rigid parts C_i between the D-H joints,
    the origins O_i = K_(i-1) C_i K_i^-1 give the same poses: the nominal C_i and O_i say K_i, the
    identified C_i then the new O_i.
    """
    segments = chain.segments()
    before = np.eye(4)
    found: dict[str, Array] = {}
    parts = zip(segments, rigid_parts(nominal), rigid_parts(identified), strict=True)
    joints = _by_segment(chain)
    for i, (segment, old, new) in enumerate(parts):
        carried = np.eye(4)
        if i < nominal.n:
            guess = np.linalg.inv(segment) @ before @ old
            carried = _onto_axis(guess, chain.moving[i].axis * nominal.joints[i].direction)
        wanted = before @ new @ np.linalg.inv(carried)
        before = carried
        if np.abs(wanted - segment).max() < UNCHANGED:
            continue
        if not joints[i]:
            raise CalibrationError(
                f'{source}: link {chain.flange!r} is moved by {chain.moving[-1].name} itself: no '
                f'joint origin can correct where it is on the last axis'
            )
        own, origin = _own_origin(wanted, joints[i])
        found[own.name] = origin
    return found


def _by_segment(chain: SerialChain) -> list[list[ChainJoint]]:
    """The joints of each rigid segment: fixed ones and, but for the last, the one that moves."""
    found: list[list[ChainJoint]] = [[]]
    for joint in chain.joints:
        found[-1].append(joint)
        if joint.moves:
            found.append([])
    return found


def _own_origin(wanted: Array, segment: list[ChainJoint]) -> tuple[ChainJoint, Array]:
    """The joint of a segment that is corrected, and its origin that makes the whole as wanted.

    That is the joint that moves, or the first of those between the last of them and the flange.
    """
    *fixed, last = segment
    matrix = np.eye(4)
    if last.moves:
        for joint in fixed:
            matrix = matrix @ joint.origin
        return last, np.linalg.inv(matrix) @ wanted
    for joint in segment[1:]:
        matrix = matrix @ joint.origin
    return segment[0], wanted @ np.linalg.inv(matrix)


def _onto_axis(guess: Array, axis: Array) -> Array:
    """The transform nearest to a guess that takes the z axis onto the line along `axis` (3,)."""
    z = guess[:3, 2]
    across = np.cross(z, axis)
    sine = float(np.linalg.norm(across))
    carried = np.eye(4)
    turn = across / sine * np.arctan2(sine, z @ axis) if sine > 0 else np.zeros(3)
    carried[:3, :3] = rotation_matrix(turn) @ guess[:3, :3]
    carried[:3, 3] = (guess[:3, 3] @ axis) * axis
    return carried


def _refuse_another_arm(chain: SerialChain, nominal: Arm, source: str) -> None:
    q = _postures(nominal)
    said = forward_kinematics(nominal, q)
    off = max(
        float(np.linalg.norm(chain.forward(row)[:3, 3] - pose[:3, 3]))
        for row, pose in zip(q, said, strict=True)
    )
    if not off < SAME_ARM:
        raise DescriptionError(
            source,
            '',
            f'its {chain.flange} is up to {1e3 * off:.0f} mm off the arm description '
            f'{nominal.name!r}: expected the URDF of the same arm and the same joint zeros',
        )


def _postures(arm: Arm) -> Array:
    lower, upper = arm.ranges.T
    return np.random.default_rng(0).uniform(lower, upper, (POSTURES, arm.n))


def _with_limits(text: bytes) -> bytes:
    """A URDF whose turning joints without limits turn without end: urdfdom takes them so only."""
    root = ElementTree.fromstring(text)
    for joint in root.iter('joint'):
        if joint.get('type') == 'revolute' and joint.find('limit') is None:
            joint.set('type', 'continuous')
    found: bytes = ElementTree.tostring(root)
    return found


def pinocchio_poses(text: bytes, arm: Arm, q: Array, source: str = 'URDF') -> Array:
    """`T_base_flange` (N, 4, 4) at q (N, n) as Pinocchio reads it from a URDF with those frames.

    Raises:
        DescriptionError: Pinocchio does not read it.
    """
    import pinocchio  # takes longer to load than an identification without it needs

    try:
        model = pinocchio.buildModelFromXML(_with_limits(text).decode('utf-8', 'replace'))
    except (ValueError, RuntimeError) as error:
        raise DescriptionError(source, '', f'Pinocchio does not read it: {error}') from error
    data = model.createData()
    # links: joints may have the same names
    base, flange = (
        model.getFrameId(name, pinocchio.FrameType.BODY)
        for name in (arm.base_frame, arm.flange_frame)
    )
    found = np.empty((len(q), 4, 4))
    for i, row in enumerate(q):
        full = pinocchio.neutral(model)
        for name, value in zip(arm.joint_names, row, strict=True):
            joint = model.joints[model.getJointId(name)]
            # a continuous joint is held as cosine and sine
            turn = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
            full[joint.idx_q : joint.idx_q + joint.nq] = turn
        pinocchio.framesForwardKinematics(model, data, full)
        found[i] = (data.oMf[base].inverse() * data.oMf[flange]).homogeneous
    return found
