# SPDX-License-Identifier: Apache-2.0
"""The demos that there are: which arm, with which probe, and how it gets around the gauge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ament_index_python.packages import get_package_share_directory

# bag: its locations and spheres; tested as in the chapter on all spheres but the last of one place
CAPTURES = {
    'identification': ((1, 2, 3, 4, 5, 6, 7), (1, 6, 10, 14)),
    'held_out': ((8,), tuple(range(1, 15))),
}
DEFAULT = 'kr5'


@dataclass(frozen=True)
class Variant:
    """`poses` per sphere; `files` of calib_bringup/config by what they describe: what is left out
    is as the nodes, or `hand_guided`, have it.

    A passive probe reads nothing, so its arm is `led` around the gauge by hand and yields to the
    sphere: one that holds its commanded joints against the seat tells nothing of itself.
    """

    about: str
    poses: int = 60
    files: dict[str, str] = field(default_factory=dict)
    led: bool = False

    def paths(self, *names: str) -> dict[str, str]:
        """The absolute paths of those of the files that are asked for and there."""
        config = Path(get_package_share_directory('calib_bringup')) / 'config'
        return {name: str(config / self.files[name]) for name in names if name in self.files}


VARIANTS = {
    DEFAULT: Variant('KUKA KR 5 sixx R650, active probe'),
    'passive': Variant(
        'the KR 5 led by hand, passive probe',
        files={
            'arm': 'arms/kuka_kr5_sixx_r650.yaml',
            'probe': 'probes/passive_seat_kr5.yaml',
            'gauge': 'gauges/ball_bar_kr5.yaml',
            'placements': 'locations/kr5.yaml',
        },
        led=True,
    ),
    'iiwa14': Variant(
        'KUKA LBR iiwa 14 R820, active probe',
        files={'arm': 'arms/kuka_lbr_iiwa14.yaml', 'placements': 'locations/kr5.yaml'},
    ),
    'faro': Variant(
        "FARO Sterling led by hand, passive probe: the chapter's 10,780 poses", poses=385, led=True
    ),
}


def led_arguments(variant: Variant, bag: str, seed: int, poses: int) -> list[str]:
    """What `hand_guided` is told for a bag of CAPTURES."""
    locations, spheres = CAPTURES[bag]
    words = [bag, '--seed', str(seed), '--poses', str(poses)]
    for name, path in variant.paths('arm', 'probe', 'gauge', 'placements').items():
        words += [f'--{name}', path]
    return [*words, '--locations', *_words(locations), '--spheres', *_words(spheres)]


def _words(numbers: Sequence[int]) -> list[str]:
    return [str(number) for number in numbers]
