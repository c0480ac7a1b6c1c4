# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_solver solver`: eq. 15 and eq. 11 as services."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from threading import Lock
from typing import Any

import numpy as np
from calib_interfaces.srv import Compare, Compensate, Evaluate, FitProbe, Identify, Verify
from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from calib_model.bags import Temperature
from calib_model.bounds import TEMPERATURE
from calib_model.command_line import run_command
from calib_model.errors import CalibrationError, DataError
from calib_model.files import (
    Folders,
    NotPermittedError,
    confined,
    usual_reading,
    usual_writing,
)
from calib_model.labelling import RawSettings
from calib_model.nodes import NodeCommand, Parameters, qos_of, run_node
from calib_model.topics import SOLVER_MARKERS, RawTopics
from calib_solver import acceptance
from calib_solver.calibration import (
    Effort,
    Sources,
    bag_list,
    calibrate,
    calibrate_points,
    evaluation_record,
    fit_probe_from,
    hold_points,
    in_one_line,
)
from calib_solver.compensation import TargetTable, compensate_file, rows_of
from calib_solver.error_models import chosen_kinds
from calib_solver.fitting import Options, chosen_prior
from calib_solver.identification import Identification
from calib_solver.nodes import messages
from calib_solver.nodes.residual_markers import point_residuals, residuals
from calib_solver.points import PointIdentification
from calib_solver.resampling import Plan
from calib_solver.results import checked_limits

ABOUT = """\
The solver: answers /identify (eq. 11), /fit_probe (eq. 15) and /evaluate on recorded bags,
/compensate with joint commands that really get there, /verify with how a calibration does on new
poses, and /compare with what changed between calibrations."""
EXAMPLE = """\
ros2 run calib_solver solver
  ros2 service call /identify calib_interfaces/srv/Identify "{bag: 'bags/demo/identification'}\""""
THREADS, LONG = 6, 4  # of which identifications take so many at most: the rest answers others
READ = 'folders that callers may have bags and descriptions read from'
WRITTEN = 'folders that callers may have results written in'
SCHEDULERS = 'addresses of Dask schedulers that callers may name'
MAGNIFIED = 'how many times larger than they are residuals are shown on /solver/markers'


def _nothing(_: float) -> None:
    """What a change does to no node."""


@dataclass(frozen=True)
class Opened:
    """What callers may reach: folders to read from and to write to, Dask schedulers to name."""

    reading: Folders
    writing: Folders
    schedulers: tuple[str, ...]

    def permit(self, reads: Sequence[str], writes: str, scheduler: str = '') -> None:
        """Nothing, when all of it is open.

        Raises:
            NotPermittedError: something is not.
        """
        self.reading.permit_all([path for text in reads for path in bag_list(text)])
        self.writing.permit_all([writes])
        if scheduler and scheduler not in self.schedulers:
            raise NotPermittedError(
                f"scheduler {scheduler}: not among those open to callers (parameter 'schedulers')"
            )


def read_parameters(
    node: Any, on_magnification: Callable[[float], None] = _nothing
) -> tuple[float, Opened]:
    """Declare the solver's parameters on `node`, a Node or a Sheet; returns what was given.

    Raises:
        ParameterError: it cannot be used.
    """
    parameters = Parameters(node)
    reading, writing = usual_reading(), usual_writing()
    opened = Opened(
        Folders('bag_folders', parameters.texts('bag_folders', reading, READ)),
        Folders('output_folders', parameters.texts('output_folders', writing, WRITTEN)),
        parameters.texts('schedulers', (), SCHEDULERS),
    )
    return (
        parameters.number('magnification', 500.0, MAGNIFIED, 1.0, 1e6, on_magnification),
        opened,
    )


