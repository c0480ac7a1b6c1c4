# SPDX-License-Identifier: Apache-2.0
"""What people do while a capture runs, by services and by keys on a terminal: stop it and let it go
on, carry the gauge, take poses."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from std_srvs.srv import Trigger

from calib_capture.recording import PoseTaker, ProgramSession, TakeError, TakingSession
from calib_model.errors import BagError
from calib_model.typed_lines import TypedLines

NO_ARM = 'no capture moves the arm'
NONE = 'no hand-guided session with a passive probe is under way, poses are taken in one alone'
KEYS = 'Enter takes a pose, u and Enter takes the last one back, q and Enter ends'


class Interventions:
    """Answers at once; the arm comes to rest within its limits after that.

    `session` gives the program that is under way, None when there is none. `stop` is set when the
    capture is to end, `carried` when the gauge was carried to where it is awaited.
    """

    def __init__(self, node: Node, session: Callable[[], ProgramSession | None]) -> None:
        self._session = session
        self.stop = self.carried = False
        for name, act in (
            ('stop', self._stop),
            ('pause', self._pause),
            ('continue', self._continue),
        ):
            node.create_service(Trigger, f'capture/{name}', _answering(act))

    def _stop(self) -> tuple[bool, str]:
        if self._session() is None:
            return False, NO_ARM
        self.stop = True
        return True, 'the arm is stopped, and the capture ends'

    def _pause(self) -> tuple[bool, str]:
        session = self._session()
        if session is None:
            return False, NO_ARM
        session.pause()
        return True, 'the arm is stopped until /capture/continue'

    def _continue(self) -> tuple[bool, str]:
        session = self._session()
        if session is None:
            return False, NO_ARM
        paused, awaited = session.go_on(), session.awaits
        if paused:
            return True, 'going on' + (f'; {_carry(awaited)}' if awaited is not None else '')
        if awaited is None:
            return False, 'nothing is paused'
        self.carried = True
        return True, f'going on at location {awaited}'


class Carrying:
    """Has the gauge carried where a session awaits it: asks, and hears when it is there."""

    def __init__(self, interventions: Interventions, say: Callable[[str], None]) -> None:
        self._interventions = interventions
        self._say = say
        self._lines = TypedLines()
        self._asked: int | None = None

    def done(self, session: ProgramSession) -> bool:
        """Whether the gauge is where the session awaits it: somebody said so just now."""
        if session.awaits is None:
            return False
        if session.awaits != self._asked:
            self._asked = session.awaits
            self._lines.forget()
            enter = 'Enter or ' if self._lines.heard else ''
            mind = '' if session.run.out_of_the_way else '; mind the arm: it is in the way'
            self._say(f'{_carry(session.awaits)} ({enter}/capture/continue){mind}')
        if not (self._lines.take() or self._interventions.carried):
            return False
        self._interventions.carried = False
        return True

    def ask_again(self) -> None:
        """It cannot stay there."""
        self._asked = None


def _carry(location: int) -> str:
    return f'carry the bar to location {location}, then continue'


class TakeServices:
    """Answers by what `taker` gives, None when there is nothing to be taken."""

    def __init__(self, node: Node, taker: Callable[[], PoseTaker | None]) -> None:
        self._node = node
        self._taker = taker
        for name, act in (('take', PoseTaker.take), ('undo', PoseTaker.undo)):
            node.create_service(Trigger, f'capture/{name}', _answering(self._doing(act)))

    def _doing(self, act: Callable[[PoseTaker], str]) -> Callable[[], tuple[bool, str]]:
        def do() -> tuple[bool, str]:
            taker = self._taker()
            if taker is None:
                return False, NONE
            success, message = done(taker, act)
            self._node.get_logger().info(message)
            return success, message

        return do


class Keys:
    """Lines typed on a terminal, where there is one: they act in a session as the services do."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._lines = TypedLines()
        if self._lines.heard:
            say(KEYS)

    def act(self, session: TakingSession) -> bool:
        """Do what was typed; whether the session is to end."""
        for line in self._lines.take():
            if line == 'q':
                return True
            if line in ('', 'u'):
                self._say(done(session.taker, PoseTaker.undo if line else PoseTaker.take)[1])
            else:
                self._say(KEYS)
        return False


def done(taker: PoseTaker, act: Callable[[PoseTaker], str]) -> tuple[bool, str]:
    """Whether it could be done, and what there is to say."""
    try:
        return True, act(taker)
    except (TakeError, BagError) as error:
        return False, str(error)


def _answering(
    act: Callable[[], tuple[bool, str]],
) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = act()
        return response

    return answer
