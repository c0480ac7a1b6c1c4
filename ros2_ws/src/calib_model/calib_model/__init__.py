# SPDX-License-Identifier: Apache-2.0
"""What is being measured: arm, probe, gauge, probing poses, and the files they are kept in."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.bags import (
        read_measurement as read_measurement,
        read_points as read_points,
        write_measurement as write_measurement,
        write_points as write_points,
    )
    from calib_model.descriptions import (
        arm_yaml as arm_yaml,
        gauge_yaml as gauge_yaml,
        parse_arm as parse_arm,
        parse_gauge as parse_gauge,
        parse_probe as parse_probe,
        probe_yaml as probe_yaml,
        read_description as read_description,
    )
    from calib_model.errors import (
        CalibrationError as CalibrationError,
    )
    from calib_model.instruments import (
        ActiveProbe as ActiveProbe,
        Arm as Arm,
        Gauge as Gauge,
        Joint as Joint,
        PassiveProbe as PassiveProbe,
        Probe as Probe,
    )
    from calib_model.kinematics import (
        Correction as Correction,
        forward_kinematics as forward_kinematics,
    )
    from calib_model.measured_points import (
        PointMeasurement as PointMeasurement,
        PointSet as PointSet,
    )
    from calib_model.measurement import (
        Measurement as Measurement,
        ProbingSet as ProbingSet,
    )
    from calib_model.transforms import (
        RigidTransform as RigidTransform,
    )
    from calib_model.urdf import (
        arm_from_urdf as arm_from_urdf,
        arm_urdf as arm_urdf,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
