# SPDX-License-Identifier: Apache-2.0
"""Eq. 12: correction functions of the joint angles, found from the errors that a model leaves.

Eq. 12 gives each coordinate's repeatability error as a function of the joints. The functions are
harmonic series in every joint: `turn`, of what moves the point as that joint does, and `shift`, of
each coordinate alone; and `attitude`, of how the flange is turned. Which of them, how many orders,
and how firmly they are held near zero, is what predicts gauge locations left out best; the
certified distances are kept in the balance as in eq. 11.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.instruments import Arm
from calib_model.kinematics import (
    Attitude,
    Correction,
    JointErrors,
    JointTerms,
    ParameterTable,
    Shift,
    forward_kinematics,
    harmonic_basis,
)
from calib_solver.error_models.validation_gain import FEWEST_LOCATIONS, Gain, LeaveOneOut
from calib_solver.problem import (
    Folds,
    IntArray,
    Problem,
    accumulate_by,
    by_joint,
    point_jacobian,
)

CHOICES = ('off', 'auto', 'harmonic')
#: orders of `turn` and of `shift`, and whether with `attitude`, that are tried
BASES = (
    (1, 0, 0),
    (2, 0, 0),
    (3, 0, 0),
    (0, 1, 0),
    (0, 2, 0),
    (2, 1, 0),
    (2, 2, 0),
    (3, 2, 0),
    (0, 0, 1),
    (1, 0, 1),
    (2, 0, 1),
    (2, 1, 1),
    (2, 2, 1),
    (3, 2, 1),
)
#: how firmly: times the weight that the poses' noise gives a coefficient of these sizes
STRENGTHS = (1.0, 10.0, 100.0, 1000.0, 10000.0)
TURN_SIGMA = 1e-4  # rad, of the first order; the k-th has a k-th of it
SHIFT_SIGMA = 1e-4  # m, of the attitude's too
OBJECTIVE = 'distance_repeatability'


@dataclass(frozen=True)
class CorrectionChoice:
    """What came of eq. 12: the best basis, `turn` and `shift` orders and whether with `attitude`,
    held with `strength`, what it gains on locations left out, and whether the `correction` was
    `accepted`.

    `two_sigma` and `distance` are rms (m) over the locations left out, without and with it;
    measured points have neither.
    """

    accepted: bool
    verdict: str
    turn: int = 0
    shift: int = 0
    attitude: bool = False
    strength: float = 0.0
    gain: Gain | None = None
    two_sigma: tuple[float, float] | None = None
    distance: tuple[float, float] | None = None
    folds: int = 0
    correction: Correction | None = None
    coefficients: Coefficients | None = None


def checked_choice(choice: str) -> str:
    """The choice itself.

    Raises:
        DataError: there is none such.
    """
    if choice not in CHOICES:
        raise DataError(f'no correction {choice!r}: expected one of {", ".join(CHOICES)}')
    return choice


def fit_correction(
    problem: Problem, table: ParameterTable, full: Array, kappa: float, forced: bool = False
) -> CorrectionChoice:
    """The correction of eq. 12 for the model of a table at `full`, or why there is none.

    `kappa` (m^2) is the mean square of eq. 11's residuals there. Refused where locations left out
    do not get better by it beyond doubt, unless `forced`.
    """
    count = len(problem.locations)
    if count < FEWEST_LOCATIONS:
        return too_few(f'{count} locations, expected {FEWEST_LOCATIONS} to judge it by')
    columns = CorrectionColumns.all(table.n)

    def evaluate(rows: IntArray) -> tuple[Array, Array]:
        return columns.at(problem, table, full, rows)

    sums = accumulate_by(problem, columns.count, evaluate)
    judge = LeaveOneOut(Folds(problem), sums, OBJECTIVE, kappa)
    nothing = np.zeros(columns.count)
    without = judge.scores(np.zeros(0, dtype=np.int64), nothing, nothing)
    found = best_basis(
        columns, lambda used, held: judge.scores(used, held, nothing).against(without)
    )
    scores = judge.scores(found.taken, found.information, nothing)
    change = (
        f'locations left out change by {found.gain.words}, their 2 sigma from '
        f'{without.two_sigma_rms * 1e3:.4f} to {scores.two_sigma_rms * 1e3:.4f} mm rms'
    )
    step = judge.fit(found.taken, found.information, nothing, judge.whole)
    held = judge.whole.normal[np.ix_(found.taken, found.taken)]
    held = held + kappa * np.diag(found.information[found.taken])
    sure = np.asarray(kappa * np.linalg.inv(held), dtype=np.float64)
    errors = table.joint_errors(full)
    choice = found.choice(problem.measured.arm, change, step, sure, errors, forced)
    return replace(
        choice,
        two_sigma=(without.two_sigma_rms, scores.two_sigma_rms),
        distance=(without.distance_rms, scores.distance_rms),
        folds=len(judge.folds),
    )


def too_few(reason: str) -> CorrectionChoice:
    """No correction, for want of what to judge it by."""
    return CorrectionChoice(False, f'correction of eq. 12 refused: {reason}')


def best_basis(
    columns: CorrectionColumns, gain_of: Callable[[IntArray, Array], Gain]
) -> FoundBasis:
    """The basis and strength whose gain on what is left out is best, of those that do no harm where
    there are any; `gain_of` takes the columns used and what holds all of them near zero."""
    gains = {
        (basis, strength): gain_of(columns.of(*basis), strength * columns.information)
        for basis in BASES
        for strength in STRENGTHS
    }
    good = [key for key, gain in gains.items() if gain.convinces and gain.harmless]
    best = min(good or gains, key=lambda key: gains[key].change)
    return FoundBasis(columns, *best, gains[best], bool(good))


@dataclass(frozen=True)
class FoundBasis:
    """Orders of `turn` and `shift` and whether with `attitude`, how firmly they are held, what that
    gains, and whether it is `good`: convincing and harmless."""

    columns: CorrectionColumns
    basis: tuple[int, int, int]
    strength: float
    gain: Gain
    good: bool

    @property
    def taken(self) -> IntArray:
        """Its columns."""
        return self.columns.of(*self.basis)

    @property
    def information(self) -> Array:
        """What holds all columns near zero (F,), times the residuals' mean square."""
        return self.strength * self.columns.information

    def choice(
        self,
        arm: Arm,
        change: str,
        step: Array,
        sure: Array,
        joint_errors: JointErrors | None,
        forced: bool,
    ) -> CorrectionChoice:
        """What became of it: `change` says so in words; coefficients `step` (F,), of covariance
        `sure` (K, K) where they were taken."""
        accepted = self.good or forced
        how = 'accepted' if self.good else 'taken as asked' if forced else 'refused'
        if self.gain.convinces and not self.gain.harmless:
            change += f', but of one by {100 * (np.exp(self.gain.worst) - 1):+.1f} %'
        what = f'{_words(*self.basis)}, strength {self.strength:g}'
        turn, shift, attitude = self.basis
        columns, names = self.columns, arm.joint_names
        return CorrectionChoice(
            accepted,
            f'correction of eq. 12 {how}: {what}: {change}',
            turn,
            shift,
            bool(attitude),
            self.strength,
            self.gain,
            correction=columns.correction(step, self.basis, names, joint_errors)
            if accepted
            else None,
            coefficients=Coefficients(columns, self.taken, sure) if accepted else None,
        )


