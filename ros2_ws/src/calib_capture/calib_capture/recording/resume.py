# SPDX-License-Identifier: Apache-2.0
"""Going on with a capture that was cut: what is there already, and what is left to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib_capture.program import PlannedPose, Program, SpherePlan
from calib_capture.recording.recorder import IN_USE
from calib_model.arrays import Array
from calib_model.bags import FileAccount, read_descriptions, read_measurement, read_poses, repair
from calib_model.descriptions import arm_yaml, gauge_yaml, probe_yaml
from calib_model.errors import BagError
from calib_model.files import FolderLock
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.measurement import ProbingSet
from calib_model.topics import ARM_DESCRIPTION, CAPTURE_POSES, GAUGE_DESCRIPTION, PROBE_DESCRIPTION

SAME_POSTURE = 2e-3  # rad: what a run takes for the planned pose


@dataclass(frozen=True)
class Begun:
    """A capture that was begun: its bag's files, all complete, and its poses, None without any.

    `mended` says in a line each which files had been cut.
    """

    files: tuple[FileAccount, ...]
    poses: ProbingSet | None
    mended: tuple[str, ...] = ()

    @property
    def taken(self) -> int:
        """How many poses are there."""
        return 0 if self.poses is None else len(self.poses)

    @property
    def location(self) -> int | None:
        """Where the last pose was taken."""
        return int(self.poses.location[-1]) if self.poses is not None and self.taken else None


def begun(bag: str | Path, arm: Arm, probe: Probe, gauge: Gauge) -> Begun:
    """The capture in `bag`, its files made complete where they were cut.

    Raises:
        BagError: the bag cannot be read, holds another arm, probe or gauge, or is being written.
    """
    refuse_in_use(bag)
    # killed between making the folder and its first file
    if Path(bag).is_dir() and not any(Path(bag).iterdir()):
        Path(bag).rmdir()
        return Begun((), None)
    mended: list[str] = []
    files = tuple(repair(bag, mended.append))
    if files:
        _refuse_other(bag, arm, probe, gauge)
    if not any(file.counts.get(CAPTURE_POSES.name) for file in files):
        return Begun(files, None, tuple(mended))
    poses = read_poses(bag)[1]
    if not poses.untold.any():
        poses = read_measurement(bag).poses
    return Begun(files, poses, tuple(mended))


def _refuse_other(bag: str | Path, arm: Arm, probe: Probe, gauge: Gauge) -> None:
    """Nothing, when the bag is of these; also one without a pose has readings of its probe."""
    its = read_descriptions(bag)
    for what, topic, ours, theirs in (
        ('arm', ARM_DESCRIPTION, arm_yaml(arm), lambda: arm_yaml(its.arm())),
        ('probe', PROBE_DESCRIPTION, _real(probe), lambda: _real(its.probe())),
        ('gauge', GAUGE_DESCRIPTION, gauge_yaml(gauge), lambda: gauge_yaml(its.gauge())),
    ):
        if topic.name in its and theirs() != ours:
            raise BagError(f'{bag}: was captured with another {what} description, not gone on with')


def _real(probe: Probe) -> str:
    """Its description, whether it was simulated or not."""
    return probe_yaml(replace(probe, simulated=False))


def refuse_in_use(bag: str | Path) -> None:
    """Nothing, when nobody is writing in that folder; what is being written must not be mended.

    Raises:
        BagError: somebody is.
    """
    lock = FolderLock(bag)
    if Path(bag).is_dir() and not lock.take():
        raise BagError(IN_USE.format(bag))
    lock.release()


def remaining(program: Program, poses: ProbingSet | None) -> Program:
    """What of a program is left when `poses` have been taken, sphere by sphere.

    A taken pose that the program does not plan was taken in place of one that was refused: so
    many fewer of its sphere are left, the first in order.
    """
    if poses is None:
        return program
    plans = []
    for plan in program.spheres:
        mine = (poses.location == plan.location) & (poses.sphere == plan.sphere)
        plans.append(_left(plan, poses.joints[mine]))
    left = replace(program, spheres=tuple(plans))
    share = len(left.poses) / max(len(program.poses), 1)
    return replace(left, seconds=program.seconds * share)


def _left(plan: SpherePlan, taken: Array) -> SpherePlan:
    todo = _untaken(plan.poses, taken)
    in_place_of_others = len(taken) - (len(plan.poses) - len(todo))
    return replace(
        plan, poses=todo[max(0, in_place_of_others) :], spares=_untaken(plan.spares, taken)
    )


def _untaken(poses: Sequence[PlannedPose], taken: Array) -> tuple[PlannedPose, ...]:
    return tuple(
        pose
        for pose in poses
        if not len(taken) or np.abs(taken - pose.joints).max(axis=1).min() > SAME_POSTURE
    )
