# SPDX-License-Identifier: Apache-2.0
"""Inverse kinematics, collisions, free paths and timed trajectories."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_capture.motion.approach import (
        retreat as retreat,
        singular_margin as singular_margin,
    )
    from calib_capture.motion.bodies import (
        BodySettings as BodySettings,
        bodies_of as bodies_of,
        parse_bodies as parse_bodies,
    )
    from calib_capture.motion.collision import (
        CollisionCheck as CollisionCheck,
    )
    from calib_capture.motion.free_paths import (
        FreePaths as FreePaths,
    )
    from calib_capture.motion.interpolated_motion import (
        InterpolatedMotion as InterpolatedMotion,
        MotionState as MotionState,
    )
    from calib_capture.motion.inverse_kinematics import (
        InverseKinematics as InverseKinematics,
    )
    from calib_capture.motion.jerk_limited import (
        LEAD as LEAD,
        Leg as Leg,
        MotionError as MotionError,
    )
    from calib_capture.motion.limits import (
        ACCELERATION as ACCELERATION,
        JERK as JERK,
        MotionLimits as MotionLimits,
        motion_limits as motion_limits,
    )
    from calib_capture.motion.pinocchio_arm import (
        PinocchioArm as PinocchioArm,
    )
    from calib_capture.motion.stopping import (
        gentlest as gentlest,
        stop as stop,
    )
    from calib_capture.motion.strict_controller import (
        StrictController as StrictController,
    )
    from calib_capture.motion.trajectory import (
        Trajectory as Trajectory,
        TrajectoryError as TrajectoryError,
        check_trajectory as check_trajectory,
        checked_trajectory as checked_trajectory,
        travel_time as travel_time,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
