# SPDX-License-Identifier: Apache-2.0
"""What changed between two calibrations of one arm, against their joint uncertainty.

The difference d of the parameters has the covariance C of what the two do not have in common:
each one's poses, and of certificate and prior what they weigh differently. d' C^-1 d follows
Hotelling's distribution where nothing changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, fdtri, stdtrit

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.instruments import PassiveProbe
from calib_model.kinematics import CorrectedArm, JointTerms
from calib_solver.acceptance.certificate import certificate_roots, same_certificate, together
from calib_solver.acceptance.stored_result import StoredResult
from calib_solver.compensation import tip
from calib_solver.problem import posture_jacobian

Truth = NDArray[np.bool_]

#: how often something is said to have changed where nothing did
LEVEL = 0.05
#: directions that are so much surer than the others are rounding (of variance)
ROUNDING = 1e-10
POSTURES = 500


@dataclass(frozen=True)
class Compared:
    """Differences `size` (F,) of the parameters `names`, later less earlier, with their joint
    `covariance` (F, F), m and rad, known by `freedom` residuals."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    earlier: Array
    later: Array
    size: Array
    covariance: Array
    freedom: int

    @property
    def standard(self) -> Array:
        """Joint standard uncertainty (F,) of the differences."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def of_arm(self) -> Truth:
        """Which of them are not the probe's place on the flange, (F,)."""
        return np.array([not name.startswith('probe_') for name in self.names], dtype=bool)

    def part(self, rows: Truth) -> Compared:
        """Some of the parameters."""
        return replace(
            self,
            names=tuple(np.array(self.names)[rows]),
            units=tuple(np.array(self.units)[rows]),
            earlier=self.earlier[rows],
            later=self.later[rows],
            size=self.size[rows],
            covariance=self.covariance[np.ix_(rows, rows)],
        )

    def chance(self) -> float:
        """How often a difference like this comes by chance where nothing changed."""
        square, rank = mahalanobis(self.size, self.covariance)
        if rank == 0:
            return 1.0
        free = max(self.freedom - rank + 1, 1)
        return float(fdtrc(rank, free, square * free / (max(self.freedom, rank) * rank)))

    def bound(self, level: float) -> float:
        """The square of d' C^-1 d that is exceeded so often by chance, in any direction."""
        rank = len(self.names)
        free = max(self.freedom - rank + 1, 1)
        limit = float(fdtri(rank, free, 1 - level))
        return limit * rank * max(self.freedom, rank) / free

    def beyond(self, level: float) -> Truth:
        """Which parameters (F,) differ by more than chance has it, all of them counted."""
        limit = float(stdtrit(max(self.freedom, 1), 1 - level / 2 / max(len(self.names), 1)))
        found: Truth = np.abs(self.size) > limit * self.standard
        return found


@dataclass(frozen=True)
class Positions:
    """The same place on the flange at `joints` (K, n), rad: where the earlier arm has it, `points`
    (K, 3), by how much the later one differs, `change` (K, 3), m, the joint `standard` uncertainty
    (K,) of that, and where it is `beyond` (K,) chance."""

    joints: Array
    points: Array
    change: Array
    standard: Array
    beyond: Truth

    @property
    def size(self) -> Array:
        """The length of the change (K,), m."""
        return np.linalg.norm(self.change, axis=1)


