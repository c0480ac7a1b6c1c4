# SPDX-License-Identifier: Apache-2.0
"""Eq. 12: correction functions of the joint angles, found from the errors that a model leaves.

Eq. 12 gives each coordinate's repeatability error as a function of the joints. The functions are
harmonic series in every joint: `turn`, of what moves the point as that joint does, and `shift`, of
each coordinate alone; and `attitude`, of how the flange is turned. Which of them, how many orders,
and how firmly they are held near zero, is what predicts gauge locations left out best; the
certified distances are kept in the balance as in eq. 11.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DataError
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

    `two_sigma` and `distance` are rms (m) over the locations left out, without and with it.
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
        reason = f'{count} locations, expected {FEWEST_LOCATIONS} to judge it by'
        return CorrectionChoice(False, f'correction of eq. 12 refused: {reason}')
    turns, shifts, _ = (max(orders) for orders in zip(*BASES, strict=True))
    columns = _Columns(table.n, turns, shifts)

    def evaluate(rows: IntArray) -> tuple[Array, Array]:
        return columns.at(problem, table, full, rows)

    sums = accumulate_by(problem, columns.count, evaluate)
    judge = LeaveOneOut(Folds(problem), sums, OBJECTIVE, kappa)
    nothing = np.zeros(columns.count)
    without = judge.scores(np.zeros(0, dtype=np.int64), nothing, nothing)
    found = {
        (basis, strength): judge.scores(columns.of(*basis), strength * columns.information, nothing)
        for basis in BASES
        for strength in STRENGTHS
    }
    gains = {key: scores.against(without) for key, scores in found.items()}
    good = [key for key, gain in gains.items() if gain.convinces and gain.harmless]
    best = min(good or gains, key=lambda key: gains[key].change)
    basis, strength = best
    gain, scores = gains[best], found[best]
    accepted = bool(good) or forced
    what = f'{_words(*basis)}, strength {strength:g}'
    change = (
        f'locations left out change by {gain.words}, their 2 sigma from '
        f'{without.two_sigma_rms * 1e3:.4f} to {scores.two_sigma_rms * 1e3:.4f} mm rms'
    )
    how = 'accepted' if good else 'taken as asked' if forced else 'refused'
    if gain.convinces and not gain.harmless:
        change += f', but of one by {100 * (np.exp(gain.worst) - 1):+.1f} %'
    verdict = f'correction of eq. 12 {how}: {what}: {change}'
    taken, information = columns.of(*basis), strength * columns.information
    step = judge.fit(taken, information, nothing, judge.whole)
    held = judge.whole.normal[np.ix_(taken, taken)] + kappa * np.diag(information[taken])
    sure = np.asarray(kappa * np.linalg.inv(held), dtype=np.float64)
    names = problem.measured.arm.joint_names
    turn, shift, attitude = basis
    return CorrectionChoice(
        accepted,
        verdict,
        turn,
        shift,
        bool(attitude),
        strength,
        gain,
        (without.two_sigma_rms, scores.two_sigma_rms),
        (without.distance_rms, scores.distance_rms),
        len(judge.folds),
        columns.correction(step, basis, names, table.joint_errors(full)) if accepted else None,
        Coefficients(columns, taken, sure) if accepted else None,
    )


@dataclass(frozen=True)
class Coefficients:
    """How sure the coefficients of eq. 12 are that were `taken` (K,) of all columns: `covariance`
    (K, K), m^2 or rad^2."""

    columns: _Columns
    taken: IntArray
    covariance: Array

    def variance(self, problem: Problem, table: ParameterTable, full: Array) -> Array:
        """What that makes of the points of a problem's poses (N,), m^2, coordinates together."""
        _, moved = self.columns.at(problem, table, full, np.arange(len(problem.joints)))
        moved = moved[:, :, self.taken]
        variance: Array = np.einsum('nkf,fg,nkg->n', moved, self.covariance, moved)
        return variance


def _words(turn: int, shift: int, attitude: int) -> str:
    parts = [
        f'{name} of order {order}' for name, order in (('turn', turn), ('shift', shift)) if order
    ]
    return ' and '.join(parts + ['attitude'] * attitude)


class _Columns:
    """The columns of `turn` (2 K n), behind them of `shift` (2 L 3 n), order by order, and of
    `attitude` (27)."""

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
        moved = by_joint(table, problem.measured.arm, jacobian)
        joints, measured = problem.joints[rows], problem.measured
        turns = JointTerms(self.turns).basis(measured.arm, joints)
        by_turn = moved[:, :, None, :] * turns[:, None]
        shifts = harmonic_basis(joints, self.shifts)
        by_shift = np.eye(3)[None, :, None, :, None] * shifts[:, None, :, None, :]
        arm, _ = table.apply(full, measured.arm, measured.probe)
        turned = forward_kinematics(arm, joints)[:, :3, :3].reshape(-1, 1, 1, 9)
        parts = (by_turn, by_shift, np.eye(3)[None, :, :, None] * turned)
        return point, np.concatenate([part.reshape(len(rows), 3, -1) for part in parts], axis=2)

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
