# SPDX-License-Identifier: Apache-2.0
"""A serial arm in classic Denavit-Hartenberg parameters (eqs. 2 to 4), rails included."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.errors import DataError
from calib_model.transforms import RigidTransform

NDArrayBool = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

SLIDE = 1.0  # m
#: how a description gives its parameters: as in eq. 2, or as Craig does
CLASSIC, MODIFIED = CONVENTIONS = ('classic', 'modified')
REVOLUTE, PRISMATIC = JOINT_TYPES = ('revolute', 'prismatic')
#: the five geometric parameters of a joint, in the order of the parameter table
JOINT_PARAMETERS = ('a', 'alpha', 'd', 'theta_0', 'beta')


@dataclass(frozen=True)
class ControllerAxis:
    """How the arm's own controller counts a joint: axis = direction * (q - zero), rad."""

    name: str
    direction: int = 1
    zero: float = 0.0


@dataclass(frozen=True)
class Coupling:
    """A joint that moves by `factor` times the position of another one, besides its own."""

    joint: str
    factor: float


@dataclass(frozen=True)
class Joint:
    """One joint: A = Tz(d) Rz(theta) Tx(a) Rx(alpha) Ry(beta), theta = direction * q - theta_0.

    Of a prismatic joint theta = -theta_0, and d + direction * q takes the place of d. Lengths in m,
    angles in rad; limits in rad, `velocity` in rad/s, `acceleration` in rad/s^2, `jerk` in rad/s^3
    (of a prismatic joint in m, m/s, ..), each infinite where nobody says. `beta` is Hayati's angle
    for an axis that is (nearly) parallel to the next one and zero everywhere else. With a
    `coupling` the q of the formula is q + factor * (q of the other joint). `controller` says what
    the arm's controller shows for it, where that is another number.
    """

    name: str
    a: float
    alpha: float
    d: float
    theta_0: float
    beta: float = 0.0
    direction: int = 1
    limits: tuple[float, float] = (-np.inf, np.inf)
    velocity: float = np.inf
    controller: ControllerAxis | None = None
    acceleration: float = np.inf
    jerk: float = np.inf
    type: str = REVOLUTE
    coupling: Coupling | None = None

    @property
    def prismatic(self) -> bool:
        """Whether it slides; it turns otherwise."""
        return self.type == PRISMATIC

    @property
    def unit(self) -> str:
        """Of its position."""
        return 'm' if self.prismatic else 'rad'


