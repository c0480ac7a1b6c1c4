# SPDX-License-Identifier: Apache-2.0
"""The measuring program: which postures, in which order, and what they tell."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_capture.program.candidates import (
        branch_names as branch_names,
        joints_of as joints_of,
    )
    from calib_capture.program.duration import (
        motion_seconds as motion_seconds,
        visit as visit,
    )
    from calib_capture.program.free_posture import (
        posture_to_begin_in as posture_to_begin_in,
    )
    from calib_capture.program.listing import (
        placed_text as placed_text,
        placed_yaml as placed_yaml,
        program_text as program_text,
        shortfall as shortfall,
    )
    from calib_capture.program.placing import (
        Placed as Placed,
        Placer as Placer,
    )
    from calib_capture.program.planner import (
        Planner as Planner,
    )
    from calib_capture.program.pose_selection import (
        Indices as Indices,
        Information as Information,
        Pool as Pool,
        choose as choose,
        information_matrix as information_matrix,
        log_det as log_det,
    )
    from calib_capture.program.program import (
        GO as GO,
        SIMULATED as SIMULATED,
        WAIT as WAIT,
        PlannedPose as PlannedPose,
        Program as Program,
        ProgramError as ProgramError,
        ProgramSettings as ProgramSettings,
        SpherePlan as SpherePlan,
    )
    from calib_capture.program.taught_spheres import (
        TaughtBook as TaughtBook,
        TaughtLocation as TaughtLocation,
        TaughtSphere as TaughtSphere,
        TeachError as TeachError,
        probed_sphere as probed_sphere,
        taught_location as taught_location,
    )
    from calib_capture.program.tour import (
        Draft as Draft,
    )
    from calib_capture.program.tracker_points import (
        TrackerProgram as TrackerProgram,
        TrackerSettings as TrackerSettings,
        postures_csv as postures_csv,
        tracker_program as tracker_program,
        tracker_text as tracker_text,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
