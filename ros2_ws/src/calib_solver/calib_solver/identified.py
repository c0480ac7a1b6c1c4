# SPDX-License-Identifier: Apache-2.0
"""What an identification found: parameters before and after, and what is said of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm, Gauge, PassiveProbe, Probe
from calib_model.kinematics import Correction, ParameterTable
from calib_solver.error_models import CorrectionChoice, JointErrorChoice
from calib_solver.faults import Rejected, mirroring_joints, named_joints
from calib_solver.fitting import (
    ErrorShares,
    Fit,
    Observability,
    Options,
    ParameterEstimate,
    ProbeFit,
    Solver,
    Uncertainty,
    Workspace,
    error_shares,
    estimates_of,
    over_workspace,
    problem_at,
)
from calib_solver.left_out import LeftOut
from calib_solver.problem import Problem, accumulate
from calib_solver.quality import Quality


@dataclass(frozen=True)
class Identification:
    """A solved calibration: parameters before and after, their fit, and the quality of both.

    `problem` holds the poses that were used; `full` are all columns of `table`; `least_noise`
    (m^2) is what a residual's mean square was held to be at least. `arm` and `probe` are the D-H
    model alone; `model` is what else was identified with it, `choice_12` what came of eq. 12, and
    `corrected` the quality with that where it was accepted.
    """

    problem: Problem
    options: Options
    table: ParameterTable
    full: Array
    arm: Arm
    probe: Probe
    fit: Fit
    observability: Observability
    uncertainty: Uncertainty
    probe_fit: ProbeFit | None
    initial: Quality
    identified: Quality
    rejected: tuple[Rejected, ...]
    seconds: float
    warnings: tuple[str, ...]
    least_noise: float = 0.0
    joint_error_choice: JointErrorChoice | None = None
    left_out: LeftOut | None = None
    choice_12: CorrectionChoice | None = None
    corrected: Quality | None = None

    @cached_property
    def estimates(self) -> tuple[ParameterEstimate, ...]:
        """What is said of every parameter in use, in the table's order."""
        return estimates_of(
            self.table, self.full, self.observability, self.uncertainty, self.options.prior
        )

    @property
    def place_shares(self) -> None:
        """Targets and stations are of measured points alone."""
        return None

    @property
    def gauge(self) -> Gauge:
        """What was probed, as long as it was taken to be."""
        return self.problem.measured.gauge

    @cached_property
    def error_shares(self) -> ErrorShares:
        """Where the error of the free parameters comes from."""
        solver = Solver(self.table, self.options, accumulate)
        return error_shares(self.problem, solver, self.fit, self.uncertainty.misfit)

    @cached_property
    def workspace(self) -> Workspace:
        """Postures all over the workspace, and how the probed point goes with the parameters."""
        return over_workspace(self.problem, self.table, self.full)

    @cached_property
    def position_uncertainty(self) -> Array:
        """Standard uncertainty (K,), m, of positions over the workspace, with eq. 12's share."""
        workspace = self.workspace
        sure = workspace.uncertainty(self.uncertainty.covariance)
        beyond = self.choice_12.coefficients if self.choice_12 is not None else None
        if beyond is None:
            return sure
        there = problem_at(self.problem, workspace.joints)
        return np.sqrt(sure**2 + beyond.variance(there, self.table, self.full))

    @cached_property
    def untold(self) -> tuple[str, ...]:
        """What no pose of this kind can tell, whatever the parameters."""
        measured = self.problem.measured
        if not isinstance(measured.probe, PassiveProbe):
            return ()  # its styli are not their own mirror image
        mirroring = mirroring_joints(measured.arm)
        if not mirroring:
            return ()
        return (
            f'whether {named_joints(measured.arm, mirroring)} are counted the other way: the arm '
            'in a mirror fits the gauge as well; a sphere that is known to be on one side of the '
            'arm would tell',
        )

    @property
    def model(self) -> Correction | None:
        """The joint errors identified together with `arm` and `probe`: part of the fit."""
        return Correction.identified(self.arm.joint_names, self.table.joint_errors(self.full))

    @property
    def correction(self) -> Correction | None:
        """All that is corrected beyond the D-H parameters: `model`, and eq. 12 if accepted."""
        chosen = self.choice_12.correction if self.choice_12 is not None else None
        return chosen if chosen is not None else self.model