class SolverNode(Node):
    """Answers `/identify`, `/fit_probe`, `/evaluate`, `/compensate`, `/verify` and `/compare`,
    several calls at once."""

    def __init__(self) -> None:
        super().__init__('solver')
        self._magnification, self._opened = read_parameters(self, self._magnify)
        self._last: Identification | PointIdentification | None = None
        self._markers = self.create_publisher(
            MarkerArray, SOLVER_MARKERS.relative, qos_of(SOLVER_MARKERS)
        )
        short, long = ReentrantCallbackGroup(), _AtMost(LONG)
        services = (
            (Identify, 'identify', self._identify, long),
            (FitProbe, 'fit_probe', self._fit_probe, short),
            (Evaluate, 'evaluate', self._evaluate, short),
            (Compensate, 'compensate', self._compensate, short),
            (Verify, 'verify', self._verify, short),
            (Compare, 'compare', self._compare, short),
        )
        self._offered = [
            self.create_service(kind, name, self._guarded(work), callback_group=group)
            for kind, name, work, group in services
        ]
        offered = ', '.join(f'/{name}' for _, name, *_ in services)
        self.get_logger().info(f'ready: {offered}')

    def _guarded(self, work: Callable[[Any, Any], None]) -> Callable[[Any, Any], Any]:
        """The service callback of `work`: our own errors become an answer, the node lives on."""

        def answer(request: Any, response: Any) -> Any:
            try:
                with confined(self._opened.reading, self._opened.writing):
                    work(request, response)
            except CalibrationError as error:
                refusal = type(response)()
                refusal.success, refusal.message = False, str(error)
                self.get_logger().warning(str(error))
                return refusal
            response.success = True
            return response

        return answer

    def _identify(self, request: Identify.Request, response: Identify.Response) -> None:
        self._opened.permit(
            [
                request.bag,
                request.test,
                *_descriptions(request),
                _path(request.prior),
                request.urdf,
                request.links,
            ],
            request.output,
            request.scheduler,
        )
        sources = _with_raw(request)
        points = hold_points(sources)
        options = Options(
            request.objective or ('position' if points else Options.objective),
            tuple(request.fix),
            tuple(request.free),
            chosen_prior(request.prior),
            request.loss or Options.loss,
            request.correction or Options.correction,
            chosen_kinds(request.joint_errors),
            quick=request.quick,
        )
        plan = Plan(request.monte_carlo, request.bootstrap, request.seed)
        work = calibrate_points if points else calibrate
        finished = work(
            sources,
            options,
            bag_list(request.test),
            request.output,
            Effort(plan, request.scheduler),
            request.urdf,
        )
        record = finished.record
        response.arm, response.objective = record['arm'], record['objective']
        response.parameters = messages.parameters(record['parameters'])
        response.flange_t_probe = messages.transform(record['flange_T_probe'])
        response.spheres = messages.spheres(record['spheres'])
        response.initial = messages.quality(record['quality']['initial'])
        response.identified = messages.quality(record['quality']['identified'])
        if record['quality']['test'] is not None:
            response.has_test = True
            response.test = messages.quality(record['quality']['test'])
            response.test_initial = messages.quality(record['quality']['test_initial'])
        response.solver = messages.solver(record['solver'])
        if record['probe_fit'] is not None:
            response.has_probe_fit = True
            response.probe_fit = messages.probe_fit(record['probe_fit'])
        if points:
            response.rejected_points = messages.rejected_points(record['rejected'])
            response.targets = messages.targets(record['targets'])
            response.stations = messages.stations(record['stations'])
        else:
            response.rejected = messages.rejected(record['rejected'])
        response.diagnostics = messages.diagnostics(record['diagnostics'])
        if record['resampling'] is not None:
            response.has_resampling = True
            response.resampling = messages.resampling(record['resampling'])
        if record['joint_errors'] is not None:
            response.has_joint_errors = True
            response.joint_errors = messages.joint_errors(record['joint_errors'])
        if record['correction'] is not None:
            response.has_correction = True
            response.correction = messages.correction(record['correction'])
        if record['quality']['left_out'] is not None:
            response.has_left_out = True
            response.left_out = messages.left_out(record['quality']['left_out'])
        response.readings = messages.readings(record['readings'])
        response.notes = finished.notes
        response.warnings = record['warnings']
        response.written = [str(path) for path in finished.written]
        response.message = in_one_line(finished)
        self._show(finished.done)

    def _magnify(self, magnification: float) -> None:
        self._magnification = magnification
        if self._last is not None:
            self._show(self._last)

    def _show(self, done: Identification | PointIdentification) -> None:
        """Every pose's residual before and after, magnified."""
        self._last = done
        if isinstance(done, PointIdentification):
            shown = point_residuals(done, self._magnification)
        else:
            shown = residuals(done.problem, done.initial, done.identified, self._magnification)
        self._markers.publish(messages.residual_markers(done.arm.base_frame, shown))

    def _fit_probe(self, request: FitProbe.Request, response: FitProbe.Response) -> None:
        self._opened.permit([request.bag, *_descriptions(request)], request.output)
        fitted = fit_probe_from(_sources(request), request.output)
        response.flange_t_probe = messages.transform(fitted.record['flange_T_probe'])
        response.standard_uncertainty = fitted.record['standard_uncertainty']
        response.spheres = messages.spheres(fitted.record['spheres'])
        response.probe_fit = messages.probe_fit(fitted.record['probe_fit'])
        response.written = [str(path) for path in fitted.written]
        response.message = fitted.verdict

    def _evaluate(self, request: Evaluate.Request, response: Evaluate.Response) -> None:
        self._opened.permit([request.bag, *_descriptions(request), request.correction], '')
        record = evaluation_record(_sources(request), request.correction)
        response.quality = messages.quality(record)
        response.spheres = messages.spheres(record.get('spheres', []))
        response.message = (
            f'{len(record["spheres"])} spheres evaluated'
            if 'spheres' in record
            else f'{record["position"]["count"]} points evaluated'
        )

    def _compensate(self, request: Compensate.Request, response: Compensate.Response) -> None:
        def rows(n: int) -> TargetTable:
            position, turn = np.array(request.position), np.array(request.rotation_vector)
            return rows_of(n, position, turn, np.array(request.joint_position))

        self._opened.permit([request.result, request.table], request.output)
        finished = compensate_file(
            request.result,
            request.table or rows,
            request.output,
            request.tool,
            request.position_only,
        )
        done = finished.done
        response.rows = len(done.joints)
        response.joint_command = done.joints.reshape(-1).tolist()
        response.miss_mean = float(finished.miss.mean())
        response.miss_max = float(finished.miss.max())
        response.change_max = finished.change
        response.written = [str(path) for path in finished.written]
        response.message = '; '.join((finished.verdict, *finished.notes))

    def _verify(self, request: Verify.Request, response: Verify.Response) -> None:
        self._opened.permit(
            [request.bag, request.result, request.gauge, request.limits], request.output
        )
        sources = Sources(bag_list(request.bag), gauge=request.gauge)
        found = acceptance.verify(sources, request.result, request.limits, more=_limits(request))
        if request.output:
            response.written = [str(acceptance.write_verification(found, request.output))]
        record = found.record()
        response.verdict, response.within = record['verdict'], record['stated']['within']
        response.limits = messages.limits(record['limits'])
        for name in ('position', 'distance'):
            stated = record['stated'][name] or {'stated': math.nan, 'bound': math.nan}
            setattr(response, f'{name}_stated', stated['stated'])
            setattr(response, f'{name}_bound', stated['bound'])
        response.quality = messages.quality(record['quality'])
        response.nominal = messages.quality(record['nominal'])
        response.spheres = messages.spheres(record['spheres'])
        response.message = '; '.join(acceptance.verification_lines(found)[::-1])

    def _compare(self, request: Compare.Request, response: Compare.Response) -> None:
        self._opened.permit(list(request.results), request.output)
        found = acceptance.compare(list(request.results))
        if request.output:
            response.written = [str(acceptance.write_comparison(found, request.output))]
        record = found.record()
        response.verdict = record['verdict']
        response.order = [one['folder'] for one in record['results']]
        response.changes = [messages.change(step) for step in record['steps']]
        response.message = '; '.join((found.verdict, *found.notes))


