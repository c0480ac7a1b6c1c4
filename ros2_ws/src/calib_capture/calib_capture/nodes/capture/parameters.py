# SPDX-License-Identifier: Apache-2.0
"""The parameters of the capture node."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calib_capture.default_files import configured, explained
from calib_capture.measuring import AUTO as OURS, JOINTS, NONE, RunSettings
from calib_capture.motion import BodySettings, parse_bodies
from calib_capture.nodes.arm_commander import ACTION, AUTO, TOPIC
from calib_capture.program import GO, SIMULATED, WAIT, ProgramSettings
from calib_model.bags import Temperature
from calib_model.bounds import TEMPERATURE
from calib_model.descriptions import Standing, parse_placements, read_description
from calib_model.errors import ParameterError
from calib_model.files import Folders, confined, usual_writing
from calib_model.nodes import Parameters
from calib_model.pairing import HandGuidedSettings, SteadySettings
from calib_model.topics import CONTROLLER
from calib_model.transforms import RigidTransform

_APPROACH = "m along the probe's axis that must be free before every pose"
_POOL = 'candidates for every pose, of which the most telling are taken; 1: as they come'
_WRITING = 'folders that goals may have bags written in'
_TAUGHT = (
    'path of a YAML file that keeps the taught locations, and whose locations count as taught; '
    'empty: they are gone with the node'
)
_MODE = (
    'program: the arm is commanded from pose to pose and stands at each; '
    'continuous: it is led by hand, and poses are taken while it moves, or by /capture/take where '
    'a passive probe gives no readings'
)
_CORRECT = (
    'pair readings with the joints by the estimated offset between their clocks; '
    'in mode continuous, where poses wait until it is known'
)
_CHECK = (
    'look for wrong units, signs, rates and clocks in the first seconds, and end with the reason'
)
_STANDING = 'where none of settle, dwell and rest is given, as /arm_description says, if it does'
STANDS = ('settle', 'dwell', 'rest')
_CONTROLLER = 'name of the controller: topic and action of the commands are named by it'
_COMMAND = (
    'topic: trajectories are published; action: they are goals of FollowJointTrajectory; '
    'auto: goals where a server answers'
)
_BETWEEN = (
    'wait: one gauge is carried; before the next location the arm goes out of the way, and waits '
    'for /capture/continue or Enter; go: a gauge stands at every location, and all are in the way; '
    'simulated: a simulated one is wherever it is probed'
)
_STAMPS = (
    'auto: trajectories begin at a stamp where those of the joint states are of the clock of this '
    'machine; joints: also where they are of another, which has to be the clock of the controller; '
    'none: they begin when they are received'
)
_ACCELERATION = 'rad/s^2, limit of the joints for which the description of the arm has none'
_JERK = 'rad/s^3, limit of the joints for which the description of the arm has none'
STANDING = Standing()
MAX_GAP = 0.25  # s between joint states: those of a slow driver come at 10 Hz
DESCRIBED = ('arm', 'probe', 'gauge')
PROGRAM, CONTINUOUS = 'program', 'continuous'
#: deg C, of a gauge that nobody measured
UNKNOWN = -1000.0


@dataclass(frozen=True)
class CaptureParameters:
    """What a capture is asked for; `paths` of descriptions are empty where a topic tells."""

    paths: dict[str, str]
    placements: dict[int, RigidTransform]
    locations: tuple[int, ...]
    output: str
    program: ProgramSettings
    steady: SteadySettings
    temperature: Temperature | None
    run: RunSettings
    wait_timeout: float
    resume: bool = False
    serve: bool = False
    mode: str = PROGRAM
    moving: HandGuidedSettings = HandGuidedSettings()
    correct_clock: bool = False
    silence: float = 3.0
    check: bool = True
    taught: str = ''
    writing: Folders = Folders('output_folders', ())
    command: str = AUTO
    controller: str = CONTROLLER
    between: str = WAIT
    assumed: bool = False  # the placements are the shipped example's, nobody gave them
    stands_as_told: bool = False  # whether settle, dwell or rest were given

    def standing_as(self, described: Standing | None) -> CaptureParameters:
        """With how long the arm is to stand for a pose: as given, else as it is described."""
        if described is None or self.stands_as_told:
            return self
        return replace(
            self,
            steady=replace(self.steady, settle=described.settle, dwell=described.dwell),
            run=replace(self.run, hold=described.hold),
        )

    def confined(self) -> AbstractContextManager[None]:
        """Within, the bag of a goal is opened in the folders open to callers alone."""
        return confined(self.writing, self.writing) if self.serve else nullcontext()


class ParameterReader:
    """Declares the capture node's parameters and checks what was given for them.

    What may be set while the node runs is for the goals that come after.
    """

    def __init__(self, node: Any) -> None:
        self._parameters = Parameters(node)

    def read(self) -> CaptureParameters:
        """All parameters.

        Raises:
            ParameterError: one of them cannot be used; names it.
            DescriptionError: the placements cannot be read.
        """
        text = 'path of a YAML file: the description; empty: the one on the topic'
        paths = {key: self._parameters.text(key, '', text) for key in DESCRIBED}
        places = self._text('placements', '', explained('placements'))
        between, standing = self._between(), self._standing()
        steady = self._steady(standing)
        return CaptureParameters(
            paths,
            configured('placements', places, parse_placements),
            self._integers('locations', 'to visit; empty: all that have a place'),
            self._text('output', 'capture', 'bag to write, a folder that is not there'),
            self._program(between == GO),
            steady,
            self._temperature(),
            self._run(standing, between == WAIT),
            self._number('wait_timeout', 30.0, 's to wait for arm and probe', 0.1, 1e5),
            self._flag('resume', 'go on with the bag in output, or begin it'),
            self._parameters.flag(
                'serve', False, 'wait for goals on /capture/run and spheres on /capture/teach'
            ),
            mode=self._mode(),
            moving=self._moving(steady.lateness),
            correct_clock=self._flag('correct_clock', _CORRECT),
            silence=self._number(
                'silence', 3.0, 's without a message after which a led capture is over', 0.1, 1e5
            ),
            check=self._parameters.flag('check', True, _CHECK, _later),
            taught=self._parameters.text('taught', '', _TAUGHT),
            command=self._command(),
            controller=self._parameters.text('controller', CONTROLLER, _CONTROLLER),
            between=between,
            assumed=not places,
            stands_as_told=standing != STANDING or any(map(self._parameters.given, STANDS)),
            writing=Folders(
                'output_folders',
                self._parameters.texts('output_folders', usual_writing(), _WRITING),
            ),
        )

    def _mode(self) -> str:
        mode = self._text('mode', PROGRAM, _MODE)
        if mode not in (PROGRAM, CONTINUOUS):
            raise ParameterError(
                f"parameter 'mode': expected {PROGRAM} or {CONTINUOUS}, got {mode!r}"
            )
        return mode

    def _between(self) -> str:
        between = self._text('between_locations', WAIT, _BETWEEN)
        if between not in (WAIT, GO, SIMULATED):
            raise ParameterError(
                f"parameter 'between_locations': expected {WAIT}, {GO} or {SIMULATED}, "
                f'got {between!r}'
            )
        return between

    def _stamps(self) -> str:
        stamps = self._text('command_stamps', OURS, _STAMPS)
        if stamps not in (OURS, JOINTS, NONE):
            raise ParameterError(
                f"parameter 'command_stamps': expected {OURS}, {JOINTS} or {NONE}, got {stamps!r}"
            )
        return stamps

    def _command(self) -> str:
        how = self._parameters.text('command', AUTO, _COMMAND)
        if how not in (TOPIC, ACTION, AUTO):
            raise ParameterError(
                f"parameter 'command': expected {TOPIC}, {ACTION} or {AUTO}, got {how!r}"
            )
        return how

    def _moving(self, lateness: float) -> HandGuidedSettings:
        default = HandGuidedSettings()
        text = 'rad that the joints of a led arm go, all together, from pose to pose'
        spacing = self._number('spacing', default.spacing, text, 0.0, 100.0)
        text = 's at both ends of a contact in which a led arm gives no pose'
        seated = self._number('seated', default.seated, text, 0.0, 60.0)
        text = 's between joint states of a led arm that are interpolated across'
        max_gap = self._number('max_gap', default.max_gap, text, 1e-4, 10.0)
        return HandGuidedSettings(spacing, seated, max_gap, lateness)

    def _program(self, standing: bool) -> ProgramSettings:
        default = ProgramSettings()
        text = 'spheres to probe; empty: four spread over the gauge, 1, 6, 10 and 14 of 15'
        spheres = self._integers('spheres', text)
        text = 'm, the range of offsets in the probe'
        offsets = self._parameters.numbers('offsets', default.offset, text, _later)
        if len(offsets) != 2 or not 0 <= offsets[0] <= offsets[1]:
            raise ParameterError("parameter 'offsets': expected [shortest, longest] in m")
        text = 'deg around the z axis of the gauge from which spheres are probed'
        return ProgramSettings(
            spheres=spheres,
            poses_per_sphere=self._whole(
                'poses_per_sphere', default.poses_per_sphere, 'postures around each', 1, 10**5
            ),
            cap=np.radians(self._number('cap', 70.0, text, 0.0, 180.0)),
            offset=(float(offsets[0]), float(offsets[1])),
            approach=self._number('approach', default.approach, _APPROACH, 0.0, 1.0),
            drive_approach=self._parameters.flag(
                'drive_approach',
                default.drive_approach,
                'whether the arm comes and leaves by it; if not, ways are not looked at',
                _later,
            ),
            pool=self._whole('pool', default.pool, _POOL, 1, 1000),
            bodies=self._bodies(),
            standing=standing,
            seed=self._whole('seed', default.seed, 'of the program', 0, 2**62),
        )

    def _bodies(self) -> BodySettings:
        text = 'path of a YAML file: sizes of arm, probe and gauge, floor; empty: assumed'
        path = self._text('bodies', '', text)
        return read_description(path, parse_bodies) if path else BodySettings()

    def _standing(self) -> Standing:
        default = STANDING
        text = f's that the arm must be still first; {_STANDING}'
        settle = self._number('settle', default.settle, text, 0.0, 60.0)
        text = f's of readings that are averaged; {_STANDING}'
        dwell = self._number('dwell', default.dwell, text, 1e-3, 60.0)
        text = f's that a pose is held beyond settle and dwell; {_STANDING}'
        return Standing(settle, dwell, self._number('rest', default.rest, text, 0.0, 60.0))

    def _steady(self, standing: Standing) -> SteadySettings:
        default = SteadySettings()
        return SteadySettings(
            max_gap=MAX_GAP,
            settle=standing.settle,
            dwell=standing.dwell,
            max_spread=self._number(
                'max_spread', default.max_spread, 'm between readings of one pose', 0.0, 1.0
            ),
            lateness=self._number(
                'lateness', default.lateness, 's that a message may be late', 0.0, 60.0
            ),
        )

    def _temperature(self) -> Temperature | None:
        text = 'deg C of the gauge, for the bag to tell; -1000: not measured'
        celsius = self._number('temperature', UNKNOWN, text, UNKNOWN, TEMPERATURE[1])
        text = 'K, standard uncertainty of the temperature'
        sure = self._number('temperature_uncertainty', 0.0, text, 0.0, 100.0)
        return Temperature(celsius, sure) if celsius > TEMPERATURE[0] else None

    def _run(self, standing: Standing, carried: bool) -> RunSettings:
        default = RunSettings()
        text = 's a still arm may leave poses unanswered'
        return RunSettings(
            carried=carried,
            stamps=self._stamps(),
            batch=self._whole('batch', default.batch, 'poses commanded at once', 1, 100),
            hold=standing.hold,
            speed=self._number(
                'speed', default.speed, 'of each joint, share of its limit', 1e-3, 1.0
            ),
            approach_speed=self._number(
                'approach_speed', default.approach_speed, "m/s along the probe's axis", 1e-3, 2.0
            ),
            acceleration=self._number(
                'acceleration', default.acceleration, _ACCELERATION, 1e-2, 1e4
            ),
            jerk=self._number('jerk', default.jerk, _JERK, 1e-1, 1e6),
            answer_timeout=self._number(
                'answer_timeout', default.answer_timeout, text, 0.1, 3600.0
            ),
            give_up=self._number(
                'give_up', default.give_up, 's without an answered pose that end it', 0.1, 1e5
            ),
        )

    def _text(self, name: str, default: str, text: str) -> str:
        return self._parameters.text(name, default, text, _later)

    def _number(self, name: str, default: float, text: str, lower: float, upper: float) -> float:
        return self._parameters.number(name, default, text, lower, upper, _later)

    def _whole(self, name: str, default: int, text: str, lower: int, upper: int) -> int:
        return self._parameters.whole(name, default, text, lower, upper, _later)

    def _flag(self, name: str, text: str) -> bool:
        return self._parameters.flag(name, False, text, _later)

    def _integers(self, name: str, text: str) -> tuple[int, ...]:
        return self._parameters.wholes(name, text, _later)


def _later(_: object) -> None:
    """Nothing changes now: a server reads all parameters again before its next goal."""
