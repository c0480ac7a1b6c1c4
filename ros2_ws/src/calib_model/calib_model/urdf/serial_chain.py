# SPDX-License-Identifier: Apache-2.0
"""The joints between two links of a URDF, moving ones and fixed ones, base first."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DescriptionError
from calib_model.instruments import PRISMATIC
from calib_model.transforms import rotation_matrix

MOVING = ('revolute', 'continuous', PRISMATIC)
MOST_NAMES = 12  # listed in an error
EXPECTED = 'expected revolute, continuous, prismatic or fixed joints from base to flange'


@dataclass(frozen=True)
class ChainJoint:
    """One joint: `origin` (4, 4) is its frame in its parent link's, m; `axis` (3,) of length 1."""

    name: str
    kind: str
    origin: Array
    axis: Array
    limits: tuple[float, float] = (-np.inf, np.inf)
    velocity: float = np.inf

    @property
    def moves(self) -> bool:
        """Whether it turns or slides; it is fixed otherwise."""
        return self.kind in MOVING

    @property
    def prismatic(self) -> bool:
        """Whether it slides."""
        return self.kind == PRISMATIC

    def motion(self, position: float) -> Array:
        """What it does at a position (rad, m), (4, 4)."""
        matrix = np.eye(4)
        if self.prismatic:
            matrix[:3, 3] = position * self.axis
        else:
            matrix[:3, :3] = rotation_matrix(position * self.axis)
        return matrix


@dataclass(frozen=True)
class SerialChain:
    """The joints from link `base` to link `flange` of the robot of that name."""

    robot: str
    base: str
    flange: str
    joints: tuple[ChainJoint, ...]

    @property
    def moving(self) -> tuple[ChainJoint, ...]:
        """The joints that turn or slide, base first."""
        return tuple(joint for joint in self.joints if joint.moves)

    def segments(self) -> list[Array]:
        """What is rigid, fixed joints folded: n + 1 matrices (4, 4).

        From the base, or from the frame of the moving joint before, to each moving joint's frame
        and at last to the flange.
        """
        found = [np.eye(4)]
        for joint in self.joints:
            found[-1] = found[-1] @ joint.origin
            if joint.moves:
                found.append(np.eye(4))
        return found

    def forward(self, q: Array) -> Array:
        """`T_base_flange` (4, 4) of one posture q (n,)."""
        *before, last = self.segments()
        matrix = np.eye(4)
        for segment, joint, position in zip(before, self.moving, q, strict=True):
            matrix = matrix @ segment @ joint.motion(float(position))
        flange: Array = matrix @ last
        return flange


def read_chain(
    text: str | bytes, base: str = '', flange: str = '', source: str = 'URDF'
) -> SerialChain:
    """The chain of a URDF text from `base` (its root when '') to `flange` (its only tip when '').

    Raises:
        DescriptionError: not a URDF, no such links, or joints that are not of a serial arm.
    """
    robot = _robot(text, source)
    parents = _parents(robot, source)
    links = [link.get('name', '') for link in robot.findall('link')]
    roots = [name for name in links if name not in parents]
    tips = set(links) - {parent for parent, _ in parents.values()}
    base = base or _only(roots, source, 'root', '--base')
    flange = flange or _only([name for name in links if name in tips], source, 'end', '--flange')
    for name in (base, flange):
        if name not in links:
            raise DescriptionError(source, '', f'no link {name!r} (there are {_some(links)})')
    elements: list[ElementTree.Element] = []
    at = flange
    while at != base:
        if at not in parents or len(elements) > len(parents):
            raise DescriptionError(source, '', f'no joints lead from link {base!r} to {flange!r}')
        at, element = parents[at]
        elements.insert(0, element)
    chain = SerialChain(
        robot.get('name') or 'arm', base, flange, tuple(_joint(e, source) for e in elements)
    )
    if not chain.moving:
        raise DescriptionError(source, '', f'no joint moves between {base!r} and {flange!r}')
    return chain


def _robot(text: str | bytes, source: str) -> ElementTree.Element:
    marks = text.encode('utf-8', 'replace') if isinstance(text, str) else text
    if b'<!DOCTYPE' in marks.replace(b'\0', b''):  # as UTF-16 has them
        # entities can stand for a huge text, or for another file
        raise DescriptionError(source, '', 'has a DOCTYPE: expected plain XML')
    try:
        robot = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise DescriptionError(source, '', f'not XML: {error}') from error
    if robot.tag != 'robot':
        raise DescriptionError(source, '', f'expected a <robot>, got <{robot.tag}>')
    if any('xacro' in element.tag for element in robot.iter() if isinstance(element.tag, str)):
        raise DescriptionError(source, '', 'is xacro: expected the URDF that xacro makes of it')
    return robot


