# SPDX-License-Identifier: Apache-2.0
"""What an identification by measured points has found: parameters, targets and stations that
account for themselves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm, PassiveProbe
from calib_model.kinematics import Correction, ParameterTable
from calib_model.transforms import RigidTransform, left_jacobian
from calib_solver.error_models import CorrectionChoice, JointErrorChoice
from calib_solver.fitting import (
    ASSUMED_NOISE,
    ErrorShares,
    Fit,
    Observability,
    Options,
    ParameterEstimate,
    Uncertainty,
    Workspace,
    covariance_of,
    drawn_postures,
    estimates_of,
    prior_width,
)
from calib_solver.left_out import LeftOut
from calib_solver.points.gross_errors import RejectedPoint
from calib_solver.points.place_shares import PlaceShares
from calib_solver.points.places import Places
from calib_solver.points.point_noise import PointNoise, gradient_covariance, point_noise
from calib_solver.points.point_sums import PointSums
from calib_solver.points.problem import FLANGE, PointProblem
from calib_solver.points.quality import (
    PointQuality,
)
from calib_solver.points.solver import PointSolver
from calib_solver.problem import posture_jacobian


@dataclass(frozen=True)
class Placed:
    """A target on the flange or a station: `name`, `points` it has, its `transform`, and the
    standard uncertainty of its translation (3,), m, and rotation vector (3,), rad, the latter None
    where its rotation is not known."""

    name: str
    points: int
    transform: RigidTransform
    translation_uncertainty: Array
    rotation_uncertainty: Array | None


@dataclass(frozen=True)
class PointIdentification:
    """A solved calibration by points: as `Identification`, of targets and stations besides.

    `sums` are those of all points there, without the prior's share. `initial` and
    `identified` are the quality before and after, `choice_12` is what came of eq. 12 and
    `corrected` the quality with that where it was accepted.
    """

    problem: PointProblem
    options: Options
    table: ParameterTable
    full: Array
    arm: Arm
    fit: Fit
    observability: Observability
    sums: PointSums
    initial: PointQuality
    identified: PointQuality
    rejected: tuple[RejectedPoint, ...]
    seconds: float
    warnings: tuple[str, ...]
    joint_error_choice: JointErrorChoice | None = None
    left_out: LeftOut | None = None
    choice_12: CorrectionChoice | None = None
    corrected: PointQuality | None = None

    @property
    def places(self) -> Places:
        """Targets and stations as identified."""
        return self.identified.places

    @property
    def _assumed(self) -> bool:
        return self.fit.quadratic.terms - len(self.fit.x) < 1

    @property
    def _variance(self) -> float:
        """Of a position's coordinate on average, m^2."""
        return ASSUMED_NOISE**2 if self._assumed else self.fit.kappa

    @property
    def turn_noise(self) -> float | None:
        """A rotation's standard deviation, rad, None where there are none."""
        if not self.problem.has_orientation:
            return None
        return float(np.sqrt(self._variance / self.problem.turn_weight))

    @cached_property
    def covariance(self) -> Array:
        """Of the free parameters and of all places' small motions (F + P, F + P), by what makes the
        points scatter, enlarged where points left out were missed by more than that says."""
        solver, fit, problem = PointSolver(self.table, self.options), self.fit, self.problem
        none = np.zeros(problem.places)
        information = np.concatenate([solver.information, none])
        wider = solver.options.prior.strength * solver.wider(fit) ** 2
        strength = np.concatenate([wider, none + 1.0])
        scatter = self._gradient + np.diag(fit.kappa**2 * information * strength)
        held = self.sums.weighed(problem.turn_weight).normal + np.diag(fit.kappa * information)
        covariance = covariance_of(scatter, held, information, strength)
        return covariance * (self.left_out.factor**2 if self.left_out is not None else 1.0)

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """Of the free parameters."""
        free = len(self.fit.x)
        noise = float(np.sqrt(self._variance))
        return Uncertainty(self.covariance[:free, :free], noise, 1.0, self._assumed)

    @cached_property
    def _gradient(self) -> Array:
        given = (self.problem, self.table, self.full, self.places, self.sums, self.noise)
        return gradient_covariance(*given)

    @cached_property
    def estimates(self) -> tuple[ParameterEstimate, ...]:
        """What is said of every parameter of the arm in use, in the table's order."""
        found = estimates_of(
            self.table, self.full, self.observability, self.uncertainty, self.options.prior
        )
        return tuple(one for one in found if not one.parameter.name.startswith('probe_'))

    @property
    def model(self) -> Correction | None:
        """The joint errors identified together with the arm."""
        return Correction.identified(self.arm.joint_names, self.table.joint_errors(self.full))

    @property
    def correction(self) -> Correction | None:
        """All that is corrected beyond the D-H parameters: `model`, and eq. 12 if accepted."""
        chosen = self.choice_12.correction if self.choice_12 is not None else None
        return chosen if chosen is not None else self.model

    @property
    def gauge(self) -> None:
        """Measured points have none."""
        return None

    @cached_property
    def error_shares(self) -> ErrorShares:
        """Where the error of the free parameters comes from, targets and stations at their best."""
        solver, fit = PointSolver(self.table, self.options), self.fit
        strength = solver.options.prior.strength * solver.wider(fit) ** 2
        places, free = self.place_shares, len(fit.x)
        return ErrorShares(
            places.noise[:free, :free],
            np.zeros((free, 0)),
            places.prior[:free],
            prior_width(solver.information, strength),
            self.noise.poses,
        )

    @cached_property
    def noise(self) -> PointNoise:
        """What makes the points scatter."""
        prior = self.fit.kappa * self.options.prior.information(self.table)
        return point_noise(
            self.problem,
            self.table,
            self.full,
            self.identified,
            self.sums,
            prior,
            self._variance,
        )

    @cached_property
    def place_shares(self) -> PlaceShares:
        """Where the errors of targets and stations come from."""
        weighed = self.fit.kappa * self.options.prior.information(self.table)
        problem = self.problem
        return PlaceShares.of(
            self.sums.weighed(problem.turn_weight).normal,
            weighed,
            self._gradient,
            problem.targets,
            problem.stations,
            problem.unit_sigma,
            self.noise.scatter(problem),
        )

    @property
    def probe(self) -> PassiveProbe:
        """The first target as a seat, for what takes a tool."""
        target = self.targets[0]
        return PassiveProbe(f'target {target.name}', target.transform)

    @cached_property
    def targets(self) -> tuple[Placed, ...]:
        """flange_T_target of every target."""
        problem = self.problem
        _, transforms = self.places.transforms()
        oriented = np.bincount(problem.target, problem.oriented, len(problem.targets)) > 0
        counts = np.bincount(problem.target, minlength=len(problem.targets))
        found = []
        for k, name in enumerate(problem.targets):
            own = self._of_place(k)
            turn = None
            if oriented[k]:
                by_vector = np.linalg.inv(left_jacobian(transforms[k].rotation_vector))
                turn = _standard(by_vector @ own[3:, 3:] @ by_vector.T)
            at = transforms[k] if oriented[k] else RigidTransform(transforms[k].translation)
            found.append(Placed(name, int(counts[k]), at, _standard(own[:3, :3]), turn))
        return tuple(found)

    @cached_property
    def stations(self) -> tuple[Placed, ...]:
        """T_tracker_base of every station."""
        problem = self.problem
        transforms, _ = self.places.transforms()
        counts = np.bincount(problem.station, minlength=len(problem.stations))
        found = []
        for s, number in enumerate(problem.stations):
            own = self._of_place(len(problem.targets) + s)
            turned = transforms[s].rotation
            # the base was moved and turned in itself: R exp(w) = exp(R w) R
            by_vector = np.linalg.inv(left_jacobian(transforms[s].rotation_vector)) @ turned
            moved = _standard(turned @ own[:3, :3] @ turned.T)
            turn = _standard(by_vector @ own[3:, 3:] @ by_vector.T)
            found.append(Placed(str(number), int(counts[s]), transforms[s], moved, turn))
        return tuple(found)

    @property
    def corrected_stations(self) -> tuple[tuple[int, RigidTransform], ...]:
        """T_tracker_base of every station with eq. 12's correction; none without."""
        if self.corrected is None:
            return ()
        transforms, _ = self.corrected.places.transforms()
        return tuple(zip(self.problem.stations, transforms, strict=True))

    def _of_place(self, number: int) -> Array:
        first = len(self.fit.x) + 6 * number
        return self.covariance[first : first + 6, first : first + 6]

    @cached_property
    def workspace(self) -> Workspace:
        """The first target at postures all over the workspace; `jacobian` (K, 3, F + 3) by the free
        parameters and by its place on the flange."""
        joints = drawn_postures(self.arm)
        points, slope = self._first_target(joints)
        held = slope[:, :, self.table.mount][:, :, :3]
        by_both = np.concatenate([slope[:, :, self.table.free_columns], held], axis=2)
        return Workspace(joints, points, by_both)

    @cached_property
    def position_uncertainty(self) -> Array:
        """Standard uncertainty (K,), m, of the first target over the workspace, base frame, with
        eq. 12's share."""
        size = self.workspace.jacobian.shape[2]
        sure = self.workspace.uncertainty(self.covariance[:size, :size])
        beyond = self.choice_12.coefficients if self.choice_12 is not None else None
        if beyond is None:
            return sure
        joints = self.workspace.joints
        _, slope = self._first_target(joints)
        moved = beyond.columns.moving(self.table, self.arm, joints, slope)
        return np.sqrt(sure**2 + beyond.variance_of(moved))

    def _first_target(self, joints: Array) -> tuple[Array, Array]:
        """The first target (K, 3) in postures (K, n), and how it goes with all columns."""
        centers = np.broadcast_to(self.places.target[0], (len(joints), 3))
        return posture_jacobian(self.arm, FLANGE, self.table, self.full, joints, centers)


def _standard(covariance: Array) -> Array:
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))
