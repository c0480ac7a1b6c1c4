# SPDX-License-Identifier: Apache-2.0
"""What of the streams a session gets to see: nothing that no stylus makes, and nothing at all once
the first seconds speak against it."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable

import numpy as np

from calib_capture.checking import FirstSeconds
from calib_capture.measuring import RunError, Tally
from calib_capture.recording.hand_guided_session import HandGuidedSession
from calib_capture.recording.program_session import ProgramSession
from calib_capture.recording.single_publisher import Origin
from calib_capture.recording.taking_session import TakingSession
from calib_model.instruments import ActiveProbe, Probe
from calib_model.pairing import JointSample, Reading
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS

#: a reading so many strokes long is no metres, and so many on end are no disturbance
MANY_STROKES, ODD_READINGS = 20.0, 10
Session = ProgramSession | HandGuidedSession | TakingSession


class Admission:
    """Hands messages on to a `session`, and tells `fail` what the capture has to end for.

    `left_out` counts readings that no stylus makes; a hand-guided arm's record is whole, and has
    them too.
    """

    def __init__(
        self,
        session: Session,
        probe: Probe,
        fail: Callable[[RunError], None],
        first: FirstSeconds | None = None,
    ) -> None:
        self._session, self._first, self._fail = session, first, fail
        self._whole = not isinstance(session, ProgramSession)
        self._stroke: float | None = None  # m, the longest
        if isinstance(probe, ActiveProbe):
            self._stroke = float(np.abs(probe.stroke).max())
        self._odd = 0  # readings on end
        self.left_out = 0

    def take(self, message: JointSample | Reading, raw: bytes, origin: Origin) -> None:
        """One message that came from `origin`; `raw` are its CDR bytes."""
        of_arm = isinstance(message, JointSample)
        if origin is not Origin.ONE:
            if self._first is not None:
                self._first.start_over()
            self._session.start_over(JOINT_STATES if of_arm else PROBE_DISPLACEMENTS)
        elif isinstance(message, JointSample):
            if not self._objects(message):
                self._session.take_joints(message, raw)
        elif self._possible(message) and not self._objects(message):
            self._session.take_reading(message, raw)

    def _objects(self, message: JointSample | Reading) -> bool:
        """Whether what was heard first speaks against all that is to come."""
        if self._first is None:
            return False
        self._first.see(message, time.monotonic())
        tally = self._session.tally
        tried_again = tally.tried_again if isinstance(tally, Tally) else Counter[str]()
        self._first.refused(tally.taken, tally.refused, tried_again)
        objection = self._first.objection
        if objection:
            self._fail(RunError(objection))
        if objection or (tally.taken and self._first.over):
            self._first = None
        return bool(objection)

    def _possible(self, reading: Reading) -> bool:
        """Whether a stylus can have made it: no pose is taken of what is many strokes long, and
        where reading upon reading is, of a driver in mm, say, the run ends."""
        if self._stroke is None:
            return True
        size = max(map(abs, reading.displacement))
        if size <= MANY_STROKES * self._stroke:
            self._odd = 0
            return True
        self._odd += 1
        self.left_out += not self._whole
        if self._odd == ODD_READINGS:
            self._fail(
                RunError(
                    f'readings of {size:g} m on {PROBE_DISPLACEMENTS.name}, where a stylus moves '
                    f'by {self._stroke:g} m at most: is its driver in mm?'
                )
            )
        return self._whole