def _parents(robot: ElementTree.Element, source: str) -> dict[str, tuple[str, ElementTree.Element]]:
    """Parent link and joint by child link."""
    found: dict[str, tuple[str, ElementTree.Element]] = {}
    for joint in robot.findall('joint'):
        ends = [joint.find(end) for end in ('parent', 'child')]
        parent, child = ('' if end is None else end.get('link', '') for end in ends)
        if not parent or not child:
            raise DescriptionError(source, _place(joint), 'expected a parent and a child link')
        if child in found:
            raise DescriptionError(source, _place(joint), f'link {child!r} has a joint already')
        found[child] = parent, joint
    return found


def _joint(element: ElementTree.Element, source: str) -> ChainJoint:
    name, kind = element.get('name', ''), element.get('type', '')
    if kind not in (*MOVING, 'fixed'):
        raise DescriptionError(source, _place(element), f'{kind or "no type"}: {EXPECTED}')
    origin = np.eye(4)
    placed = element.find('origin')
    if placed is not None:
        origin[:3, 3] = _triple(placed, 'xyz', element, source)
        origin[:3, :3] = of_rpy(_triple(placed, 'rpy', element, source))
    if kind == 'fixed':
        return ChainJoint(name, kind, origin, np.zeros(3))
    if element.find('mimic') is not None:
        raise DescriptionError(source, _place(element), f'follows another joint: {EXPECTED}')
    given = element.find('axis')
    axis = np.array([1.0, 0, 0]) if given is None else _triple(given, 'xyz', element, source)
    if not 1e-9 < np.abs(axis).max() < 1e9:
        raise DescriptionError(
            source, _place(element), 'expected an axis that is not zero, nor huge'
        )
    limits, velocity = _limits(element, kind, source)
    return ChainJoint(name, kind, origin, axis / np.linalg.norm(axis), limits, velocity)


def _limits(
    element: ElementTree.Element, kind: str, source: str
) -> tuple[tuple[float, float], float]:
    row = element.find('limit')
    if row is None:
        return (-np.inf, np.inf), np.inf
    values = [_numbers(row, key, 1, '0', element, source)[0] for key in ('lower', 'upper')]
    velocity = _numbers(row, 'velocity', 1, '0', element, source)[0]
    velocity = velocity if velocity > 0 else np.inf
    if kind == 'continuous' or values == [0.0, 0.0]:
        return (-np.inf, np.inf), velocity
    if not values[0] < values[1]:
        raise DescriptionError(source, _place(element), 'expected limits with lower < upper')
    return (values[0], values[1]), velocity


def of_rpy(rpy: Array) -> Array:
    """The rotation (3, 3) of URDF's roll, pitch, yaw (3,): Rz(yaw) Ry(pitch) Rx(roll)."""
    about_x, about_y, about_z = (rotation_matrix(row) for row in np.diag(rpy))
    rotation: Array = about_z @ about_y @ about_x
    return rotation


def _triple(row: ElementTree.Element, key: str, joint: ElementTree.Element, source: str) -> Array:
    return _numbers(row, key, 3, '0 0 0', joint, source)


def _numbers(
    row: ElementTree.Element,
    key: str,
    count: int,
    default: str,
    joint: ElementTree.Element,
    source: str,
) -> Array:
    text = row.get(key, default)
    try:
        numbers = np.array([float(part) for part in text.split()])
    except ValueError:
        numbers = np.array([])
    if len(numbers) != count or not np.isfinite(numbers).all():
        problem = f'{row.tag} {key}: expected {count} number(s), got {text[:40]!r}'
        raise DescriptionError(source, _place(joint), problem)
    return numbers


def _place(joint: ElementTree.Element) -> str:
    return f'joint {joint.get("name", "")!r}'


def _only(names: list[str], source: str, what: str, option: str) -> str:
    if len(names) != 1:
        raise DescriptionError(
            source, '', f'{len(names)} links are its {what} ({_some(names)}): name one by {option}'
        )
    return names[0]


def _some(names: list[str]) -> str:
    listed = ', '.join(names[:MOST_NAMES]) or 'none'
    return f'{listed}, ...' if len(names) > MOST_NAMES else listed