@dataclass(frozen=True)
class Coefficients:
    """How sure the coefficients of eq. 12 are that were `taken` (K,) of all columns: `covariance`
    (K, K), m^2 or rad^2."""

    columns: CorrectionColumns
    taken: IntArray
    covariance: Array

    def variance(self, problem: Problem, table: ParameterTable, full: Array) -> Array:
        """What that makes of the points of a problem's poses (N,), m^2, coordinates together."""
        return self.variance_of(
            self.columns.at(problem, table, full, np.arange(len(problem.joints)))[1]
        )

    def variance_of(self, moved: Array) -> Array:
        """The same of points that move with all columns by `moved` (N, 3, F)."""
        moved = moved[:, :, self.taken]
        variance: Array = np.einsum('nkf,fg,nkg->n', moved, self.covariance, moved)
        return variance


def _words(turn: int, shift: int, attitude: int) -> str:
    parts = [
        f'{name} of order {order}' for name, order in (('turn', turn), ('shift', shift)) if order
    ]
    return ' and '.join(parts + ['attitude'] * attitude)


class CorrectionColumns:
    """The columns of `turn` (2 K n), behind them of `shift` (2 L 3 n), order by order, and of
    `attitude` (27)."""

    @classmethod
    def all(cls, n: int) -> CorrectionColumns:
        """Those of all BASES, for an arm of n joints."""
        turns, shifts, _ = (max(orders) for orders in zip(*BASES, strict=True))
        return cls(n, turns, shifts)

    def __init__(self, n: int, turns: int, shifts: int) -> None:
        self.n, self.turns, self.shifts = n, turns, shifts
        self.first_shift = 2 * turns * n
        self.first_attitude = self.first_shift + 6 * shifts * n
        self.count = self.first_attitude + 27
        order = np.concatenate(
            [
                np.repeat(np.arange(1, turns + 1), 2 * n),
                np.repeat(np.arange(1, shifts + 1), 6 * n),
                np.ones(27),
            ]
        )
        sigma = np.where(np.arange(self.count) < self.first_shift, TURN_SIGMA, SHIFT_SIGMA)
        self.information: Array = (order / sigma) ** 2

    def of(self, turn: int, shift: int, attitude: int) -> IntArray:
        """The columns of so many orders."""
        shifts = self.first_shift + np.arange(6 * shift * self.n)
        last = self.first_attitude + np.arange(27 * attitude)
        return np.concatenate([np.arange(2 * turn * self.n), shifts, last])

    def at(
        self, problem: Problem, table: ParameterTable, full: Array, rows: IntArray
    ) -> tuple[Array, Array]:
        """Points (R, 3) of some poses and what the columns add to them (R, 3, F)."""
        point, jacobian = point_jacobian(problem, table, full, rows)
        arm, _ = table.apply(full, problem.measured.arm, problem.measured.probe)
        return point, self.moving(table, arm, problem.joints[rows], jacobian)

    def moving(self, table: ParameterTable, arm: Arm, joints: Array, jacobian: Array) -> Array:
        """What the columns add (R, 3, F) to points of an arm at `joints` (R, n), whose `jacobian`
        by all parameters of the table is (R, 3, C)."""
        shifts = harmonic_basis(joints, self.shifts)
        by_shift = np.eye(3)[None, :, None, :, None] * shifts[:, None, :, None, :]
        turned = forward_kinematics(arm, joints)[:, :3, :3].reshape(-1, 1, 1, 9)
        by_attitude = np.eye(3)[None, :, :, None] * turned
        parts = (self.turning(table, arm, joints, jacobian), by_shift, by_attitude)
        return np.concatenate([part.reshape(len(joints), 3, -1) for part in parts], axis=2)

    def turning(self, table: ParameterTable, arm: Arm, joints: Array, jacobian: Array) -> Array:
        """What those of `turn` add (R, 3, 2 K n), of points or of how the flange is turned."""
        moved = by_joint(table, arm, jacobian)
        turns = JointTerms(self.turns).basis(arm, joints)
        return (moved[:, :, None, :] * turns[:, None]).reshape(len(joints), 3, -1)

    def correction(
        self,
        step: Array,
        basis: tuple[int, int, int],
        joint_names: tuple[str, ...],
        joint_errors: JointErrors | None,
    ) -> Correction:
        """The coefficients as a correction."""
        turn, shift, attitude = basis
        turned = step[: 2 * turn * self.n].reshape(-1, self.n)
        shifted = step[self.first_shift :][: 6 * shift * self.n].reshape(-1, 3, self.n)
        return Correction(
            joint_names,
            joint_errors,
            JointErrors(JointTerms(turn), turned) if turn else None,
            Shift(shifted) if shift else None,
            Attitude(step[self.first_attitude :].reshape(3, 3, 3)) if attitude else None,
        )
