# SPDX-License-Identifier: Apache-2.0
"""How long a run has waited, how long it goes on waiting, and how long it will take."""

from __future__ import annotations

from calib_capture.measuring.run_settings import RunError, RunSettings
from calib_capture.measuring.tally import Tally


class Patience:
    """Instants in s of the wall clock: of the last sign of life, of the last outcome, and of the
    start without what was waited for a person. `expected` (s) is how long it should take."""

    def __init__(self, settings: RunSettings, tally: Tally, expected: float, now: float) -> None:
        self._settings, self._tally, self._expected = settings, tally, expected
        self._sign_of_life = self._outcome = self._start = now

    def alive(self, now: float) -> None:
        """The arm has moved, or was told to."""
        self._sign_of_life = now

    def answered(self, now: float) -> None:
        """A pose has an outcome, or the waiting begins anew."""
        self._sign_of_life = self._outcome = now

    def stood_still(self, seconds: float) -> None:
        """A person was waited for."""
        self._start += seconds

    def overdue(self, now: float) -> bool:
        """Whether there has been no sign of life for too long."""
        return now - self._sign_of_life > self._settings.answer_timeout + self._settings.hold

    def give_up(self, now: float) -> None:
        """Nothing, while there is hope.

        Raises:
            RunError: nothing has come of any pose for too long.
        """
        waited = now - self._outcome
        if waited > self._settings.give_up + self._settings.hold:
            raise RunError(
                f'no pose has been answered for {waited:.0f} s, giving up: '
                f'{self._tally.line()} of {self._tally.planned}'
            )

    def seconds_left(self, now: float) -> float:
        """An estimate from the pace so far, s; before there is one, what was expected."""
        done = self._tally.done
        if not done:
            return self._expected
        return (now - self._start) / done * self._tally.left
