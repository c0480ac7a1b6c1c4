# SPDX-License-Identifier: Apache-2.0
"""How a capture goes in each mode."""

from __future__ import annotations

from rclpy.executors import Executor

from calib_capture.nodes.capture.graph import CaptureNode
from calib_capture.nodes.capture.hand_guided_run import HandGuidedRun
from calib_capture.nodes.capture.program_run import ProgramRun
from calib_capture.nodes.capture.run import CaptureRun, Watcher
from calib_capture.nodes.capture.run_display import RunDisplay


def capture_run(
    node: CaptureNode, executor: Executor, watcher: Watcher, showing: RunDisplay
) -> CaptureRun:
    """The run that the node is asked for now; nothing has happened yet."""
    kind = HandGuidedRun if node.led else ProgramRun
    return kind(node, executor, watcher, showing)
