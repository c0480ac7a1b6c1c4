# SPDX-License-Identifier: Apache-2.0
"""The program of a capture, planned beside the graph."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from threading import Thread

from calib_capture.nodes.capture.graph import CaptureNode
from calib_capture.program import SIMULATED, Planner, Program
from calib_model.errors import CalibrationError, ParameterError
from calib_model.instruments import PassiveProbe
from calib_model.topics import PROBE_DESCRIPTION
from calib_model.transforms import RigidTransform


class Planning:
    """Plans for what a node was told; meanwhile it calls `spin`, so that whoever asks it gets an
    answer."""

    def __init__(
        self, node: CaptureNode, spin: Callable[[], None], stopped: Callable[[], bool]
    ) -> None:
        self._node, self._spin, self._stopped = node, spin, stopped

    def __call__(
        self, places: Mapping[int, RigidTransform], locations: Sequence[int]
    ) -> Program | None:
        """The program for `locations` (all when empty) of places (`T_base_gauge`), with how long it
        takes when it is commanded as was asked. None when it was stopped meanwhile.

        Raises:
            CalibrationError: there is none.
        """
        planner = self._planner()
        planned = _Beside(lambda: self._timed(planner.program(places, locations)))
        while planned.is_alive():
            if self._stopped():
                return None
            self._spin()
        return planned.result()

    def _planner(self) -> Planner:
        node = self._node
        if isinstance(node.probe, PassiveProbe):
            # its poses would all be where the program put them: perfect, and meaningless
            raise ParameterError(
                f'{node.probe.name} is a passive probe, which does not tell where a commanded arm '
                "really is: lead the arm by hand, with parameter 'mode' continuous"
            )
        node.refuse_assumed_places()
        return Planner(node.arm, node.probe, node.gauge, node.asked.program)

    def _timed(self, program: Program) -> Program:
        node = self._node
        return node.asked.standing_as(node.descriptions.standing()).run.timed(program, node.arm)

    def refuse_real_probe(self, program: Program) -> None:
        """Nothing, where a gauge that nobody carries is asked for in a simulation.

        Raises:
            ParameterError: the probe does not say that it is one.
        """
        several = len({plan.location for plan in program.spheres}) > 1
        simulated = self._node.known_probe.simulated
        if self._node.asked.between == SIMULATED and several and not simulated:
            raise ParameterError(
                f"parameter 'between_locations': {SIMULATED}, but the probe on "
                f'{PROBE_DESCRIPTION.name} does not say that it is simulated'
            )


class _Beside(Thread):
    """Planning in a thread that nobody has to wait for, not even at the end of the process."""

    def __init__(self, work: Callable[[], Program]) -> None:
        super().__init__(daemon=True)
        self._work = work
        self._program: Program | None = None
        self._error: CalibrationError | None = None
        self.start()

    def run(self) -> None:
        """The thread's work."""
        try:
            self._program = self._work()
        except CalibrationError as error:
            self._error = error

    def result(self) -> Program:
        """The program, once the thread has ended; what it raised is raised again."""
        if self._error is not None:
            raise self._error
        assert self._program is not None, 'the planner failed, see above'
        return self._program
