# SPDX-License-Identifier: Apache-2.0
"""The capture node as a server: `/capture/run` measures, `/capture/teach` says where."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from calib_interfaces.action import Capture
from rcl_interfaces.msg import SetParametersResult
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.executors import Executor
from rclpy.parameter import Parameter
from rclpy.task import Future

from calib_capture.nodes.capture.graph import TICK, CaptureNode
from calib_capture.nodes.capture.modes import capture_run
from calib_capture.nodes.capture.parameters import CaptureParameters, ParameterReader
from calib_capture.nodes.capture.run import Stopped, Unfinished, Watcher
from calib_capture.nodes.capture.run_display import RunDisplay
from calib_capture.nodes.capture.teach_service import TeachService
from calib_capture.recording import ProgramSession, Session
from calib_model.errors import CalibrationError
from calib_model.nodes import Proposal

FEEDBACK_PERIOD = 0.25  # s


def asked_by(goal: Capture.Goal, asked: CaptureParameters) -> CaptureParameters:
    """What a goal asks for; what it leaves open is as the node was started."""
    program = replace(
        asked.program,
        spheres=tuple(goal.spheres) or asked.program.spheres,
        poses_per_sphere=int(goal.poses_per_sphere) or asked.program.poses_per_sphere,
    )
    return replace(
        asked,
        locations=tuple(goal.locations) or asked.locations,
        output=goal.bag or asked.output,
        program=program,
        resume=goal.resume or asked.resume,
    )


class CaptureServer:
    """Takes one goal at a time. All work is done in `serve`, callbacks only take note."""

    def __init__(self, node: CaptureNode, executor: Executor, stopped: Callable[[], bool]) -> None:
        self._node = node
        self._executor = executor
        self._stopped = stopped
        self._given = node.asked
        self._showing = RunDisplay(node)
        self._teaching = TeachService(node, self._showing)
        self._ready = False
        self._taken = False  # a goal is accepted and not yet answered
        self._next: tuple[ServerGoalHandle, Future] | None = None
        self._action = ActionServer(
            node,
            Capture,
            'capture/run',
            self._execute,
            goal_callback=self._on_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._after_set)

    def serve(self) -> None:
        """Work until stopped; a goal that is under way then is ended properly."""
        self._node.get_logger().info('waiting for goals on /capture/run')
        while not self._stopped():
            self._executor.spin_once(timeout_sec=TICK)
            if not self._node.descriptions.missing():
                self._get_ready()
            if self._next is not None:
                handle, answer = self._next
                self._next = None
                self._teaching.busy = True
                answer.set_result(self._run(handle))
                self._teaching.busy = self._taken = False
        for _ in range(10):  # let the answer out
            self._executor.spin_once(timeout_sec=TICK)
        self._action.destroy()

    def _get_ready(self) -> None:
        """Listen to arm and probe from when they are known, to be taught before any goal."""
        if self._ready:
            return
        self._ready = True
        try:
            self._node.describe()
        except CalibrationError as error:
            self._node.get_logger().error(str(error))
            return
        self._node.listen()
        self._showing.places()

    def _on_set(self, given: Sequence[Parameter]) -> SetParametersResult:
        """Whether the next goal can do with these parameters."""
        try:
            ParameterReader(Proposal(self._node, given)).read()
        except CalibrationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _after_set(self, _: Sequence[Parameter]) -> None:
        self._given = ParameterReader(Proposal(self._node)).read()

    def _on_goal(self, _: Capture.Goal) -> GoalResponse:
        if self._taken or self._stopped():
            self._node.get_logger().warning('a goal is refused: a capture is under way')
            return GoalResponse.REJECT
        self._taken = True
        return GoalResponse.ACCEPT

    async def _execute(self, handle: ServerGoalHandle) -> Capture.Result:
        answer: Future = Future(executor=self._executor)
        self._next = handle, answer
        result: Capture.Result = await answer
        return result

    def _run(self, handle: ServerGoalHandle) -> Capture.Result:
        node, log = self._node, self._node.get_logger()
        node.asked = asked_by(handle.request, self._given)
        bag = str(Path(node.asked.output).absolute())
        existed = os.path.exists(bag)
        watcher = Watcher(
            log.info,
            _Feedback(handle),
            lambda: bool(handle.is_cancel_requested) or self._stopped(),
        )
        capturing = capture_run(node, self._executor, watcher, self._showing)
        success = unfinished = False
        try:
            node.asked.writing.permit(bag)
            message = capturing()
            success = True
            handle.succeed()
        except Stopped as stopped:
            message = f'stopped: {stopped}'
            handle.canceled() if handle.is_cancel_requested else handle.abort()
        except Unfinished as short:
            message, unfinished = str(short), True
            handle.abort()
        except CalibrationError as error:
            message = str(error)
            handle.abort()
        log.info(message)
        written = success or unfinished or (os.path.exists(bag) and not existed)
        return Capture.Result(
            success=success,
            message=message,
            bag=bag if written else '',
            taken=capturing.tally.taken,
            refused=sum(capturing.tally.refused.values()),
            reasons=list(capturing.tally.refused),
            refused_by_reason=list(capturing.tally.refused.values()),
        )


class _Feedback:
    """Tells the goal's client how far it is, a few times a second."""

    def __init__(self, handle: ServerGoalHandle) -> None:
        self._handle = handle
        self._told = 0.0

    def __call__(self, session: Session) -> None:
        now, current, tally = time.monotonic(), session.run.current, session.tally
        awaited = session.awaits if isinstance(session, ProgramSession) else None
        location = awaited or (current.location if current is not None else 0)
        if not location or now - self._told < FEEDBACK_PERIOD:
            return
        self._told = now
        self._handle.publish_feedback(
            Capture.Feedback(
                location=location,
                sphere=current.sphere if current is not None else 0,
                taken=tally.taken,
                refused=sum(tally.refused.values()),
                reasons=list(tally.refused),
                refused_by_reason=list(tally.refused.values()),
                left=tally.left,
                planned=tally.planned,
                seconds_left=session.run.seconds_left(now),
            )
        )
