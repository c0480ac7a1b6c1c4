# SPDX-License-Identifier: Apache-2.0
"""What an arm's links weigh and how their joints give way, from YAML or URDF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from calib_model.errors import DescriptionError
from calib_model.files import Fields, file_content, load_mapping
from calib_model.instruments import Arm
from calib_model.kinematics import STANDARD_GRAVITY, Links, joint_frames

#: a URDF whose joint axes are further than this (m, rad) from the description's is another arm
AXIS_OFFSET = 5e-3
AXIS_TILT = 0.02


def parse_links(text: str, source: str, arm: Arm) -> Links:
    """The links of `arm` from YAML text; joints that are not named weigh nothing.

    Raises:
        DescriptionError: a key is missing, unknown, or has a value of the wrong kind, or a joint
            is not the arm's.
    """
    return links_of(load_mapping(text, source, ('gravity', 'links')), arm.joint_names)


def links_of(top: Fields, joint_names: tuple[str, ...]) -> Links:
    """The same from a mapping that has been read.

    Raises:
        DescriptionError: as `parse_links`.
    """
    mass, center = np.zeros(len(joint_names)), np.zeros((len(joint_names), 3))
    for row in top.rows('links', ('joint', 'mass', 'center')):
        name = row.text('joint')
        if name not in joint_names:
            known = ', '.join(joint_names)
            raise row.refuse('joint', f'no joint {name[:40]!r} (there are {known})')
        place = joint_names.index(name)
        mass[place] = row.number('mass')
        if mass[place] < 0:
            raise row.refuse('mass', 'expected a mass, not a negative number')
        center[place] = row.numbers('center', 3)
    if not mass.any():
        raise top.refuse('links', 'expected at least one link with a mass')
    return Links(mass, center, np.array(top.numbers('gravity', 3, STANDARD_GRAVITY)))


def links_rows(links: Links, joint_names: tuple[str, ...]) -> dict[str, Any]:
    """What `links_of` reads, bit for bit."""
    rows = [
        {'joint': name, 'mass': float(mass), 'center': center.tolist()}
        for name, mass, center in zip(joint_names, links.mass, links.center, strict=True)
        if mass > 0
    ]
    return {'gravity': links.gravity.tolist(), 'links': rows}


def read_links(path: str | Path, arm: Arm) -> Links:
    """The links of `arm` from a YAML file, or from a URDF (.urdf) with inertial elements.

    Raises:
        DescriptionError: the file cannot be read or used, or its joints are not the arm's.
    """
    path = Path(path)
    try:
        text = file_content(path).decode('utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'not a text file'
        raise DescriptionError(str(path), '', f'cannot be read: {reason}') from error
    if path.suffix == '.urdf':
        return _links_of_urdf(text, str(path), arm)
    return parse_links(text, str(path), arm)


def _links_of_urdf(text: str, source: str, arm: Arm) -> Links:
    """Masses of a URDF's links; what is fixed to a link counts with it, its zero is the arm's."""
    import pinocchio

    try:
        model = pinocchio.buildModelFromXML(text)
    except ValueError as error:
        raise DescriptionError(source, '', f'no URDF: {error}') from error
    data = model.createData()
    pinocchio.forwardKinematics(model, data, pinocchio.neutral(model))
    mass, center = np.zeros(arm.n), np.zeros((arm.n, 3))
    for i, frame in enumerate(joint_frames(arm, np.zeros((1, arm.n)))):
        name = arm.joints[i].name
        if not model.existJointName(name):
            raise DescriptionError(source, '', f'has no joint {name!r}, as {arm.name} has')
        number = model.getJointId(name)
        placed, body = data.oMi[number], model.inertias[number]
        away = placed.translation - frame.origin_joint[0]
        offset = np.linalg.norm(np.cross(frame.z_joint[0], away))
        axis = pinocchio.computeJointJacobians(model, data, pinocchio.neutral(model))
        tilt = np.linalg.norm(np.cross(frame.z_joint[0], axis[3:, model.idx_vs[number]]))
        if offset > AXIS_OFFSET or tilt > AXIS_TILT:
            raise DescriptionError(
                source,
                name,
                f'its axis is {offset * 1e3:.0f} mm and {np.degrees(tilt):.0f} deg '
                f'off that of {arm.name} at zero',
            )
        mass[i] = body.mass
        in_base = placed.act(body.lever)
        center[i] = frame.rotation[0].T @ (in_base - frame.origin[0])
    if not mass.any():
        raise DescriptionError(source, '', 'no link has a mass')
    return Links(mass, center)
