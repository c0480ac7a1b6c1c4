# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_solver solver`: eq. 15 and eq. 11 as services."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from calib_interfaces.srv import Compare, Compensate, Evaluate, FitProbe, Identify, Verify
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from calib_model.command_line import run_command
from calib_model.errors import CalibrationError
from calib_model.files import Folders, usual_reading, usual_writing
from calib_model.nodes import NodeCommand, Parameters, qos_of, run_node, unheard
from calib_model.topics import SOLVER_MARKERS
from calib_solver import serving
from calib_solver.nodes import answers, messages
from calib_solver.serving import Opened, Residuals, Workers

ABOUT = """\
The solver: answers /identify (eq. 11), /fit_probe (eq. 15) and /evaluate on recorded bags,
/compensate with joint commands that really get there, /verify with how a calibration does on new
poses, and /compare with what changed between calibrations. /solver/cancel ends what is under way,
and a request may have a time_limit."""
EXAMPLE = """\
ros2 run calib_solver solver
  ros2 service call /identify calib_interfaces/srv/Identify "{bag: 'bags/demo/identification'}\""""
THREADS = serving.AT_ONCE + serving.WAITING + 4  # each request has one; the rest answers others
ENDING = 3.0  # s for what is under way to be ended and answered
READ = 'folders that callers may have bags and descriptions read from'
WRITTEN = 'folders that callers may have results written in'
SCHEDULERS = 'addresses of Dask schedulers that callers may name'
MAGNIFIED = 'how many times larger than they are residuals are shown on /solver/markers'
Shown = tuple[str, Sequence[Residuals]]  # frame and residuals


def read_parameters(
    node: Any, on_magnification: Callable[[float], None] = unheard
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
    several calls at once, each by a process of its own."""

    def __init__(self) -> None:
        super().__init__('solver')
        self._magnification, self._opened = read_parameters(self, self._magnify)
        self._workers = Workers()
        self._last: Shown | None = None
        self._markers = self.create_publisher(
            MarkerArray, SOLVER_MARKERS.relative, qos_of(SOLVER_MARKERS)
        )
        services = (
            (Identify, 'identify', serving.identify, answers.identified),
            (FitProbe, 'fit_probe', serving.fit_probe, answers.probe_fitted),
            (Evaluate, 'evaluate', serving.evaluate, answers.evaluated),
            (Compensate, 'compensate', serving.compensate, messages.filled),
            (Verify, 'verify', serving.verify, answers.verified),
            (Compare, 'compare', serving.compare, answers.compared),
        )
        group = ReentrantCallbackGroup()
        self._offered = [
            self.create_service(kind, name, self._guarded(work, fill), callback_group=group)
            for kind, name, work, fill in services
        ]
        cancel = self.create_service(Trigger, 'solver/cancel', self._cancel, callback_group=group)
        self._offered.append(cancel)
        offered = ', '.join(f'/{name}' for _, name, *_ in services)
        self.get_logger().info(f'ready: {offered}')

    def _guarded(
        self, work: serving.Work, fill: Callable[[Any, Any], object]
    ) -> Callable[[Any, Any], Any]:
        """The service callback of `work`: our own errors become an answer, the node lives on."""

        def answer(request: Any, response: Any) -> Any:
            fields = {name: getattr(request, name) for name in _names(request)}
            limit = fields.pop('time_limit')
            long = work is serving.identify
            try:
                record = self._workers.run(work, fields, self._opened, limit, long)
            except CalibrationError as error:
                response.success, response.message = False, str(error)
                self.get_logger().warning(str(error))
                return response
            fill(response, record)
            response.success = True
            if long:
                self._show((record['frame'], record['residuals']))
            return response

        return answer

    def _cancel(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        count = self._workers.cancel()
        response.success = True
        response.message = f'{count} cancelled' if count else 'nothing was under way'
        return response

    def end_work(self) -> None:
        """End what is under way, and let it be answered."""
        self._workers.close()
        deadline = time.monotonic() + ENDING
        while not self._workers.idle() and time.monotonic() < deadline:
            time.sleep(0.01)

    def _magnify(self, magnification: float) -> None:
        self._magnification = magnification
        if self._last is not None:
            self._show(self._last)

    def _show(self, shown: Shown) -> None:
        """Every pose's residual before and after, magnified."""
        self._last = shown
        self._markers.publish(messages.residual_markers(*shown, self._magnification))


def _names(message: Any) -> list[str]:
    return list(message.get_fields_and_field_types())


def _executor() -> MultiThreadedExecutor:
    return MultiThreadedExecutor(num_threads=THREADS)


COMMAND = NodeCommand('calib_solver', 'solver', ABOUT, EXAMPLE, read_parameters)


def main() -> int:
    """Entry point: serves until Ctrl-C; 2 when an argument cannot be used."""
    return run_command(lambda: run_node(COMMAND, SolverNode, _executor, SolverNode.end_work))


if __name__ == '__main__':
    sys.exit(main())
