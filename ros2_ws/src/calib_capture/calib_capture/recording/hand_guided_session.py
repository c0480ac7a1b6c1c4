# SPDX-License-Identifier: Apache-2.0
"""One capture of a hand-guided arm, from streams to bag. Commands nothing."""

from __future__ import annotations

from collections.abc import Callable

from calib_capture.recording.hand_guided_record import (
    CLOCK_NOTE,
    HandGuidedRecord,
    apart,
    clock_content,
    clock_line,
)
from calib_capture.recording.hand_guided_run import HandGuidedRun, HandGuidedTally
from calib_capture.recording.program_session import BACK
from calib_capture.recording.recorder import Recorder
from calib_capture.recording.taking_session import PoseTaker, TakenByHand
from calib_model.bags import cdr
from calib_model.pairing import (
    BRIDGED,
    HAND_GUIDED_NOTE,
    UNSURE,
    ClockEstimate,
    HandGuidedPairing,
    JointSample,
    PairedReading,
    Reading,
)
from calib_model.stamps import SECOND
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS, Topic

SAVE_WITHIN = 0.2  # s: accepted poses that come closer together share a flush
ENOUGH = 24  # stretches of contact, and a standard uncertainty of
WELL_KNOWN = 1e-4  # s: then readings are corrected
LOOK = 1.0  # s between two looks at the offset while it is waited for


class HandGuidedSession:
    """Feeds both streams to the pairing, the clock's estimate and the bag.

    With `correct` all pairing waits until the offset between the clocks is known; the raw streams
    are recorded meanwhile. `note` says how to pair, `clock` gives seconds, `wall` ns for the bag.
    It has finished after `silence` s without a message. Where there is a `taker`, poses can be
    taken by hand besides.
    """

    def __init__(
        self,
        run: HandGuidedRun,
        estimate: ClockEstimate,
        recorder: Recorder,
        note: HandGuidedRecord,
        frame: str,
        clock: Callable[[], float],
        wall: Callable[[], int],
        silence: float,
        correct: bool = False,
        taker: PoseTaker | None = None,
    ) -> None:
        self.run = run
        self.taker = taker
        self.recorder = recorder
        self.shift = note.shift
        self._estimate = estimate
        self._note, self._frame = note, frame
        self._clock, self._wall, self._silence = clock, wall, silence
        self._pairing: HandGuidedPairing | None = None
        self._held: list[JointSample | Reading] = []
        self._paired: list[PairedReading] = []
        self._saved = self._heard = self._looked = clock()
        self._newest = [0, 0]
        self._clock_line = ''
        if not correct or note.shift:
            self._pair_with(note.shift)

    @property
    def finished(self) -> bool:
        """Whether both streams have ended."""
        return self._clock() - self._heard > self._silence

    @property
    def tally(self) -> HandGuidedTally:
        """How it is going."""
        return self.run.tally

    @property
    def poses(self) -> list[TakenByHand]:
        """All poses so far, along the way and by hand."""
        along = [
            ((each.location, each.sphere), each.joints, each.displacement)
            for each in self.run.taken
        ]
        return along if self.taker is None else along + self.taker.poses

    def take_joints(self, sample: JointSample, raw: bytes) -> None:
        """A joint state has come; `raw` are its CDR bytes."""
        self.recorder.raw(JOINT_STATES, raw, self._wall())
        self._estimate.see_joints(sample)
        self._newest[0] = sample.stamp
        if self.taker is not None:
            self.taker.see(sample)
        self._take(sample)

    def take_reading(self, reading: Reading, raw: bytes) -> None:
        """A probe reading has come; `raw` are its CDR bytes."""
        self.recorder.raw(PROBE_DISPLACEMENTS, raw, self._wall())
        self._estimate.see_reading(reading)
        self._newest[1] = reading.stamp
        self._take(reading)

    def start_over(self, topic: Topic) -> None:
        """A message has come that may be of another arm or probe than the bag's: it is left out of
        the bag, too, so that nobody pairs it later."""
        self._heard = self._clock()
        if self.taker is not None:
            self.taker.forget()
        if self._pairing is not None:
            self._paired += self._pairing.start_over()
        self._choose()
        self.run.start_over()
        if topic is PROBE_DISPLACEMENTS:
            self.run.tally.refused[UNSURE] += 1

    def tick(self) -> None:
        """Do what is due without a message: correct, take poses, save."""
        now = self._clock()
        if self._pairing is None and now - self._looked > LOOK:
            self._looked = now
            found = self._estimate.estimate() if self._estimate.chunks >= ENOUGH else None
            if found is not None and found.standard_uncertainty <= WELL_KNOWN:
                self._pair_with(round(found.seconds * SECOND))
        self._choose()
        if now - self._saved > SAVE_WITHIN:
            self.recorder.commit()
            self._saved = now

    def finish(self) -> None:
        """Settle what is there; no more messages are coming."""
        if self._pairing is None:
            self._pair_with(0)
        assert self._pairing is not None
        self._paired += self._pairing.finish()
        self._choose()
        if self.taker is not None:
            self.tally.by_hand = self.taker.tally.taken
        self._estimate.finish()
        found = self._estimate.estimate()
        self.recorder.note(CLOCK_NOTE, clock_content(found, self.shift))
        self._clock_line = clock_line(found, self.shift)
        self.recorder.commit()

    def remarks(self) -> str:
        """What there is to say at the end, beside the counts."""
        late = self._pairing.late_joints if self._pairing is not None else 0
        back = self._pairing.steps_back if self._pairing is not None else 0
        bridged = self._pairing.bridged if self._pairing is not None else 0
        taken = self.taker.tally if self.taker is not None else None
        by_hand = [taken.line()] if taken is not None and (taken.taken or taken.undone) else []
        parts = [f'{late} joint states out of order'] if late else []
        parts += [BACK.format(back)] if back else []
        parts += [BRIDGED.format(bridged)] if bridged else []
        return '; '.join([*by_hand, *parts, self._clock_line]) + apart(*self._newest)

    def _pair_with(self, shift: int) -> None:
        """Pair from now on, and what was held back, with readings `shift` ns later."""
        self.shift = shift
        self._pairing = HandGuidedPairing(self._note.settings, shift)
        note = self._note
        as_paired = HandGuidedRecord(note.settings, note.placements, note.spheres, shift)
        self.recorder.note(HAND_GUIDED_NOTE, as_paired.content())
        held, self._held = self._held, []
        for message in held:
            self._take(message)

    def _take(self, message: JointSample | Reading) -> None:
        self._heard = self._clock()
        if self._pairing is None:
            self._held.append(message)
        elif isinstance(message, Reading):
            self._paired += self._pairing.add_reading(message)
        else:
            self._paired += self._pairing.add_joints(message)

    def _choose(self) -> None:
        paired, self._paired = self._paired, []
        for pose in self.run.take(paired):
            message = cdr.probing_pose(
                pose.stamp,
                self._frame,
                pose.location,
                pose.sphere,
                pose.joints,
                pose.displacement,
                1,
            )
            self.recorder.pose(cdr.encode(message), self._wall())
