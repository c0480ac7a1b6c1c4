# SPDX-License-Identifier: Apache-2.0
"""The bag of a measuring run, written while it runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from calib_model.bags import BagWriter, FileAccount, write_descriptions
from calib_model.errors import BagError
from calib_model.files import FolderLock
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.pairing import NOTE, SteadySettings, note_of
from calib_model.topics import CAPTURE_POSES, CAPTURE_UNDONE, Topic

IN_USE = '{}: is being written by another capture'


class Recorder:
    """Writes raw topics and accepted poses; a pose is announced once it is on disk.

    `announce` gets the CDR bytes of each pose, in order, after the flush that made it safe. Poses
    that come together share a flush: `commit` is for the moment when no more are at hand.
    `settings` are those that pairing was done with. With `earlier` the bag goes on from there.
    """

    def __init__(
        self,
        path: str | Path,
        arm: Arm,
        probe: Probe,
        gauge: Gauge,
        announce: Callable[[bytes], None],
        time: int,
        settings: SteadySettings | None = None,
        earlier: Sequence[FileAccount] = (),
    ) -> None:
        self._announce = announce
        self._closed = False
        self._unsaved: list[bytes] = []
        self.path = Path(path)
        self._lock = FolderLock(self.path)
        if earlier and not self._lock.take():
            raise BagError(IN_USE.format(self.path))
        try:
            self._bag = BagWriter(self.path, earlier=earlier)
            if not earlier:
                self._lock.take()  # ours: the writer made the folder
            if settings is not None:
                self._bag.note(NOTE, note_of(settings))
            write_descriptions(self._bag, arm, probe, gauge, time)
            self._bag.flush()
        except BagError:
            self._lock.release()
            raise

    def raw(self, topic: Topic, data: bytes, time: int) -> None:
        """Record a message as it came, CDR bytes with their header, received at `time` (ns).

        Nothing after `close`: streams go on while the arm is brought to rest.
        """
        if not self._closed:
            self._bag.write(topic, data, time, time)

    def note(self, name: str, content: dict[str, str]) -> None:
        """Record what is no message: how it was paired, what was found out."""
        self._bag.note(name, content)

    def pose(self, data: bytes, time: int) -> None:
        """Record an accepted pose, to be announced with the next `commit`."""
        self._bag.write(CAPTURE_POSES, data, time, time)
        self._unsaved.append(data)

    def undone(self, data: bytes, time: int) -> None:
        """Record that a pose was taken back, and put it on disk."""
        self._bag.write(CAPTURE_UNDONE, data, time, time)
        self._bag.flush()

    def commit(self) -> None:
        """Put the poses so far on disk, then announce them."""
        if not self._unsaved or self._closed:
            return
        self._bag.flush()
        saved, self._unsaved = self._unsaved, []
        for data in saved:
            self._announce(data)

    def close(self) -> None:
        """Save what there is and finish the bag; further calls do nothing."""
        try:
            self.commit()
        finally:
            self._closed = True
            self._bag.close()
            self._lock.release()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
