# SPDX-License-Identifier: Apache-2.0
"""How a run is going, sphere by sphere: counts, reasons, 2 sigma."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from calib_capture.measuring import MeasuringRun
from calib_capture.program import Program
from calib_capture.showing.running_quality import RunningQuality, SphereScatter
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.measurement import ProbingSet


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
            keys = zip(earlier.location.tolist(), earlier.sphere.tolist(), strict=True)
            for key, joints, read in zip(keys, earlier.joints, earlier.displacement, strict=True):
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
