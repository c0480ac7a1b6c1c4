# SPDX-License-Identifier: Apache-2.0
"""`/capture/take` and `/capture/undo`, and the same by keys on a terminal."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable

from rclpy.node import Node
from std_srvs.srv import Trigger

from calib_capture.recording import PoseTaker, TakeError, TakingSession
from calib_model.errors import BagError

NONE = 'no hand-guided session with a passive probe is under way, poses are taken in one alone'
KEYS = 'Enter takes a pose, u and Enter takes the last one back, q and Enter ends'


class TakeServices:
    """Answers by what `taker` gives, None when there is nothing to be taken."""

    def __init__(self, node: Node, taker: Callable[[], PoseTaker | None]) -> None:
        self._node = node
        self._taker = taker
        node.create_service(Trigger, 'capture/take', self._answering(PoseTaker.take))
        node.create_service(Trigger, 'capture/undo', self._answering(PoseTaker.undo))

    def _answering(
        self, act: Callable[[PoseTaker], str]
    ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            taker = self._taker()
            if taker is None:
                response.message = NONE
                return response
            response.success, response.message = done(taker, act)
            self._node.get_logger().info(response.message)
            return response

        return answer


class Keys:
    """Lines typed on a terminal, where there is one: they act in a session as the services do."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._listening = sys.stdin is not None and sys.stdin.isatty()
        if self._listening:
            say(KEYS)

    def act(self, session: TakingSession) -> bool:
        """Do what was typed; whether the session is to end."""
        while self._listening and _in_front() and select.select([sys.stdin], [], [], 0)[0]:
            line = sys.stdin.readline()
            if not line:  # the terminal is gone
                self._listening = False
            elif line.strip().lower() == 'q':
                return True
            elif line.strip().lower() in ('', 'u'):
                what = PoseTaker.undo if line.strip() else PoseTaker.take
                self._say(done(session.taker, what)[1])
            else:
                self._say(KEYS)
        return False


def _in_front() -> bool:
    """Whether what is typed is for us: who reads a terminal from the background is stopped."""
    try:
        return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except OSError:
        return False


def done(taker: PoseTaker, act: Callable[[PoseTaker], str]) -> tuple[bool, str]:
    """Whether it could be done, and what there is to say."""
    try:
        return True, act(taker)
    except (TakeError, BagError) as error:
        return False, str(error)
