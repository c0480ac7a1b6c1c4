# SPDX-License-Identifier: Apache-2.0
"""The one named table of parameters: the only way from names to places in a vector."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, frozen
from calib_model.errors import DataError
from calib_model.instruments import JOINT_PARAMETERS, Arm, Probe
from calib_model.kinematics.joint_errors import JointErrors, JointTerms
from calib_model.transforms import RigidTransform

PROBE_PARAMETERS = ('probe_x', 'probe_y', 'probe_z', 'probe_rx', 'probe_ry', 'probe_rz')
LENGTHS = ('a', 'd')

#: standard deviations by kind of parameter, m and rad: what a machined, assembled and mastered
#: industrial arm keeps to; a probe's mount is known to a few centimetres and degrees at best
DEFAULT_SIGMA: dict[str, float] = {
    'a': 5e-4,
    'alpha': 1e-3,
    'd': 5e-4,
    'theta_0': 2e-3,
    'beta': 1e-3,
    'probe_translation': 5e-2,
    'probe_rotation': 2e-1,
    # a disc of an encoder some micrometres off its axis; a joint that gives 1 mrad to 50 N m
    'encoder': 1e-4,
    # a rail's rack or scale, some tenths of a mm over a metre
    'scale': 2e-4,
    'compliance': 2e-5,
}


@dataclass(frozen=True)
class Parameter:
    """One parameter of the model.

    `kind` is a, alpha, d, theta_0, beta, probe_translation or probe_rotation, and encoder, scale
    or compliance where joint errors are identified; `joint` counts from 1 and is 0 for the probe's;
    `nominal` in `unit` (m, rad, m/m or rad/(N m)). `reason` says why it is frozen.
    """

    name: str
    kind: str
    joint: int
    unit: str
    nominal: float
    free: bool = True
    reason: str = ''


@dataclass(frozen=True)
class ParameterTable:
    """All parameters of an arm of n joints with its probe: the 5n + 6 columns of a Jacobian.

    Columns: a1..an, alpha1.., d1.., theta_0_1.., beta1.., then the probe's translation and
    rotation vector, then, with `joint_terms`, their n values each, term by term. A vector over all
    of them is `full`; one over the free ones is `free`.
    """

    parameters: tuple[Parameter, ...]
    n: int
    joint_terms: JointTerms | None = None
    nominal: Array = field(init=False, repr=False, compare=False)
    free_columns: NDArray[np.int64] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'nominal', frozen([p.nominal for p in self.parameters]))
        free = np.array([i for i, p in enumerate(self.parameters) if p.free], dtype=np.int64)
        free.setflags(write=False)
        object.__setattr__(self, 'free_columns', free)

    @classmethod
    def of(cls, arm: Arm, probe: Probe) -> ParameterTable:
        """Every parameter free, at the values of `arm` and `probe`."""
        rows = []
        for kind, values in zip(JOINT_PARAMETERS, arm.geometry, strict=True):
            unit = 'm' if kind in LENGTHS else 'rad'
            for joint, value in enumerate(values, start=1):
                name = f'{kind}_{joint}' if kind == 'theta_0' else f'{kind}{joint}'
                rows.append(Parameter(name, kind, joint, unit, float(value)))
        mount = probe.flange_T_probe
        for name, value in zip(PROBE_PARAMETERS[:3], mount.translation, strict=True):
            rows.append(Parameter(name, 'probe_translation', 0, 'm', float(value)))
        for name, value in zip(PROBE_PARAMETERS[3:], mount.rotation_vector, strict=True):
            rows.append(Parameter(name, 'probe_rotation', 0, 'rad', float(value)))
        return cls(tuple(rows), arm.n)

    def with_joint_terms(self, terms: JointTerms) -> ParameterTable:
        """The same table with the values of joint errors behind, free, from zero on."""
        rows = [
            Parameter(f'{name}{joint}', kind, joint, unit, 0.0)
            for kind, name, unit in terms.names
            for joint in range(1, self.n + 1)
        ]
        kept = self.parameters[: self.mount.stop]
        return ParameterTable((*kept, *rows), self.n, terms)

    @property
    def mount(self) -> slice:
        """The columns of the probe's translation and rotation vector."""
        size = len(JOINT_PARAMETERS) * self.n
        return slice(size, size + len(PROBE_PARAMETERS))

    @property
    def names(self) -> tuple[str, ...]:
        """Every parameter's name, in column order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def of_arm(self) -> NDArray[np.bool_]:
        """Which free parameters are D-H parameters of the arm, shape (F,)."""
        return np.array([parameter.kind in JOINT_PARAMETERS for parameter in self.free], dtype=bool)

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The parameters that are identified, in column order."""
        return tuple(self.parameters[i] for i in self.free_columns)

    def column(self, name: str) -> int:
        """The column of a parameter.

        Raises:
            DataError: there is no parameter of that name.
        """
        return self.matching(name)[0]

    def matching(self, pattern: str) -> list[int]:
        """Columns of the parameters whose names match a shell pattern such as `d*`.

        Raises:
            DataError: none does.
        """
        columns = [i for i, name in enumerate(self.names) if fnmatchcase(name, pattern)]
        if not columns:
            known = ', '.join(self.names)
            raise DataError(f'no parameter is called {pattern!r} (there are {known})')
        return columns

    def frozen_at(self, columns: Iterable[int], reason: str) -> ParameterTable:
        """The same table with these columns held at their nominal values, and why."""
        rows = list(self.parameters)
        for i in columns:
            rows[i] = replace(rows[i], free=False, reason=reason)
        return replace(self, parameters=tuple(rows))

    def freed(self, columns: Iterable[int]) -> ParameterTable:
        """The same table with these columns identified; why they were not is kept."""
        rows = list(self.parameters)
        for i in columns:
            rows[i] = replace(rows[i], free=True)
        return replace(self, parameters=tuple(rows))

    def full(self, free: Array) -> Array:
        """A vector over all columns from one over the free ones; the others are nominal."""
        vector = self.nominal.copy()
        vector[self.free_columns] = free
        return vector

    def apply(self, full: Array, arm: Arm, probe: Probe) -> tuple[Arm, Probe]:
        """`arm` and `probe` with the values of a full vector."""
        size = len(JOINT_PARAMETERS) * self.n
        geometry = np.reshape(full[:size], (len(JOINT_PARAMETERS), self.n))
        mount = full[self.mount]
        placed = RigidTransform(mount[:3], mount[3:])
        return arm.with_geometry(geometry), probe.mounted(placed)

    def joint_errors(self, full: Array) -> JointErrors | None:
        """The joint errors of a full vector, None where the table has none."""
        if self.joint_terms is None:
            return None
        values = np.reshape(full[self.mount.stop :], (self.joint_terms.count, self.n))
        return JointErrors(self.joint_terms, values)
