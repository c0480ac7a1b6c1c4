# SPDX-License-Identifier: Apache-2.0
"""Eq. 15, the objectives, Levenberg-Marquardt, prior, observability, uncertainty."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_solver.fitting.error_sources import (
        ErrorShares as ErrorShares,
        PoseNoise as PoseNoise,
        error_shares as error_shares,
        positions_moved as positions_moved,
        variances_of as variances_of,
    )
    from calib_solver.fitting.levenberg_marquardt import (
        Fit as Fit,
        linear_step as linear_step,
        minimise as minimise,
    )
    from calib_solver.fitting.minimiser import (
        Descent as Descent,
        Minimiser as Minimiser,
    )
    from calib_solver.fitting.objectives import (
        OBJECTIVES as OBJECTIVES,
        Objective as Objective,
        Quadratic as Quadratic,
        apart as apart,
        distance_errors as distance_errors,
        distance_repeatability as distance_repeatability,
        fit_placement as fit_placement,
        objective as objective,
        repeatability as repeatability,
        repeatability_weights as repeatability_weights,
    )
    from calib_solver.fitting.observability import (
        Observability as Observability,
        ParameterEstimate as ParameterEstimate,
        estimates_of as estimates_of,
        observe as observe,
        quantity as quantity,
    )
    from calib_solver.fitting.options import (
        AUTO as AUTO,
        LEADING as LEADING,
        LOSSES as LOSSES,
        Options as Options,
    )
    from calib_solver.fitting.pose_noise import (
        ASSUMED_NOISE as ASSUMED_NOISE,
        full_inverse as full_inverse,
    )
    from calib_solver.fitting.prior import (
        DEFAULT_PRIOR as DEFAULT_PRIOR,
        NO_PRIOR as NO_PRIOR,
        USUAL_PRIOR as USUAL_PRIOR,
        Prior as Prior,
        chosen_prior as chosen_prior,
        parse_prior as parse_prior,
    )
    from calib_solver.fitting.probe_mount import (
        ProbeFit as ProbeFit,
        fit_probe as fit_probe,
        with_the_arms_share as with_the_arms_share,
    )
    from calib_solver.fitting.solver import (
        Accumulate as Accumulate,
        Solver as Solver,
        try_probe_fit as try_probe_fit,
    )
    from calib_solver.fitting.uncertainty import (
        Uncertainty as Uncertainty,
        certificate_covariance as certificate_covariance,
        certified_root as certified_root,
        covariance_of as covariance_of,
        estimate_uncertainty as estimate_uncertainty,
        prior_width as prior_width,
    )
    from calib_solver.fitting.workspace import (
        Workspace as Workspace,
        drawn_postures as drawn_postures,
        over_workspace as over_workspace,
        problem_at as problem_at,
        workspace_at as workspace_at,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
