# SPDX-License-Identifier: Apache-2.0
"""A serial arm of revolute joints in classic Denavit-Hartenberg parameters (eqs. 2 to 4)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.errors import DataError
from calib_model.transforms import RigidTransform

#: the five geometric parameters of a joint, in the order of the parameter table
JOINT_PARAMETERS = ('a', 'alpha', 'd', 'theta_0', 'beta')


@dataclass(frozen=True)
class ControllerAxis:
    """How the arm's own controller counts a joint: axis = direction * (q - zero), rad."""

    name: str
    direction: int = 1
    zero: float = 0.0


@dataclass(frozen=True)
class Joint:
    """One joint: A = Tz(d) Rz(theta) Tx(a) Rx(alpha) Ry(beta), theta = direction * q - theta_0.

    Lengths in m, angles in rad, `velocity` in rad/s, `acceleration` in rad/s^2, `jerk` in rad/s^3,
    each infinite where nobody says; `beta` is Hayati's angle for an axis that is (nearly) parallel
    to the next one and zero everywhere else. `controller` says what the arm's controller shows for
    it, where that is another number.
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


@dataclass(frozen=True)
class Arm:
    """An arm of n joints: T_base_flange = base_T_dh A_1 .. A_n dh_T_flange (eq. 3).

    `base_T_dh` and `dh_T_flange` place the D-H chain between `base_frame` and `flange_frame` where
    its own parameters cannot; `flange_T_controller` is the controller's flange frame in ours.
    """

    name: str
    joints: tuple[Joint, ...]
    base_frame: str = 'base_link'
    flange_frame: str = 'tool0'
    base_T_dh: RigidTransform = RigidTransform()
    dh_T_flange: RigidTransform = RigidTransform()
    flange_T_controller: RigidTransform = RigidTransform()
    geometry: Array = field(init=False, repr=False, compare=False)
    direction: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        table = [[getattr(joint, key) for joint in self.joints] for key in JOINT_PARAMETERS]
        object.__setattr__(self, 'geometry', frozen(table))
        object.__setattr__(self, 'direction', frozen([j.direction for j in self.joints]))

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
        """Lower and upper joint limits, shape (n, 2), rad."""
        return np.array([joint.limits for joint in self.joints])

    @property
    def velocity(self) -> Array:
        """Largest joint speeds, shape (n,), rad/s."""
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

    def within_limits(self, q: Array, margin: float = 0.0) -> NDArrayBool:
        """Which of the postures q (N, n) keep `margin` rad from every joint limit, shape (N,)."""
        q = self.check_joints(q)
        lower, upper = self.limits.T
        inside: NDArrayBool = np.all((q >= lower + margin) & (q <= upper - margin), axis=1)
        return inside


NDArrayBool = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
