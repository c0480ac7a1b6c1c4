# SPDX-License-Identifier: Apache-2.0
"""The measuring program: in which postures the arm probes which sphere."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from calib_capture.motion import BodySettings
from calib_capture.program.pose_selection import SelectionSettings
from calib_model.arrays import Array, frozen
from calib_model.errors import CalibrationError

#: one gauge is carried from location to location by somebody; one stands at each, in the way of all
#: motion; or one is wherever it is probed, as in simulations
WAIT, GO, SIMULATED = 'wait', 'go', 'simulated'


class ProgramError(CalibrationError):
    """A measuring program that cannot be made for this arm, gauge and place."""


@dataclass(frozen=True)
class ProgramSettings:
    """What the program is asked for.

    `spheres` are numbers on the certificate; none: four spread over the gauge (`Gauge.spread`).
    `cap` (rad) is the half angle of the cap of directions from which a sphere is probed, around
    the gauge's z axis. `offset` (m) is the range of lengths by which the sphere is held off the
    probe's centre: without it eq. 15 has no rank. `limit_margin` (rad) keeps off joint limits,
    `singular_margin` (see `approach.singular_margin`) off singular postures.

    `approach` (m) is the way along the probe's axis that must be free before every pose. With
    `drive_approach` the arm comes and goes by it, and the ways between are free too; otherwise, or
    with no approach, it goes straight from contact to contact, whatever is between: for a
    simulation that does not mind. `bodies` None leaves collisions unchecked. Where gauges are
    `standing` at all places at once, each is in the way of every posture and all motion; else there
    is one that is carried.

    `pool` is how many candidates there are for every pose: the most telling ones are taken, with
    1 the first that are found. Out of three, poses do the work of a sixth more that were not
    chosen, and take twice as long to plan; a larger pool adds little.
    """

    spheres: tuple[int, ...] = ()
    poses_per_sphere: int = 60
    cap: float = np.radians(70.0)
    offset: tuple[float, float] = (0.0010, 0.0015)
    limit_margin: float = np.radians(1.0)
    singular_margin: float = 0.01
    approach: float = 0.03
    drive_approach: bool = True
    bodies: BodySettings | None = BodySettings()
    standing: bool = False
    pool: int = 3
    choice: SelectionSettings = SelectionSettings()
    seed: int = 1

    @property
    def by_approach(self) -> bool:
        """Whether the arm comes and goes along the probe's axis."""
        return self.drive_approach and self.approach > 0


@dataclass(frozen=True)
class PlannedPose:
    """One posture (n,) in rad that brings the sphere to `p_probe_sphere` (3,), m.

    `approach` (S, n) are the postures to come by along the probe's axis, the farthest first, over
    `standoff` (m), and to leave by in reverse. `way` (K + 1, n) was found free: it begins where
    the pose before was left to, ends at the first of `approach`, and goes by what is between. Both
    are empty where the arm is to go straight to the pose. `branch` is told by three signs.
    """

    location: int
    sphere: int
    joints: Array
    p_probe_sphere: Array
    approach: Array = field(default_factory=lambda: frozen(np.empty((0, 0))))
    branch: str = ''
    way: Array = field(default_factory=lambda: frozen(np.empty((0, 0))))
    standoff: float = 0.0


#: from a posture (n,) to a pose: what to go by (K, n) to where its approach begins, None when no
#: free way is found
Router = Callable[[Array, PlannedPose], Array | None]
Contacts = Callable[[Array, PlannedPose], str]
#: from a posture (n,) to the program's posture of rest, with the gauge at a location: what to go by
#: (K, n), None when no free way is found
WayOut = Callable[[Array, int], Array | None]


@dataclass(frozen=True)
class SpherePlan:
    """The poses of one sphere, in the order of visit, and what it took to find them.

    `spares` take the place of poses at which the sphere turns out to be beyond the styli: the
    sphere is nearer to the probe's centre in them. `refused` counts by branch and reason.
    """

    location: int
    sphere: int
    poses: tuple[PlannedPose, ...]
    spares: tuple[PlannedPose, ...]
    orientations: int
    unreachable: int
    refused: Mapping[tuple[str, str], int] = field(default_factory=dict)

    @property
    def reasons(self) -> dict[str, int]:
        """How many branches were refused for which reason, the most frequent first."""
        counts: dict[str, int] = {}
        for (_, reason), count in self.refused.items():
            counts[reason] = counts.get(reason, 0) + count
        return dict(sorted(counts.items(), key=lambda item: -item[1]))


@dataclass(frozen=True)
class Expected:
    """Standard uncertainty (m) of a position anywhere in the workspace, root mean square: as the
    arm is known `before`, and `after` a calibration with the program's poses."""

    before: float
    after: float


@dataclass(frozen=True)
class Program:
    """All spheres of all locations, in the order of visit.

    `way_to` finds ways that the poses' own do not tell: from where the arm stands at first, after
    a pose was left out, to one that is tried again. None where the arm is to go straight.
    `touching` says what touches in a posture (n,) before the gauge of a pose, '' for nothing.
    At `rest` (n,) the arm is out of the way of whoever carries the gauge; `way_out` leads there.
    `seconds` is how long the arm takes for all of it; NaN where nobody has said how it moves.
    """

    spheres: tuple[SpherePlan, ...]
    expected: Expected | None = None
    way_to: Router | None = field(default=None, compare=False, repr=False)
    touching: Contacts | None = field(default=None, compare=False, repr=False)
    rest: Array | None = field(default=None, compare=False, repr=False)
    way_out: WayOut | None = field(default=None, compare=False, repr=False)
    seconds: float = field(default=math.nan, compare=False)
    poses: tuple[PlannedPose, ...] = field(init=False)

    def __post_init__(self) -> None:
        poses = tuple(pose for sphere in self.spheres for pose in sphere.poses)
        object.__setattr__(self, 'poses', poses)

    @property
    def unreached(self) -> tuple[tuple[int, int], ...]:
        """Location and sphere of those that no posture reaches."""
        return tuple((s.location, s.sphere) for s in self.spheres if not s.poses)
