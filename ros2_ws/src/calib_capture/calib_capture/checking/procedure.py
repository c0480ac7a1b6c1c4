# SPDX-License-Identifier: Apache-2.0
"""The check of a live arm and probe, from listening to the verdict."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from calib_capture.checking.contacts import in_step, stuck, told_of
from calib_capture.checking.finding import DOUBTFUL, WRONG, Finding
from calib_capture.checking.signs import SIGNS, sign_findings
from calib_capture.checking.small_motion import SmallMove, small_moves
from calib_capture.checking.streams import Heard, stream_findings
from calib_capture.checking.units import unit_findings
from calib_model.arrays import Array
from calib_model.errors import CalibrationError
from calib_model.instruments import ActiveProbe, Arm, Gauge

REST = 0.1  # s that follow a motion
FOLLOWED = 0.5  # of a commanded turn, that a joint has to make
LISTENER = 3.0  # s for a controller to show itself
FOLLOWING, UNLOOKED = 'following', 'not looked at'
DEGREES = 57.3


class Cell(Protocol):
    """A live arm and probe."""

    heard: Heard

    def spin(self, seconds: float, until: Callable[[], bool] = ...) -> None:
        """Take messages in for so long, or until something is so."""

    def topic_findings(self) -> list[Finding]:
        """Whether both streams come, each from one node."""

    def listening(self) -> bool:
        """Whether somebody takes commands."""

    def send(self, move: SmallMove) -> None:
        """Command a motion."""

    def problem(self) -> str:
        """What the controller says against the last command; may be empty."""


class Check:
    """Looks at an arm that stands with its probe on a sphere, and then moves it a little; `say` is
    told each finding."""

    def __init__(
        self, arm: Arm, probe: ActiveProbe, gauge: Gauge, cell: Cell, say: Callable[[Finding], None]
    ) -> None:
        self._arm, self._probe, self._gauge = arm, probe, gauge
        self._cell, self._tell = cell, say
        self.wrong = self.barred = False  # whether something is, and whether that bars motion

    def look(self, seconds: float) -> None:
        """Listen for `seconds` while nothing moves."""
        cell = self._cell
        cell.spin(seconds)
        self._say(*cell.topic_findings())
        if cell.heard.joints and cell.heard.readings:
            self._say(*stream_findings(cell.heard))
            self._say(*unit_findings(self._arm, self._probe, self._gauge, cell.heard))

    def leave_out(self, why: str, advice: str) -> None:
        """Say what is not looked at."""
        self._say(Finding(f'{SIGNS}, clocks', DOUBTFUL, f'{UNLOOKED}, {why}', advice))

    def move(self) -> None:
        """Move one joint after the other, and tell signs, mounting and clocks by it."""
        heard = self._cell.heard
        at = heard.joints[-1].joints, np.median(heard.contacts[-20:], axis=0)
        try:
            moves = small_moves(self._arm, self._probe, *at, heard.rate)
        except CalibrationError as error:
            self.leave_out('the arm was not moved', str(error))
            return
        self._cell.spin(LISTENER, until=self._cell.listening)
        if not self._cell.listening():
            advice = 'start the controller, or remap its topic'
            self._say(Finding('commands', WRONG, 'nobody listens to them', advice))
            return
        if all(self._follows(move) for move in moves):
            self._judge()

    def _judge(self) -> None:
        contact = in_step(self._arm, self._probe, self._gauge, self._cell.heard)
        if contact is None:
            advice = 'see rates, gaps and stamps above'
            self._say(Finding(SIGNS, WRONG, 'too few readings have joints at their stamps', advice))
            return
        stylus = stuck(contact)
        if stylus is not None:
            seen = f'displacement {stylus + 1} hardly changes while the arm moves'
            self._say(Finding('styli', WRONG, seen, 'see to this stylus and its cable'))
            return
        told = told_of(self._arm, self._probe, self._gauge, self._cell.heard, contact)
        self._say(*sign_findings(told))

    def _follows(self, move: SmallMove) -> bool:
        """Whether the arm follows, and stays on the sphere."""
        heard = self._cell.heard
        joints, readings = len(heard.joints), len(heard.readings)
        self._cell.send(move)
        self._cell.spin(float(move.seconds[-1]) + REST)
        name = self._arm.joint_names[move.joint]
        q = heard.postures[joints - 1 :]
        seconds = np.array(heard.joint_times[joints - 1 :]) - heard.joint_times[joints - 1]
        objection = self._objection(move, seconds, q - q[0])
        if objection is not None:
            self._say(objection)
            return False
        if any(any(each.status) for each in heard.readings[readings:]):
            seen = f'lost when {name} turned by {np.ptp(q[:, move.joint]) * 1e3:.2f} mrad'
            advice = 'put the sphere into the middle of the probe'
            self._say(Finding('contact', WRONG, seen, advice))
            return False
        return True

    def _objection(self, move: SmallMove, seconds: Array, way: Array) -> Finding | None:
        """What is wrong with how the joints moved, (N, n) rad from where they were, in (N,) s."""
        names, name = self._arm.joint_names, self._arm.joint_names[move.joint]
        asked = move.positions[:, move.joint] - move.positions[-1, move.joint]
        turned, whole = np.ptp(way, axis=0), float(np.ptp(asked))
        most, ratio = int(np.argmax(turned)), float(turned[move.joint]) / whole
        seen = f'{name} turned by {ratio * whole * 1e3:.2f} of {whole * 1e3:.2f} mrad'
        if ratio < FOLLOWED and most != move.joint and turned[most] > FOLLOWED * whole:
            advice = 'are the joints in another order than described?'
            return Finding(FOLLOWING, WRONG, f'{seen}, {names[most]} did instead', advice)
        if ratio < FOLLOWED:
            advice = self._cell.problem() or 'see what the controller says of the command'
            return Finding(FOLLOWING, WRONG, seen, advice)
        if ratio > 1 / FOLLOWED:
            degrees = FOLLOWED < ratio / DEGREES < 1 / FOLLOWED
            advice = 'are joint states in degrees?' if degrees else 'in which unit are they?'
            return Finding(FOLLOWING, WRONG, seen, advice)
        first = way[seconds <= move.seconds[0], move.joint] * np.sign(asked[0])
        if first.min() < -FOLLOWED / 4 * whole:
            seen = f'{name} turned the other way than commanded'
            return Finding(FOLLOWING, WRONG, seen, 'do joint states and commands count alike?')
        return None

    def _say(self, *findings: Finding) -> None:
        for each in findings:
            self.wrong |= each.verdict == WRONG
            self.barred |= each.verdict == WRONG and not each.movable
            self._tell(each)
