# SPDX-License-Identifier: Apache-2.0
"""Arm, probe and gauge, and what is plausible of them."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_model.instruments.arm import (
        CLASSIC as CLASSIC,
        CONVENTIONS as CONVENTIONS,
        JOINT_PARAMETERS as JOINT_PARAMETERS,
        JOINT_TYPES as JOINT_TYPES,
        MODIFIED as MODIFIED,
        PRISMATIC as PRISMATIC,
        REVOLUTE as REVOLUTE,
        Arm as Arm,
        ControllerAxis as ControllerAxis,
        Coupling as Coupling,
        Joint as Joint,
        NDArrayBool as NDArrayBool,
    )
    from calib_model.instruments.gauge import (
        Expansion as Expansion,
        Gauge as Gauge,
        Scale as Scale,
    )
    from calib_model.instruments.plausibility import (
        WHOLE_ROOM as WHOLE_ROOM,
        refuse_impossible as refuse_impossible,
        refuse_misfit as refuse_misfit,
        seat_displacement as seat_displacement,
    )
    from calib_model.instruments.posture_noise import (
        InTurn as InTurn,
        Normal as Normal,
        PostureNoise as PostureNoise,
    )
    from calib_model.instruments.probe import (
        STYLI as STYLI,
        ActiveProbe as ActiveProbe,
        PassiveProbe as PassiveProbe,
        Probe as Probe,
        Stylus as Stylus,
        known_centers as known_centers,
        trihedron as trihedron,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