@dataclass(frozen=True)
class Arm:
    """An arm of n joints: T_base_flange = base_T_dh A_1 .. A_n dh_T_flange (eq. 3).

    `base_T_dh` and `dh_T_flange` place the D-H chain between `base_frame` and `flange_frame` where
    its own parameters cannot; `flange_T_controller` is the controller's flange frame in ours.
    `described_in` is the convention of the description it was read from: here all is classic.
    """

    name: str
    joints: tuple[Joint, ...]
    base_frame: str = 'base_link'
    flange_frame: str = 'tool0'
    base_T_dh: RigidTransform = RigidTransform()
    dh_T_flange: RigidTransform = RigidTransform()
    flange_T_controller: RigidTransform = RigidTransform()
    described_in: str = CLASSIC
    geometry: Array = field(init=False, repr=False, compare=False)
    direction: Array = field(init=False, repr=False, compare=False)
    prismatic: NDArrayBool = field(init=False, repr=False, compare=False)
    coupling: Array | None = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        table = [[getattr(joint, key) for joint in self.joints] for key in JOINT_PARAMETERS]
        object.__setattr__(self, 'geometry', frozen(table))
        object.__setattr__(self, 'direction', frozen([j.direction for j in self.joints]))
        slides = np.array([joint.prismatic for joint in self.joints], dtype=bool)
        slides.setflags(write=False)
        object.__setattr__(self, 'prismatic', slides)
        object.__setattr__(self, 'coupling', _coupling(self.joints))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints' names, base first."""
        return tuple(joint.name for joint in self.joints)

    @property
    def limits(self) -> Array:
        """Lower and upper joint limits, shape (n, 2), rad (m of prismatic joints)."""
        return np.array([joint.limits for joint in self.joints])

    @property
    def ranges(self) -> Array:
        """Where postures are looked for, (n, 2): within the limits, half a turn either way at most;
        the whole of a rail, 1 m either way where it has no limits."""
        turns = np.clip(self.limits, -np.pi, np.pi)
        slides = np.where(np.isfinite(self.limits), self.limits, [-SLIDE, SLIDE])
        return np.where(self.prismatic[:, None], slides, turns)

    @property
    def zero(self) -> Array:
        """The posture (n,) in which all joints are zero, or as near to it as limits let."""
        return np.clip(np.zeros(self.n), *self.limits.T)

    @property
    def velocity(self) -> Array:
        """Largest joint speeds, shape (n,), rad/s (m/s of prismatic joints)."""
        return np.array([joint.velocity for joint in self.joints])

    @property
    def acceleration(self) -> Array:
        """Largest joint accelerations, shape (n,), rad/s^2; infinite where nobody says."""
        return np.array([joint.acceleration for joint in self.joints])

    @property
    def jerk(self) -> Array:
        """Largest joint jerks, shape (n,), rad/s^3; infinite where nobody says."""
        return np.array([joint.jerk for joint in self.joints])

    def with_geometry(self, geometry: Array) -> Arm:
        """The same arm with other D-H values: rows a, alpha, d, theta_0, beta, shape (5, n)."""
        joints = []
        for joint, column in zip(self.joints, np.asarray(geometry).T, strict=True):
            values: dict[str, Any] = dict(zip(JOINT_PARAMETERS, map(float, column), strict=True))
            joints.append(replace(joint, **values))
        return replace(self, joints=tuple(joints))

    def check_joints(self, q: Array) -> Array:
        """`q` as float64 of shape (N, n).

        Raises:
            DataError: the number of joints is not the arm's.
        """
        q = np.atleast_2d(np.asarray(q, dtype=np.float64))
        if q.ndim != 2 or q.shape[1] != self.n:
            raise DataError(f'{self.name}: expected {self.n} joint positions, got {q.shape[-1]}')
        return q

    def uncoupled(self, q: Array) -> Array:
        """How far each joint itself has moved (N, n) in postures q (N, n), before its direction.

        Raises:
            DataError: the number of joints is not the arm's.
        """
        q = self.check_joints(q)
        return q if self.coupling is None else q @ self.coupling.T

    def coupled(self, moved: Array) -> Array:
        """The postures q (N, n) in which each joint itself has moved so far: `uncoupled`, undone.

        Raises:
            DataError: the number of joints is not the arm's.
        """
        moved = self.check_joints(moved)
        if self.coupling is None:
            return moved
        return np.asarray(np.linalg.solve(self.coupling, moved.T).T, dtype=np.float64)

    @property
    def without_coupling(self) -> Arm:
        """The arm whose positions are what each joint itself has moved: `uncoupled`."""
        if self.coupling is None:
            return self
        # a joint without limits that plays no part: 0 times infinity is nothing here
        factor = self.coupling[:, :, None]
        reach = factor * np.where(factor == 0, 0.0, self.limits)
        limits = np.sort(reach, axis=2).sum(axis=1)
        joints = [
            replace(joint, coupling=None, limits=(float(lower), float(upper)))
            for joint, (lower, upper) in zip(self.joints, limits, strict=True)
        ]
        return replace(self, joints=tuple(joints))

    def by_positions(self, by_own: Array) -> Array:
        """Derivatives (..., n) by the positions q from those by each joint's own motion."""
        return by_own if self.coupling is None else by_own @ self.coupling

    def within_limits(self, q: Array, margin: float = 0.0) -> NDArrayBool:
        """Which of the postures q (N, n) keep `margin` (rad, m) from every joint limit, (N,)."""
        q = self.check_joints(q)
        lower, upper = self.limits.T
        inside: NDArrayBool = np.all((q >= lower + margin) & (q <= upper - margin), axis=1)
        return inside


def _coupling(joints: tuple[Joint, ...]) -> Array | None:
    """The matrix (n, n) of `Arm.uncoupled`, None where every joint moves by itself.

    Raises:
        DataError: a joint is coupled to one that is not there, to itself, or in a circle.
    """
    if not any(joint.coupling for joint in joints):
        return None
    names = [joint.name for joint in joints]
    matrix = np.eye(len(joints))
    for i, joint in enumerate(joints):
        if joint.coupling is None:
            continue
        if joint.coupling.joint not in names:
            raise DataError(
                f'{joint.name}: coupled to {joint.coupling.joint!r}, expected one of '
                f'{", ".join(names)}'
            )
        other = names.index(joint.coupling.joint)
        if other == i or joints[other].coupling is not None:
            raise DataError(f'{joint.name}: expected a coupling to another joint that has none')
        if joints[other].prismatic != joint.prismatic:
            raise DataError(f'{joint.name}: one that turns and one that slides are not coupled')
        matrix[i, other] = joint.coupling.factor
    return frozen(matrix)
