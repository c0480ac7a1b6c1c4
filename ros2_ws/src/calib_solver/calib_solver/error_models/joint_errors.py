# SPDX-License-Identifier: Apache-2.0
"""Which joint errors are identified with the D-H parameters: those that locations left out want."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.instruments import Arm
from calib_model.kinematics import (
    COMPLIANCE,
    ENCODER,
    ENCODER_HARMONICS,
    KINDS,
    SCALE,
    JointTerms,
    Links,
    ParameterTable,
)
from calib_solver.error_models.validation_gain import FEWEST_LOCATIONS, Gain, LeaveOneOut
from calib_solver.fitting import AUTO, Fit, Solver
from calib_solver.problem import Folds, IntArray

#: a joint on which gravity's torque stays below this (N m) says nothing of its compliance
LEAST_TORQUE = 1e-6
#: where a rail's scale is, and where users would look for it in vain
IN_NO_URDF = '; correction.yaml has it: no URDF can'
#: a rail that moves less than this (m) says nothing of its scale
LEAST_TRAVEL = 0.01


@dataclass(frozen=True)
class Tried:
    """A kind of joint error with what it gains on locations left out, and whether it was taken."""

    kind: str
    gain: Gain
    accepted: bool


@dataclass(frozen=True)
class JointErrorChoice:
    """What was `offered` and `tried`, one after the other; `folds` parts of the locations, or of
    whatever else was `left_out`. Where nobody `asked` for them, only those that are identified are
    spoken of."""

    offered: tuple[str, ...]
    tried: tuple[Tried, ...]
    folds: int
    refusal: str = ''
    asked: bool = True
    left_out: str = 'locations'

    @property
    def accepted(self) -> tuple[str, ...]:
        """The kinds that are identified."""
        return tuple(one.kind for one in self.tried if one.accepted)

    @property
    def lines(self) -> list[str]:
        """What became of each kind, one line each."""
        if self.refusal:
            return [f'joint errors refused: {self.refusal}'] if self.asked else []
        return [
            f'joint errors, {one.kind} {"identified" if one.accepted else "refused"}: '
            f'{self.left_out} left out change by {one.gain.words}'
            f'{IN_NO_URDF if one.kind == SCALE and one.accepted else ""}'
            for one in self.tried
            if one.accepted or self.asked
        ]


def chosen_kinds(text: str) -> tuple[str, ...]:
    """The kinds that a command's option names, separated by commas; '' is AUTO, 'none' none."""
    if text.strip() in ('', AUTO):
        return (AUTO,)
    if text.strip() == 'none':
        return ()
    return tuple(dict.fromkeys(part.strip() for part in text.split(',') if part.strip()))


def checked_kinds(
    kinds: tuple[str, ...], links: Links | None, arm: Arm | None = None
) -> tuple[str, ...]:
    """The kinds themselves, AUTO those that can be identified of an arm.

    Raises:
        DataError: an unknown kind, compliance without the masses of the links, or the scale of an
            arm whose joints all turn.
    """
    slides = arm is not None and bool(arm.prismatic.any())
    if kinds == (AUTO,):
        given = {ENCODER: True, SCALE: slides, COMPLIANCE: links is not None}
        return tuple(kind for kind in KINDS if given[kind])
    for kind in kinds:
        if kind not in KINDS:
            known = ', '.join((AUTO, 'none', *KINDS))
            raise DataError(f'no joint error {kind!r}: expected one of {known}')
    if COMPLIANCE in kinds and links is None:
        raise DataError('joint error compliance: the masses of the links are not given (--links)')
    if SCALE in kinds and arm is not None and not slides:
        raise DataError(f'joint error scale: no joint of {arm.name} slides')
    return kinds


