# SPDX-License-Identifier: Apache-2.0
"""Whether a stream comes from one publisher. Knows no graph."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from enum import Enum
from inspect import Parameter, Signature
from typing import Any

FALLS = 3  # of the numbers within
WITHIN = 30.0  # s: more publishers than one; no driver is started anew so often
CLEAR = 1.0  # s without a fall after which a publisher counts as started anew
ENOUGH = 5  # messages that must have come in that time
LATCHED = 5.0  # s that a description may come after the stream of the same node: discovery has gone
# either way by then, and a heartbeat, every 3 s, has told of what was missed


class Origin(Enum):
    """What the numbers of a stream's messages tell of its publishers."""

    ONE = 'one'
    UNSURE = 'unsure'  # started anew a moment ago, or the first of several
    SEVERAL = 'several'


class Publishers:
    """Tells by the messages' numbers whether a stream has more than one publisher.

    Every publisher numbers its own messages upward, and the middleware keeps their order whatever
    it loses. Numbers that fall are those of another publisher: of one that was started anew, once,
    or of two at a time, again and again. What is late, doubled or out of order by its stamp has
    passed one publisher all the same.
    """

    def __init__(self) -> None:
        self._newest = -1
        self._falls: deque[float] = deque(maxlen=FALLS)
        self._since = 0  # messages since the last fall
        self._heard = self._left = -math.inf
        self.lost = 0  # messages of which the numbers tell, and that did not come
        self.origin = Origin.ONE

    def see(self, number: int | None, now: float) -> Origin:
        """Take the number of one more message, received at `now` (s); returns what is known.

        A middleware that tells no numbers (None) leaves it at one.
        """
        if number is None:
            return self.origin
        if number <= self._newest:
            self._falls.append(now)
            self._since = 0
            self._left = self._heard
        elif self._newest >= 0:
            self.lost += number - self._newest - 1
        self._newest = number
        self._heard = now
        self._since += 1
        self.origin = self._judged(now)
        return self.origin

    def _judged(self, now: float) -> Origin:
        if self.origin is Origin.SEVERAL:
            return Origin.SEVERAL
        if len(self._falls) == FALLS and now - self._falls[0] < WITHIN:
            return Origin.SEVERAL
        if self._falls and (now - self._falls[-1] < CLEAR or self._since < ENOUGH):
            return Origin.UNSURE
        return Origin.ONE

    def left(self, now: float) -> float | None:
        """When the publisher before this one was last heard (s); None without one of late.

        What was described before then was described by that one.
        """
        return self._left if self._falls and now - self._falls[-1] < LATCHED else None

    def pass_by(self, number: int | None) -> None:
        """A message of the topic that is not of this stream, by the same publisher or another."""
        if number == self._newest + 1:
            self._newest = number

    def forget(self) -> None:
        """Begin anew: whatever was wrong has been seen to."""
        self._falls.clear()
        self.origin = Origin.ONE


def several(topic: str, nodes: str) -> str:
    """The line that names a topic with several publishers, and the nodes that have one."""
    return (
        f'{topic} comes from more than one publisher at a time ({nodes}): '
        'no reading can be paired for sure; leave one of them running'
    )


class Numbered:
    """A subscription's callback that gets the number its publisher gave to each message.

    rclpy looks at the signature to see what a callback takes. Its executor of events passes
    message and information as one tuple, the others as two arguments.
    """

    __signature__ = Signature(
        [Parameter(name, Parameter.POSITIONAL_ONLY) for name in ('message', 'information')]
    )

    def __init__(self, take: Callable[[bytes, int | None], None]) -> None:
        self._take = take

    def __call__(self, *given: Any) -> None:
        message, information = given[0] if len(given) == 1 else given
        self._take(message, information['publication_sequence_number'])
