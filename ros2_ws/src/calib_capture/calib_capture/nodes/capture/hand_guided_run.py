# SPDX-License-Identifier: Apache-2.0
"""A capture of an arm that is led by hand; being stopped is the usual end of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from calib_capture.measuring import RunError
from calib_capture.nodes.capture.interventions import Keys
from calib_capture.nodes.capture.run import CaptureRun, Stopped
from calib_capture.recording import HandGuidedRecord, HandGuidedSession, TakingSession
from calib_model.bags import read_note
from calib_model.instruments import PassiveProbe
from calib_model.pairing import HAND_GUIDED_NOTE

READINGS_WITHIN = 2.0  # s after joint states in which somebody may yet tell of a passive probe


class HandGuidedRun(CaptureRun):
    """Takes poses along the way; those of a passive probe that nobody tells of, when asked to."""

    def _captured(self) -> str:
        self._node.describe()
        if isinstance(self._node.probe, PassiveProbe) and self._without_readings():
            return self._taking()
        return self._along_the_way()

    def _along_the_way(self) -> str:
        node, begin = self._node, time.monotonic()
        self._showing.places()
        there, noted = self._there(), self._noted()
        planned = node.asked.program.poses_per_sphere
        self._showing.begin_hand_guided(
            {(place, sphere): planned for place in noted.placements for sphere in noted.spheres},
            there.poses,
        )
        node.listen()
        self._wait_for(node.missing_streams)
        session = node.begin_hand_guided(there.files, noted)
        self._until_over(session, lambda: False)
        return self._summary(there, False, time.monotonic() - begin, session.remarks())

    def _taking(self) -> str:
        """Take poses of a seated ball when asked to."""
        node, begin = self._node, time.monotonic()
        there = self._there()
        self._showing.begin_hand_guided({}, there.poses)
        session = node.begin_taking(there.files)
        self._watcher.say(f'{node.probe.name} gives no readings: /capture/take takes a pose')
        keys = Keys(self._watcher.say)
        self._until_over(session, lambda: keys.act(session))
        return self._summary(there, False, time.monotonic() - begin, session.remarks())

    def _until_over(
        self, session: HandGuidedSession | TakingSession, ended: Callable[[], bool]
    ) -> None:
        """Capture until the streams end, it fails or is stopped, or has `ended`."""
        node = self._node
        self.tally = session.tally
        try:
            with session.recorder:
                while not (session.finished or node.failure or self._watcher.stopped()):
                    self._spin()
                    self._remind()
                    self._watcher.show(session)
                    self._showing.hand_guided(session)
                    if ended():
                        break
                session.finish()
        finally:
            node.end()
        self._showing.hand_guided(session, last=True)

    def _without_readings(self) -> bool:
        """Whether nobody tells of a passive probe, after a while in which somebody might."""
        self._node.listen()
        self._wait_for(self._node.streams.missing_joints)
        until = time.monotonic() + READINGS_WITHIN
        while self._node.without_readings():
            if self._watcher.stopped():
                raise Stopped('nothing recorded')
            if time.monotonic() > until:
                return True
            self._spin()
        return False

    def _noted(self) -> HandGuidedRecord:
        """What a hand-guided capture is asked for, or what its bag was begun with."""
        asked, output = self._node.asked, self._node.asked.output
        if Path(output).exists():
            with asked.confined():
                earlier = HandGuidedRecord.read(read_note(output, HAND_GUIDED_NOTE), output)
            if earlier is not None:
                return earlier
        self._node.refuse_assumed_places()
        placements = self._node.placements
        for number in asked.locations:
            if number not in placements:
                known = ', '.join(map(str, sorted(placements)))
                raise RunError(f'location {number} has no place (known: {known})')
        chosen = {number: placements[number] for number in asked.locations or sorted(placements)}
        return HandGuidedRecord(
            asked.moving, chosen, asked.program.spheres or self._node.gauge.spread()
        )