def table_with(
    table: ParameterTable,
    arm: Arm,
    joints: Array,
    kinds: tuple[str, ...],
    links: Links | None,
) -> ParameterTable:
    """The table with the columns of some kinds; what postures `joints` (N, n) do not tell, torques
    that are not felt and rails that stand, is held at zero."""
    terms = JointTerms(
        ENCODER_HARMONICS if ENCODER in kinds else 0,
        links if COMPLIANCE in kinds else None,
        SCALE in kinds,
    )
    wider = table.with_joint_terms(terms)
    if terms.links is not None:
        torque = np.abs(terms.basis(arm, joints)[:, -1]).max(axis=0)
        for joint in np.flatnonzero(torque < LEAST_TORQUE) + 1:
            name = f'compliance_{joint}'
            reason = f'{name}: gravity does not turn joint {joint}'
            wider = wider.frozen_at([wider.column(name)], reason)
    if terms.scale:
        travel = np.ptp(terms.basis(arm, joints)[:, 2 * terms.harmonics], axis=0)
        for joint in np.flatnonzero(travel < LEAST_TRAVEL) + 1:
            name = f'scale_{joint}'
            does = 'stands still' if arm.prismatic[joint - 1] else 'does not slide'
            reason = f'{name}: joint {joint} {does}'
            wider = wider.frozen_at([wider.column(name)], reason)
    for joint in np.flatnonzero(arm.prismatic) + 1 if terms.harmonics else ():
        reason = f'joint {joint} slides: it has no angle'
        wider = wider.frozen_at(wider.matching(f'{ENCODER}_*_{joint}'), reason)
    return wider


def choose_joint_errors(folds: Folds, solver: Solver, fit: Fit) -> JointErrorChoice:
    """Add the kinds that are offered one by one, the best first, while locations left out get
    better by it.

    `folds` are those of the problem; `fit` is the solver's minimum without joint errors; D-H
    parameters and mount are fitted anew with each.
    """
    problem, options = folds.problem, solver.options
    kinds = checked_kinds(options.joint_errors, options.links, problem.measured.arm)
    asked = options.joint_errors != (AUTO,)
    count = len(problem.locations)
    if count < FEWEST_LOCATIONS:
        few = f'{count} locations, expected {FEWEST_LOCATIONS} to judge them by'
        return JointErrorChoice(kinds, (), 0, few, asked)
    wider = replace(
        solver,
        table=table_with(solver.table, problem.measured.arm, problem.joints, kinds, options.links),
    )
    full = wider.table.nominal.copy()
    full[solver.table.free_columns] += fit.x
    about, information = wider.offsets(full), wider.information
    judge = LeaveOneOut(folds, wider.sums(problem, about), solver.options.objective, fit.kappa)
    return chosen_by(
        wider.table,
        kinds,
        lambda columns: judge.scores(columns, information, about).mean_square,
        len(judge.folds),
        asked,
    )


def chosen_by(
    table: ParameterTable,
    kinds: tuple[str, ...],
    left_out: Callable[[IntArray], Array],
    folds: int,
    asked: bool,
) -> JointErrorChoice:
    """Kinds added one by one, the best first, while `left_out` gets better: the mean squares (K,),
    m^2, of K `folds` left out of fits of some of the table's free columns."""
    columns = {kind: _columns(table, kind) for kind in ('', *kinds)}
    taken = columns['']
    scores = left_out(taken)
    tried: list[Tried] = []
    left = list(kinds)
    while left:
        found = {kind: left_out(np.union1d(taken, columns[kind])) for kind in left}
        gains = {kind: Gain.of(found[kind], scores) for kind in left}
        best = min(left, key=lambda kind: gains[kind].change)
        if not gains[best].convinces:
            tried += [Tried(kind, gains[kind], False) for kind in left]
            break
        tried.append(Tried(best, gains[best], True))
        taken, scores = np.union1d(taken, columns[best]), found[best]
        left.remove(best)
    return JointErrorChoice(kinds, tuple(tried), folds, asked=asked)


def _columns(table: ParameterTable, kind: str) -> IntArray:
    """Places of a kind of joint error among the free columns; '' are all that is none."""
    found = [
        i
        for i, parameter in enumerate(table.free)
        if parameter.kind == kind or (not kind and parameter.kind not in KINDS)
    ]
    return np.array(found, dtype=np.int64)
