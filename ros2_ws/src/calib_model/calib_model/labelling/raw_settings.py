# SPDX-License-Identifier: Apache-2.0
"""What a user may say of a bag with nothing but raw topics."""

from __future__ import annotations

from dataclasses import dataclass

from calib_model.instruments import Arm, Gauge, Probe
from calib_model.topics import RawTopics


@dataclass(frozen=True)
class RawSettings:
    """What a user can say of a raw bag: its `topics`, the numbers of the `spheres` that were
    probed where they are known, `settings` of the pairing that are not the bag's own, whether
    the arm stood still for each pose (None: the data tell), and which `stamps` count (`header`,
    `record`, `auto`)."""

    topics: RawTopics = RawTopics()
    spheres: tuple[int, ...] = ()
    settings: tuple[tuple[str, float], ...] = ()
    standing: bool | None = None
    stamps: str = 'auto'


@dataclass(frozen=True)
class Instruments:
    """Descriptions that take the place of a bag's own, where given."""

    arm: Arm | None = None
    probe: Probe | None = None
    gauge: Gauge | None = None
