# SPDX-License-Identifier: Apache-2.0
"""What an identification starts from: poses without gross errors, a start, and what was seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib_model.errors import DataError
from calib_model.measurement import Measurement
from calib_solver.error_models import checked_choice, checked_kinds
from calib_solver.faults import (
    Rejected,
    refuse_other_units,
    set_apart,
    stuck_stretches,
    without_gross_errors,
)
from calib_solver.fitting import (
    AUTO,
    LEADING,
    LOSSES,
    Descent,
    Options,
    ProbeFit,
    Solver,
    try_probe_fit,
)
from calib_solver.problem import Problem
from calib_solver.quality import Quality, assess


@dataclass(frozen=True)
class Prepared:
    """Poses to solve for, without the `rejected`, where to start, and what there is to say."""

    problem: Problem
    initial: Quality
    solver: Solver
    descent: Descent
    rejected: tuple[Rejected, ...]
    mount: ProbeFit | None
    warnings: tuple[str, ...]
    stuck_throughout: bool


def checked_options(options: Options) -> Options:
    """The options, if there are such."""
    checked_choice(options.correction)
    checked_kinds(options.joint_errors, options.links)
    # eq. 13 alone has too few terms to tell joint errors unless somebody knows better
    unasked = options.joint_errors == (AUTO,)
    if options.quick or (unasked and options.objective == 'distance'):
        options = replace(options, joint_errors=())
    if options.loss not in LOSSES:
        raise DataError(f'no loss {options.loss!r}: expected one of {", ".join(LOSSES)}')
    return options


def prepare(measured: Measurement, solver: Solver) -> Prepared:
    """Gross errors left out where the loss is to reject them, and the descent led to the rest.

    Eq. 11 looks at distances and poses alike: whatever the objective, it judges the poses.
    """
    problem = Problem.of(measured)
    solver.refuse_too_little(problem)
    initial = assess(problem, measured.arm, measured.probe)
    refuse_other_units(problem, initial.spheres.center)
    stretches = stuck_stretches(measured)
    stuck_throughout = bool(stretches) and not set_apart(problem, stretches).any()
    mount = try_probe_fit(problem)
    leader = solver
    if solver.options.objective != LEADING:
        leader = replace(solver, options=replace(solver.options, objective=LEADING))
    descent = leader.start(problem, mount)
    rejected: tuple[Rejected, ...] = ()
    if solver.options.loss == 'rejecting':
        cleaned = without_gross_errors(problem, initial, stretches, leader, descent)
        descent, rejected = cleaned.descent, cleaned.rejected
        warnings = cleaned.warnings
        if cleaned.problem is not problem:
            problem = cleaned.problem
            solver.refuse_too_little(problem)
            initial = assess(problem, measured.arm, measured.probe)
    else:
        warnings = tuple(one.line(len(measured.poses)) for one in stretches)
    if leader is not solver:
        solver, descent = solver.behind(leader, problem, descent)
    return Prepared(problem, initial, solver, descent, rejected, mount, warnings, stuck_throughout)