class _AtMost(CallbackGroup):
    """Callbacks of which only so many are under way at a time; the others' requests wait."""

    def __init__(self, limit: int) -> None:
        super().__init__()
        self._free = limit
        self._lock = Lock()

    def can_execute(self, _: Any) -> bool:
        """Whether one more may begin."""
        return self._free > 0

    def beginning_execution(self, _: Any) -> bool:
        """One more is to begin; False: it may not."""
        with self._lock:
            if not self._free:
                return False
            self._free -= 1
            return True

    def ending_execution(self, _: Any) -> None:
        """One has ended."""
        with self._lock:
            self._free += 1


def _sources(request: Any) -> Sources:
    return Sources(bag_list(request.bag), request.arm, request.probe, request.gauge)


def _descriptions(request: Any) -> tuple[str, str, str]:
    return request.arm, request.probe, request.gauge


def _limits(request: Verify.Request) -> dict[str, float]:
    """The limits that stand in a request itself.

    Raises:
        CalibrationError: there are not as many values as names, or one is unknown.
    """
    names, values = list(request.limit_names), list(request.limit_values)
    if len(names) != len(values):
        raise DataError(f'limit_values: expected {len(names)}, one a name, got {len(values)}')
    return checked_limits(dict(zip(names, values, strict=True)))


def _path(prior: str) -> str:
    """A prior that is a file's path, not a word or a strength."""
    return prior if os.sep in prior or os.path.exists(prior) else ''


def _with_raw(request: Identify.Request) -> Sources:
    """The sources of an identification, with what is said of bags without poses."""
    topics = RawTopics(
        request.joint_states or RawTopics.joint_states,
        request.displacements or RawTopics.displacements,
        tuple(request.joints),
    )
    choice = RawSettings(topics, tuple(int(number) for number in request.spheres))
    return replace(
        _sources(request),
        links=request.links,
        raw=choice,
        anew=request.raw,
        temperature=_temperature(request),
    )


def _temperature(request: Identify.Request) -> Temperature | None:
    if not request.temperature > TEMPERATURE[0]:  # NaN, too
        return None
    sure = request.temperature_uncertainty
    return Temperature(request.temperature, 0.0 if math.isnan(sure) else sure)


def _executor() -> MultiThreadedExecutor:
    return MultiThreadedExecutor(num_threads=THREADS)


COMMAND = NodeCommand('calib_solver', 'solver', ABOUT, EXAMPLE, read_parameters)


def main() -> int:
    """Entry point: serves until Ctrl-C; 2 when an argument cannot be used."""
    return run_command(lambda: run_node(COMMAND, SolverNode, _executor))


if __name__ == '__main__':
    sys.exit(main())