def mahalanobis(size: Array, covariance: Array) -> tuple[float, int]:
    """d' C^-1 d, and the rank of C."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = scale > 0
    if not known.any():
        return (0.0, 0) if not size.any() else (np.inf, 1)
    scaled = size[known] / scale[known]
    values, axes = np.linalg.eigh(covariance[np.ix_(known, known)] / np.outer(*[scale[known]] * 2))
    kept = values > ROUNDING * values.max()
    along = axes[:, kept].T @ scaled
    return float(along @ (along / values[kept])), int(kept.sum())


def difference(earlier: StoredResult, later: StoredResult) -> Compared:
    """What the later calibration has otherwise, with the joint uncertainty of that.

    Raises:
        DataError: they are of two arms, or with other masses of the links.
    """
    terms = _terms(earlier, later)
    tables = [one.table_with(terms) for one in (earlier, later)]
    nominal = [table.nominal for table in tables]
    found = set(earlier.stated.names) | set(later.stated.names)
    first = tables[0]
    rows = [i for i, n in enumerate(first.names) if n in found or nominal[0][i] != nominal[1][i]]
    names = tuple(first.names[i] for i in rows)
    one, other = (_Expanded.of(result, names) for result in (earlier, later))
    width = np.maximum(one.width, other.width)
    by_prior = (other.prior - one.prior) * width
    same = same_certificate(earlier.stated.gauge, later.stated.gauge)
    by_gauge = together(
        certificate_roots(-one.certificate, earlier.stated.gauge),
        certificate_roots(other.certificate, later.stated.gauge),
        same,
    )
    covariance = one.noise + other.noise + by_prior @ by_prior.T + by_gauge @ by_gauge.T
    values = [result.full_with(terms)[rows] for result in (earlier, later)]
    # what another nominal value leads to is no change of the arm
    led = other.prior @ (nominal[0] - nominal[1])[rows]
    return Compared(
        names,
        tuple(first.parameters[i].unit for i in rows),
        values[0],
        values[1],
        values[1] - values[0] - led,
        covariance,
        earlier.stated.shares.poses.freedom + later.stated.shares.poses.freedom,
    )


@dataclass(frozen=True)
class _Expanded:
    """The error shares of a result over more parameters than it identified: those that it held are
    as far off as the truth is from nominal."""

    noise: Array
    certificate: Array
    prior: Array
    width: Array

    @classmethod
    def of(cls, result: StoredResult, names: tuple[str, ...]) -> _Expanded:
        shares, count = result.stated.shares, len(names)
        place = [names.index(name) for name in result.stated.names]
        noise, prior = np.zeros((count, count)), -np.eye(count)
        noise[np.ix_(place, place)] = shares.noise
        prior[np.ix_(place, place)] = shares.prior
        certificate, width = np.zeros((count, shares.certificate.shape[1])), np.zeros(count)
        certificate[place], width[place] = shares.certificate, shares.width
        return cls(noise, certificate, prior, width)


def _terms(earlier: StoredResult, later: StoredResult) -> JointTerms | None:
    """Columns for the joint errors of both.

    Raises:
        DataError: they are of two arms, or with other masses of the links.
    """
    if (earlier.arm.name, earlier.arm.joint_names) != (later.arm.name, later.arm.joint_names):
        raise DataError(
            f'{later.folder}: calibrates {later.arm.name}, {earlier.folder} {earlier.arm.name}: '
            'only calibrations of one arm can be compared'
        )
    if earlier.probe.kind != later.probe.kind:
        raise DataError(
            f'{later.folder}: {later.probe.kind} probe, but {earlier.folder} is '
            f'{earlier.probe.kind}'
        )
    terms = [one.terms for one in (earlier, later) if one.terms is not None]
    if not terms:
        return None
    links = [one.links for one in terms if one.links is not None]
    if len(links) == 2 and repr(links[0]) != repr(links[1]):
        raise DataError(f'{later.folder}: other masses of the links than in {earlier.folder}')
    return JointTerms(
        max(one.harmonics for one in terms),
        links[0] if links else None,
        any(one.scale for one in terms),
    )


def positions(
    earlier: StoredResult, later: StoredResult, compared: Compared, level: float
) -> Positions:
    """By how much the arm alone, its base and the tool on its flange the same, is elsewhere, at
    postures drawn evenly between the joint limits."""
    arm = earlier.arm
    lower, upper = arm.ranges.T
    joints = np.random.default_rng(0).uniform(lower, upper, (POSTURES, arm.n))
    mount = tip(earlier.probe)
    before, after = (
        CorrectedArm(one.arm, one.calibrated.correction).points(joints, mount.translation)
        for one in (earlier, later)
    )
    part = compared.part(compared.of_arm)
    slope = _slopes(earlier, later, joints, part.names)
    of_points = slope @ part.covariance @ np.swapaxes(slope, 1, 2)
    change = after - before
    limit = part.bound(level)
    squares = [mahalanobis(*one)[0] for one in zip(change, of_points, strict=True)]
    standard = np.sqrt(np.trace(of_points, axis1=1, axis2=2))
    return Positions(joints, before, change, standard, np.array(squares) > limit)


def _slopes(
    earlier: StoredResult, later: StoredResult, joints: Array, names: tuple[str, ...]
) -> Array:
    """How the tip moves with parameters (K, 3, F) at postures (K, n)."""
    terms = _terms(earlier, later)
    table = earlier.table_with(terms)
    # the tip as a seat: where its centre is, whatever kind of probe it belongs to
    seat = PassiveProbe(earlier.probe.name, tip(earlier.probe))
    full, center = earlier.full_with(terms), np.zeros((len(joints), 3))
    _, jacobian = posture_jacobian(earlier.arm, seat, table, full, joints, center)
    taken: Array = jacobian[:, :, [table.column(name) for name in names]]
    return taken
