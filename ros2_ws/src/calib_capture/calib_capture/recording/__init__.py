# SPDX-License-Identifier: Apache-2.0
"""A measuring run as it happens: poses taken, recorded, resumed."""

from typing import TYPE_CHECKING

from calib_model.lazy import lazily

if TYPE_CHECKING:
    from calib_capture.recording.admission import (
        Admission as Admission,
        Session as Session,
    )
    from calib_capture.recording.hand_guided_record import (
        CLOCK_NOTE as CLOCK_NOTE,
        HandGuidedRecord as HandGuidedRecord,
        clock_line as clock_line,
    )
    from calib_capture.recording.hand_guided_run import (
        HandGuidedPose as HandGuidedPose,
        HandGuidedRun as HandGuidedRun,
        HandGuidedTally as HandGuidedTally,
    )
    from calib_capture.recording.hand_guided_session import (
        HandGuidedSession as HandGuidedSession,
    )
    from calib_capture.recording.point_session import (
        PointSession as PointSession,
        TrackedPoint as TrackedPoint,
    )
    from calib_capture.recording.program_session import (
        ProgramSession as ProgramSession,
    )
    from calib_capture.recording.recorder import (
        Recorder as Recorder,
    )
    from calib_capture.recording.resume import (
        Begun as Begun,
        begun as begun,
        remaining as remaining,
    )
    from calib_capture.recording.single_publisher import (
        CLEAR as CLEAR,
        Numbered as Numbered,
        Origin as Origin,
        Publishers as Publishers,
        several as several,
    )
    from calib_capture.recording.standing_pose import (
        pose_at_rest as pose_at_rest,
    )
    from calib_capture.recording.stream_bytes import (
        JointStateReader as JointStateReader,
        read_reading as read_reading,
    )
    from calib_capture.recording.taking_session import (
        PoseTaker as PoseTaker,
        TakeError as TakeError,
        TakenTally as TakenTally,
        TakingSession as TakingSession,
    )
    from calib_capture.recording.trajectory_bytes import (
        read_trajectory_cdr as read_trajectory_cdr,
        trajectory_cdr as trajectory_cdr,
    )
else:
    __getattr__, __dir__, __all__ = lazily(__name__, __file__)
