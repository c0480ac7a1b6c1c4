# SPDX-License-Identifier: Apache-2.0
"""One capture from waiting to closed bag, for the command and for the action alike."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rclpy.executors import Executor

from calib_capture.measuring import RunError, SourceError, Tally
from calib_capture.nodes.capture.graph import TICK, CaptureNode
from calib_capture.nodes.capture.run_display import RunDisplay
from calib_capture.recording import Begun, HandGuidedTally, Session, TakenTally, begun
from calib_model.errors import BagError

REMINDER = 3.0  # s between two lines that say what is being waited for


@dataclass(frozen=True)
class Watcher:
    """Who asked for the capture: hears lines and progress, and may want it to stop."""

    say: Callable[[str], None]
    show: Callable[[Session], None]
    stopped: Callable[[], bool]


class Stopped(Exception):  # not an error: what was wished for
    """The capture was stopped; its argument is the summary."""


class Unfinished(Exception):  # not an error: it ran to its end
    """A location has fewer poses than were planned for it; the argument is the summary."""


class CaptureRun(ABC):
    """Waits for the descriptions and captures; `tally` says how it went, also after an error."""

    def __init__(
        self, node: CaptureNode, executor: Executor, watcher: Watcher, showing: RunDisplay
    ) -> None:
        self._node = node
        self._executor = executor
        self._watcher = watcher
        self._showing = showing
        self.tally: Tally | HandGuidedTally | TakenTally = Tally(0)
        self._told = 0.0

    def __call__(self) -> str:
        """Do it; returns the summary.

        Raises:
            Stopped: the watcher wanted it so. The arm was told to stop and the bag is closed.
            Unfinished: a location could not be finished. The bag is closed.
            CalibrationError: it could not be done; a bag that was begun is closed.
        """
        node = self._node
        if Path(node.asked.output).exists() and not node.asked.resume:
            raise BagError(f'{node.asked.output}: exists already, a bag is never overwritten')
        self._wait_for(node.descriptions.missing)
        return self._captured()

    @abstractmethod
    def _captured(self) -> str:
        """What comes of it once arm, probe and gauge can be described; the summary."""

    def _spin(self, until: Callable[[], bool] = lambda: False) -> None:
        """Let messages in for a tick, or until something is so after one of them."""
        now = time.monotonic()
        end = now + TICK
        while now < end and not until():
            self._executor.spin_once(timeout_sec=end - now)
            now = time.monotonic()

    def _wait_for(self, missing: Callable[[], str]) -> None:
        """Spin until nothing is missing."""
        begin = told = time.monotonic()
        while what := missing():
            self._node.refuse_strangers()
            now = time.monotonic()
            if self._watcher.stopped():
                raise Stopped('nothing recorded')
            if now - begin > self._node.asked.wait_timeout:
                raise RunError(f'waited {now - begin:.0f} s in vain for {what}')
            if now - told > REMINDER:
                told = now
                self._watcher.say(f'waiting for {what}')
            self._spin()
        self._node.refuse_strangers()

    def _remind(self) -> None:
        """Say now and then which stream has gone silent."""
        now = time.monotonic()
        if now - self._told > REMINDER and (what := self._node.streams.silent()):
            self._told = now
            self._watcher.say(f'waiting for {what}')

    def _there(self) -> Begun:
        """What the bag has that is to be gone on with."""
        node = self._node
        if not Path(node.asked.output).exists():
            return Begun((), None)
        with node.asked.confined():
            there = begun(node.asked.output, node.arm, node.probe, node.gauge)
        for line in there.mended:
            self._watcher.say(line)
        if there.taken:
            self._watcher.say(f'{node.asked.output}: {there.taken} poses are there already')
        return there

    def _summary(self, there: Begun, stopped: bool, seconds: float, remarks: str) -> str:
        output, failure = self._node.asked.output, self._node.failure
        whole = f', {there.taken + self.tally.taken} in all' if there.taken else ''
        remarks = ''.join(f'; {remark}' for remark in (self._node.lost(), remarks) if remark)
        summary = f'{output}: {self.tally.line()} in {seconds:.1f} s{whole}{remarks}'
        if stopped:
            raise Stopped(summary)
        if failure:
            silent = '' if isinstance(failure, SourceError) else self._node.streams.silent()
            raise RunError(f'{output}: {failure}' + (f'; waited for {silent}' if silent else ''))
        if not self.tally.taken + there.taken:
            raise RunError(f'{output}: no pose was taken: {self.tally.line()}{remarks}')
        return summary
