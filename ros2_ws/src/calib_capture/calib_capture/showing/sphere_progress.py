# SPDX-License-Identifier: Apache-2.0
"""How a run is going, sphere by sphere: counts, reasons, 2 sigma."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from calib_capture.measuring import MeasuringRun
from calib_capture.program import Program
from calib_capture.showing.running_quality import RunningQuality, SphereScatter
from calib_model.arrays import Array
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.measurement import ProbingSet

Taken = tuple[tuple[int, int], Array, Array]  # location and sphere, joints, displacements


@dataclass(frozen=True)
class SphereProgress:
    """Poses of a sphere; `refused` counts those that were tried and not accepted, by reason."""

    location: int
    sphere: int
    planned: int
    taken: int
    refused: Mapping[str, int]
    left: int
    two_sigma: SphereScatter


class RunProgress:
    """How the poses of a `program` are going; poses of `earlier` were in the bag already."""

    def __init__(
        self, program: Program, arm: Arm, probe: Probe, gauge: Gauge, earlier: ProbingSet | None
    ) -> None:
        self._planned: dict[tuple[int, int], int] = {}
        self.plan_anew(program)
        self._quality = RunningQuality(arm, probe, gauge)
        self._taken: Counter[tuple[int, int]] = Counter()
        self._seen = 0  # of the run's poses
        if earlier is not None:
            for key, joints, read in _of(earlier):
                self._taken[key] += 1
                self._quality.add(key, joints, read)

    def plan_anew(self, program: Program) -> None:
        """The locations of `program` are done by it."""
        for plan in program.spheres:
            self._planned[plan.location, plan.sphere] = len(plan.poses)

    def spheres(self, run: MeasuringRun) -> list[SphereProgress]:
        """Every sphere of the program and of the bag, in order of location and number."""
        for pose in run.taken[self._seen :]:
            key = pose.planned.location, pose.planned.sphere
            self._taken[key] += 1
            self._quality.add(key, pose.measured.joints, pose.measured.displacement)
        self._seen = len(run.taken)
        scatter, left, refused_at = self._quality.spheres(), run.poses.left_at, run.tally.refused_at
        return [
            SphereProgress(
                *key,
                self._planned.get(key, 0),
                self._taken[key],
                {why: count for (*at, why), count in refused_at.items() if tuple(at) == key},
                left[key],
                scatter.get(key, SphereScatter()),
            )
            for key in sorted({*self._planned, *self._taken})
        ]


class HandGuidedProgress:
    """How it is going with an arm that is led by hand; so many poses are `planned` of each location
    and sphere, and those of `earlier` were in the bag already. Spheres that nobody has told yet, of
    number 0, have no scatter."""

    def __init__(
        self,
        planned: Mapping[tuple[int, int], int],
        arm: Arm,
        probe: Probe,
        gauge: Gauge,
        earlier: ProbingSet | None,
    ) -> None:
        self._planned, self._of = planned, (arm, probe, gauge)
        self._earlier = [] if earlier is None else list(_of(earlier))

    def spheres(self, poses: Iterable[Taken]) -> list[SphereProgress]:
        """Every sphere, with the `poses` of the session so far, in order of location and number."""
        quality, taken = RunningQuality(*self._of), Counter[tuple[int, int]]()
        for key, joints, read in (*self._earlier, *poses):
            taken[key] += 1
            if key[1]:
                quality.add(key, joints, read)
        scatter = quality.spheres()
        return [
            SphereProgress(
                *key,
                self._planned.get(key, 0),
                taken[key],
                {},
                max(self._planned.get(key, 0) - taken[key], 0),
                scatter.get(key, SphereScatter()),
            )
            for key in sorted({*self._planned, *taken})
        ]


def _of(poses: ProbingSet) -> Iterable[Taken]:
    keys = zip(poses.location.tolist(), poses.sphere.tolist(), strict=True)
    return zip(keys, poses.joints, poses.displacement, strict=True)
