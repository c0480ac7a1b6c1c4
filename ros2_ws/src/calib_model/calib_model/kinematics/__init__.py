# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics, Jacobians, parameters and which can be identified, joint errors, eq. 12."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.kinematics.correction import (
        Attitude as Attitude,
        CorrectedArm as CorrectedArm,
        Correction as Correction,
        Shift as Shift,
    )
    from calib_model.kinematics.forward import (
        JointFrame as JointFrame,
        forward_kinematics as forward_kinematics,
        joint_frames as joint_frames,
        point_derivatives as point_derivatives,
        points as points,
        points_of_turned as points_of_turned,
    )
    from calib_model.kinematics.gravity import (
        STANDARD_GRAVITY as STANDARD_GRAVITY,
        Links as Links,
    )
    from calib_model.kinematics.identifiability import (
        NEARLY_PARALLEL as NEARLY_PARALLEL,
        identifiable_table as identifiable_table,
        parallel_joints as parallel_joints,
    )
    from calib_model.kinematics.jacobian import (
        probing_jacobian as probing_jacobian,
        tool_motion as tool_motion,
        turning_jacobian as turning_jacobian,
    )
    from calib_model.kinematics.joint_errors import (
        COMPLIANCE as COMPLIANCE,
        ENCODER as ENCODER,
        ENCODER_HARMONICS as ENCODER_HARMONICS,
        KINDS as KINDS,
        SCALE as SCALE,
        JointErrors as JointErrors,
        JointTerms as JointTerms,
        harmonic_basis as harmonic_basis,
    )
    from calib_model.kinematics.parameters import (
        DEFAULT_SIGMA as DEFAULT_SIGMA,
        LENGTHS as LENGTHS,
        PROBE_PARAMETERS as PROBE_PARAMETERS,
        Parameter as Parameter,
        ParameterTable as ParameterTable,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
