# SPDX-License-Identifier: Apache-2.0
"""Points that a tracker sends while an arm stands: each gets the posture it was measured in, and
goes into a bag. No graph."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from calib_model.arrays import Array
from calib_model.bags import BagWriter, cdr
from calib_model.descriptions import arm_yaml
from calib_model.errors import DataError
from calib_model.instruments import Arm
from calib_model.measured_points import PointMeasurement, PointSet
from calib_model.pairing import JointSample
from calib_model.stamps import SECOND
from calib_model.topics import ARM_DESCRIPTION, CAPTURE_POINTS
from calib_model.tracking import MISSING, StandingSettings, posture_at

#: s of joint states that are kept: a tracker may take so long to say what it measured
KEPT = 5.0
#: s without a joint state after which a point waits no longer for one
SILENT = 1.0
#: s: what is nearer to the point of the same target and station before it is that point again
AGAIN = 1e-3

NO_STAMP = 'it has no stamp: set stamps:=received'
OTHER_CLOCK = "its stamp is far from the joint states': set stamps:=received, or the clocks"


@dataclass(frozen=True)
class TrackedPoint:
    """What a tracker says: `stamp` in ns, the target's name, the station's number, `position` (3,),
    m, `orientation` (4,), a unit quaternion or zeros, `sigma`, m or 0, and the `joints` (n,), which
    are empty where they are to be found."""

    stamp: int
    target: str
    station: int
    position: Array
    orientation: Array
    sigma: float
    joints: Array = field(default_factory=lambda: np.zeros(0))


@dataclass
class PointTally:
    """How it is going: points by station and target, and how many were refused for what."""

    taken: Counter[tuple[int, str]] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)

    def line(self) -> str:
        """Counts in words."""
        stations, targets = ({place[i] for place in self.taken} for i in (0, 1))
        text = (
            f'{_counted(self.taken.total(), "point")} of {_counted(len(targets), "target")} from '
            f'{_counted(len(stations), "station")}'
        )
        if self.refused:
            reasons = ', '.join(f'{reason} {n}' for reason, n in self.refused.most_common())
            text += f'; {self.refused.total()} refused: {reasons}'
        return text


class PointSession:
    """Records points with the postures in which they were measured; each is on disk when it is
    told of.

    `say` hears a line for each point, `clock` gives seconds and `wall` ns for the bag. With
    `received` a point was measured when it comes, whatever its stamp says.

    Raises:
        BagError: the bag cannot be made.
    """

    def __init__(
        self,
        path: str | Path,
        arm: Arm,
        settings: StandingSettings,
        received: bool,
        say: Callable[[str], None],
        clock: Callable[[], float],
        wall: Callable[[], int],
    ) -> None:
        self.tally = PointTally()
        self._arm, self._settings, self._received = arm, settings, received
        self._say, self._clock, self._wall = say, clock, wall
        self._samples: deque[JointSample] = deque()
        self._heard = -math.inf
        self._waiting: deque[tuple[TrackedPoint, float]] = deque()
        self._first: TrackedPoint | None = None
        self._last: dict[tuple[int, str], int] = {}
        self._bag = BagWriter(path)
        self._bag.write_message(ARM_DESCRIPTION, cdr.string(arm_yaml(arm)), wall())
        self._bag.flush()

    def see(self, sample: JointSample) -> None:
        """A joint state has come."""
        self._heard = self._clock()
        if self._samples and sample.stamp <= self._samples[-1].stamp:
            if sample.stamp > self._samples[0].stamp:
                return  # late, or once more
            self._samples.clear()  # the clock was set back
        self._samples.append(sample)
        while self._samples[0].stamp < sample.stamp - round(KEPT * SECOND):
            self._samples.popleft()
        self.tick()

    def take(self, point: TrackedPoint) -> None:
        """A point has come; it waits for the joint states that follow it."""
        if len(point.joints):
            self._keep(point)
        elif not self._samples:
            self._refuse(point, MISSING)
        else:
            newest = self._samples[-1].stamp
            if self._received:
                point = replace(point, stamp=newest)
            if point.stamp == 0:
                self._refuse(point, NO_STAMP)
            elif abs(point.stamp - newest) > KEPT * SECOND:
                self._refuse(point, OTHER_CLOCK)
            else:
                self._waiting.append((point, self._clock()))
                self.tick()

    def tick(self) -> None:
        """Judge the points that have waited long enough."""
        while self._waiting:
            point, since = self._waiting[0]
            after = point.stamp + round(self._settings.after * SECOND)
            told = bool(self._samples) and self._samples[-1].stamp >= after
            if not told and self._clock() - max(since, self._heard) < SILENT:
                return
            self._waiting.popleft()
            posture = self._posture(point.stamp) if told else MISSING
            if isinstance(posture, str):
                self._refuse(point, posture)
            else:
                self._keep(replace(point, joints=posture))

    def close(self) -> None:
        """Judge what still waits and finish the bag."""
        while self._waiting:
            self._refuse(self._waiting.popleft()[0], MISSING)
        self._bag.close()

    def _posture(self, at: int) -> Array | str:
        """Where the arm stood about a stamp (n,), or why that is not known."""
        stamp = np.array([each.stamp for each in self._samples], dtype=np.int64)
        joints = np.array([each.joints for each in self._samples])
        return posture_at(at, stamp, joints, self._settings)

    def _keep(self, point: TrackedPoint) -> None:
        place = (point.station, point.target)
        earlier = self._last.get(place)
        if earlier is not None and abs(point.stamp - earlier) < AGAIN * SECOND:
            self._refuse(point, 'it came before')
            return
        try:
            _measurement(self._arm, [point] if self._first is None else [self._first, point])
        except DataError as error:
            self._refuse(point, str(error).partition(') ')[2] or str(error))
            return
        self._first = self._first or point
        self._last[place] = point.stamp
        message = cdr.measured_point(
            point.stamp,
            f'station_{point.station}',
            point.target,
            point.station,
            point.joints,
            point.position,
            point.orientation,
            point.sigma,
        )
        self._bag.write(CAPTURE_POINTS, cdr.encode(message), self._wall(), point.stamp)
        self._bag.flush()
        self.tally.taken[place] += 1
        self._say(f'point {self.tally.taken.total()} taken: {_named(point)}')

    def _refuse(self, point: TrackedPoint, reason: str) -> None:
        self.tally.refused[reason] += 1
        self._say(f'refused: {_named(point)}: {reason}')


def _counted(number: int, name: str) -> str:
    return f'{number} {name}{"" if number == 1 else "s"}'


def _named(point: TrackedPoint) -> str:
    return f'target {point.target!r}, station {point.station}'


def _measurement(arm: Arm, points: list[TrackedPoint]) -> PointMeasurement:
    """Points as one measurement.

    Raises:
        DataError: a point does not fit the arm or the others.
    """
    if len({len(point.joints) for point in points} | {arm.n}) > 1:
        raise DataError(f'has {len(points[-1].joints)} joint positions, {arm.name} has {arm.n}')
    columns = PointSet.of(
        np.array([point.joints for point in points]),
        np.array([point.position for point in points]),
        np.array([point.orientation for point in points]),
        [point.target for point in points],
        [point.station for point in points],
        np.array([point.sigma for point in points]),
    )
    return PointMeasurement(arm, columns).checked()
