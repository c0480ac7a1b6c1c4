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
    from calib_capture.motion.inverse_kinematics import (
        InverseKinematics as InverseKinematics,
    )
    from calib_capture.motion.pinocchio_arm import (
        PinocchioArm as PinocchioArm,
    )
    from calib_capture.motion.trajectory import (
        Leg as Leg,
        Motion as Motion,
        Trajectory as Trajectory,
        TrajectoryError as TrajectoryError,
        checked_trajectory as checked_trajectory,
        travel_time as travel_time,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
