# SPDX-License-Identifier: Apache-2.0
"""A ROS domain that no other graph of this machine is on, or will be while we hold it.

Two graphs on one domain hear each other: an arm's joints would be paired with another's probe.
"""

from __future__ import annotations

import random
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from calib_model.errors import CalibrationError

DOMAINS = range(1, 101)  # those above meet the ports that Linux hands out
FIRST_PORT, PORTS_PER_DOMAIN = 7400, 250  # of DDS
FIRST_UNICAST, PORTS_PER_PARTICIPANT = 10, 2
PARTICIPANTS = 20  # looked for: the first may have ended while others still run
CLAIM = 249  # the last of a domain's ports; a graph would need 120 participants to come to it

_held = ExitStack()


@contextmanager
def claimed_domain() -> Iterator[int]:
    """The id of a domain without a graph, kept from other callers until the context ends.

    Raises:
        CalibrationError: every domain has a graph or is claimed.
    """
    for domain in random.sample(DOMAINS, len(DOMAINS)):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as claim:
            if _bound(claim, domain, CLAIM) and not _has_graph(domain):
                yield domain
                return
    raise CalibrationError('every ROS domain of this machine is in use')


def held_domain() -> int:
    """As `claimed_domain`, but kept until this process ends."""
    return _held.enter_context(claimed_domain())


def _has_graph(domain: int) -> bool:
    """Whether a participant of this domain listens on its discovery port."""
    for participant in range(PARTICIPANTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
            if not _bound(port, domain, FIRST_UNICAST + PORTS_PER_PARTICIPANT * participant):
                return True
    return False


def _bound(port: socket.socket, domain: int, offset: int) -> bool:
    try:
        port.bind(('', FIRST_PORT + PORTS_PER_DOMAIN * domain + offset))
    except OSError:
        return False
    return True
