# SPDX-License-Identifier: Apache-2.0
"""What a calibration means in a KUKA controller's own figures: axis offsets and the tool frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.instruments import Arm, ControllerAxis
from calib_solver.compensation.calibrated_arm import Calibrated


@dataclass(frozen=True)
class AxisOffset:
    """By how much (rad, or m of one that slides, in the axis' own direction) an axis really stands
    further than it shows; `told` is False where no probing tells it. `counted` says how the axis
    goes with its joint, and who says so: the description, or nobody where that is `assumed`."""

    axis: str
    offset: float
    told: bool
    counted: str
    assumed: bool = False
    prismatic: bool = False


@dataclass(frozen=True)
class ControllerFigures:
    """The axes' offsets, and the tool in the controller's flange frame: `xyz` (3,), m, and `abc`
    (3,), rad, with R = Rz(A) Ry(B) Rx(C)."""

    axes: tuple[AxisOffset, ...]
    xyz: Array
    abc: Array


def controller_figures(calibrated: Calibrated, assume_urdf: bool = False) -> ControllerFigures:
    """The figures of a calibration; with `assume_urdf` the axes of an arm whose controller nobody
    described are taken to count as the URDF's joints do.

    A joint at q has theta = direction q - theta_0: where theta_0 is smaller than nominal by delta
    the joint is where the nominal arm has it at q + direction delta. Of one that slides, d says
    so, with the other sign.

    Raises:
        DataError: no joint of the arm says how its controller counts and nothing is assumed, or
            some do and others do not.
    """
    nominal, identified = calibrated.nominal, calibrated.identified
    assumed = not any(joint.controller for joint in identified.joints)
    if assumed and not assume_urdf:
        raise DataError(
            f'{identified.name}: no joint says how its controller counts (controller: {{axis, '
            'direction, zero}), and signs are not guessed: name a description that says so with '
            "--arm, or take the URDF's directions with --assume-urdf"
        )
    changed = identified.geometry - nominal.geometry
    zero = np.where(identified.prismatic, -changed[2], changed[3])
    axes = []
    for i, axis in enumerate(_axes(identified)):
        offset = -axis.direction * identified.direction[i] * zero[i]
        told, slides = 0 < i < identified.n - 1, bool(identified.prismatic[i])
        counted = _counted(axis, identified.joints[i].name, slides)
        axes.append(AxisOffset(axis.name, float(offset) + 0.0, told, counted, assumed, slides))
    controller = identified.flange_T_controller.matrix()
    tool = np.linalg.inv(controller) @ calibrated.identified_tool.matrix()
    return ControllerFigures(tuple(axes), tool[:3, 3].copy(), abc(tool[:3, :3]))


def _counted(axis: ControllerAxis, joint: str, slides: bool) -> str:
    """How an axis goes with its joint, as a formula in degrees, or mm of one that slides."""
    if not axis.zero:
        return f'{axis.name} = {"-" if axis.direction < 0 else ""}{joint}'
    zero = f'{abs(1e3 * axis.zero):g} mm' if slides else f'{abs(np.degrees(axis.zero)):g} deg'
    inner = f'{joint} {"-" if axis.zero > 0 else "+"} {zero}'
    return f'{axis.name} = -({inner})' if axis.direction < 0 else f'{axis.name} = {inner}'


def _axes(arm: Arm) -> list[ControllerAxis]:
    given = [joint.controller for joint in arm.joints]
    if not any(given):
        # the controller then shows the joint positions themselves
        return [ControllerAxis(joint.name) for joint in arm.joints]
    for axis, joint in zip(given, arm.joints, strict=True):
        if axis is None:
            raise DataError(f'{arm.name}: joint {joint.name} lacks the controller that others have')
    return [axis for axis in given if axis is not None]


def shown(arm: Arm, q: Array) -> Array:
    """What the controller shows at postures q (N, n), rad: axis = direction * (q - zero)."""
    q = arm.check_joints(q)
    axes = _axes(arm)
    directions, zeros = np.array([(axis.direction, axis.zero) for axis in axes]).T
    values: Array = directions * (q - zeros)
    return values


def counted_as(arm: Arm, described: Arm) -> Arm:
    """The arm with the controller's axes and flange frame of another description of it.

    Raises:
        DataError: it is one of another arm.
    """
    if described.joint_names != arm.joint_names:
        raise DataError(f'{described.name}: other joints than those of {arm.name}')
    joints = tuple(
        replace(joint, controller=other.controller)
        for joint, other in zip(arm.joints, described.joints, strict=True)
    )
    return replace(arm, joints=joints, flange_T_controller=described.flange_T_controller)


def abc(rotation: Array) -> Array:
    """A, B, C (3,), rad, of a rotation (3, 3) = Rz(A) Ry(B) Rx(C); C = 0 where B is +-90 deg."""
    cosine = np.hypot(rotation[0, 0], rotation[1, 0])
    b = np.arctan2(-rotation[2, 0], cosine)
    if cosine < 1e-9:
        return np.array([np.arctan2(-rotation[0, 1], rotation[1, 1]), b, 0.0])
    a = np.arctan2(rotation[1, 0], rotation[0, 0])
    return np.array([a, b, np.arctan2(rotation[2, 1], rotation[2, 2])])


def figures_text(figures: ControllerFigures) -> str:
    """The figures as lines for people."""
    lines = ['axis offsets: what the axis really is, less what is shown (deg)']
    for axis in figures.axes:
        by = "assumed: the URDF's direction" if axis.assumed else 'by its description'
        why = '' if axis.told else '; not told: it moves the base or the tool'
        shown = 1e3 * axis.offset if axis.prismatic else np.degrees(axis.offset)
        unit = ' mm' if axis.prismatic else ''
        lines.append(f'  {axis.axis:12}{shown:+10.4f}{unit}   {axis.counted}, {by}{why}')
    lines.append('tool frame of the probe on the flange (mm, deg)')
    for names, values in (('XYZ', 1e3 * figures.xyz), ('ABC', np.degrees(figures.abc))):
        row = (f'{name} {value:+.4f}' for name, value in zip(names, values, strict=True))
        lines.append('  ' + '  '.join(row))
    return '\n'.join(lines)
