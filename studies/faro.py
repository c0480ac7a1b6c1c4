# SPDX-License-Identifier: Apache-2.0
"""The chapter's experiments on its FARO Sterling: a hand-guided one that is simulated.

Every pose comes out of a bag that the suite's own command made,

    ros2 run selfcenter_probe hand_guided BAG --probe KIND --seed N

and the location never used, 8, by the same with `--locations 8 --spheres 1 .. 14 --poses 429`.
What the world of `selfcenter_probe/config/world_faro.yaml` has in it and no D-H parameter can
say: eccentric and oval encoders, joints that bend, a bar and a tripod that yield to the hand.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stdout
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from calib_model.bags import read_measurement
from calib_model.measurement import Measurement
from calib_solver.fitting import Options
from calib_solver.identification import identify
from calib_solver.identified import Identification
from calib_solver.problem import Problem
from calib_solver.quality import Quality, assess
from selfcenter_probe.commands import hand_guided

KINDS = ('passive', 'active')
EQ_11, EQ_13 = 'distance_repeatability', 'distance'
#: poses of every sphere: the chapter has 10,780 in all, and about 6,000 at the location never used
POSES, TEST_POSES = 385, 429
TEST = ('--locations', '8', '--spheres', *map(str, range(1, 15)))


@cache
def captured(kind: str, seed: int, poses: int = POSES) -> Measurement:
    """The seven locations that identify, out of a bag."""
    return _captured(kind, seed, '--poses', str(poses))


@cache
def never_used(kind: str, seed: int, poses: int = TEST_POSES) -> Measurement:
    """The fourteen spheres of the location that is held out, out of a bag."""
    return _captured(kind, seed, '--poses', str(poses), *TEST)


def origin(kinds: Sequence[str], seed: int, test: bool = False) -> list[str]:
    """The commands whose bags a study reads."""
    command = 'ros2 run selfcenter_probe hand_guided'
    lines = []
    for kind in kinds:
        lines.append(f'data: {command} BAG --probe {kind} --seed {seed}')
        if test:
            lines.append(f'      {command} BAG --probe {kind} --seed {seed} \\')
            lines.append(f'        {" ".join(TEST)} --poses {TEST_POSES}')
    return lines


def _captured(kind: str, seed: int, *asked: str) -> Measurement:
    with TemporaryDirectory() as folder:
        bag = Path(folder) / 'bag'
        with redirect_stdout(io.StringIO()):
            hand_guided.run([str(bag), '--probe', kind, '--seed', str(seed), *asked])
        return read_measurement(bag)


@cache
def identified(kind: str, seed: int, objective: str = EQ_11, poses: int = POSES) -> Identification:
    """The arm as the seven locations tell it."""
    return identify(captured(kind, seed, poses), Options(objective=objective, joint_errors=()))


def tested(
    kind: str, seed: int, objective: str = EQ_11, poses: int = POSES, test_poses: int = TEST_POSES
) -> Quality:
    """What that arm is worth at the location it never saw."""
    done = identified(kind, seed, objective, poses)
    return assess(Problem.of(never_used(kind, seed, test_poses)), done.arm, done.probe)


def forget() -> None:
    """Let go of what was captured and identified."""
    for known in (captured, never_used, identified):
        known.cache_clear()


def distance_mean(quality: Quality) -> float:
    """The mean distance error, mm."""
    return float(quality.distance.mean() * 1e3)


def two_sigma_mean(quality: Quality) -> float:
    """The mean of 2 sigma over spheres and coordinates, mm."""
    return float(quality.spheres.two_sigma.mean() * 1e3)


def two_sigma_xyz(quality: Quality) -> np.ndarray:
    """The mean of 2 sigma over spheres by coordinate (3,), mm."""
    mean: np.ndarray = quality.spheres.two_sigma.mean(axis=0) * 1e3
    return mean
