# SPDX-License-Identifier: Apache-2.0
"""A calibration from bags to files: identified, judged on what was held out, written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib_model import urdf as urdf_files
from calib_model.descriptions import read_links
from calib_model.errors import DataError
from calib_model.measurement import Measurement
from calib_model.progress import Progress
from calib_solver import compensation, report, resampling
from calib_solver.calibration.duplicate_poses import duplicate_lines, noise_lines, seen_lines
from calib_solver.calibration.sources import Loaded, Sources, load_all, unread_lines
from calib_solver.fitting import Options
from calib_solver.held_out import HeldOut
from calib_solver.identification import identify
from calib_solver.identified import Identification
from calib_solver.problem import threads
from calib_solver.quality import Quality
from calib_solver.results import (
    Corrected,
    Record,
    refuse_no_place,
    result_record,
    write_results,
)

ROUNDS = 3  # identifications at most until the numbers of a raw bag's spheres stay the same


@dataclass(frozen=True)
class Calibration:
    """A finished `identify`: the identification, what was held out, the record, the files; `notes`
    say what was made of bags without poses."""

    done: Identification
    held_out: HeldOut | None
    record: Record
    written: tuple[Path, ...]
    notes: tuple[str, ...] = ()

    @property
    def test_initial(self) -> Quality | None:
        """The quality of the parameters started from on what was held out."""
        return self.held_out.initial if self.held_out is not None else None

    @property
    def test(self) -> Quality | None:
        """The quality of the identified parameters on what was held out."""
        return self.held_out.identified if self.held_out is not None else None

    @property
    def verdict(self) -> str:
        """How it went, in one line."""
        return self.done.fit.verdict


@dataclass(frozen=True)
class Effort:
    """Work beyond a single identification, and where it is done.

    `scheduler` is the address of a Dask scheduler; '' is this machine alone. `progress` is told
    how far the repetitions are, `reading` how far the reading of bags without poses is.
    """

    plan: resampling.Plan = resampling.Plan()
    scheduler: str = ''
    progress: Progress | None = None
    reading: Progress | None = None


def calibrate(
    sources: Sources,
    options: Options,
    test: Sequence[str] = (),
    output: str = '',
    effort: Effort | None = None,
    urdf: str = '',
) -> Calibration:
    """Identify from bags, judge on held-out ones, write the results: command and service alike;
    with the user's own file `urdf` also `robot.urdf`, that with corrected joint origins.

    Raises:
        CalibrationError: anything that keeps it from being done; nothing is written then.
    """
    effort = effort or Effort()
    if output:
        refuse_no_place(output)
    own = own_urdf(urdf, output)
    unseen = load_all(replace(sources, bags=tuple(test)), effort.reading) if test else None
    loaded = load_all(sources, effort.reading)
    if urdf:
        compensation.refuse_uncorrectable(own, loaded.measured.arm, urdf)
    if sources.links:
        options = replace(options, links=read_links(sources.links, loaded.measured.arm))
    loaded, done, resampled = _identified(loaded, options, effort)
    first = (
        *unread_lines((*sources.bags, *test)),
        *duplicate_lines(loaded.duplicates),
        *noise_lines(done),
    )
    done = replace(done, warnings=(*first, *done.warnings))
    held_out, notes = None, loaded.lines
    if unseen is not None:
        unseen = unseen.told_with(done.arm, done.probe, done.model)
        seen = seen_lines(unseen.measured, loaded.measured)
        done = replace(done, warnings=(*seen, *done.warnings))
        held_out = HeldOut.by(unseen.measured, done)
        notes = (*notes, *unseen.lines)
    record = result_record(done, held_out, resampled)
    more: dict[str, bytes] = {}
    if urdf:
        more['robot.urdf'] = compensation.corrected_urdf(own, loaded.measured.arm, done.arm, urdf)
    written: tuple[Path, ...] = ()
    if output:
        evidence = report.evidence_of(done, inputs(sources, test), held_out)
        written = write_reported(output, done, record, evidence, more)
    return Calibration(done, held_out, record, written, notes)


def own_urdf(urdf: str, output: str) -> bytes:
    """The user's own URDF, empty without one.

    Raises:
        DataError: there is no folder for the corrected one.
        CalibrationError: it cannot be read.
    """
    if urdf and not output:
        raise DataError('a corrected URDF is written beside the results: name a folder for them')
    return urdf_files.read_urdf(urdf) if urdf else b''


def write_reported(
    output: str,
    done: Corrected,
    record: Record,
    evidence: dict[str, Any],
    more: dict[str, bytes],
) -> tuple[Path, ...]:
    """Write the results, their report with them; what was written.

    Raises:
        CalibrationError: they cannot be written.
    """
    page = report.report_html(record, evidence)
    told = {report.EVIDENCE: report.evidence_text(evidence).encode()}
    return tuple(write_results(output, done, record, page, more | told))


def inputs(sources: Sources, test: Sequence[str]) -> report.Inputs:
    """The files that the report names."""
    given = ('arm', 'probe', 'gauge', 'links')
    named = ((of, getattr(sources, of)) for of in given)
    return report.Inputs(sources.bags, tuple(test), tuple((of, path) for of, path in named if path))


def _identified(
    loaded: Loaded, options: Options, effort: Effort
) -> tuple[Loaded, Identification, resampling.Resampled | None]:
    """The identification and its repetitions, on this machine or on a cluster."""
    plan, progress, measured = effort.plan, effort.progress, loaded.measured
    resampling.refuse_plan(plan, len(np.unique(measured.poses.location)), measured.source)
    if not effort.scheduler:
        loaded, done = _numbered(loaded, lambda measured: identify(measured, options))
        return (
            loaded,
            done,
            _resampled(done, plan, lambda: resampling.in_processes(threads()), progress),
        )
    with resampling.connected(effort.scheduler) as cluster:
        loaded, done = _numbered(
            loaded, lambda measured: identify(measured, options, cluster.passes())
        )
        return loaded, done, _resampled(done, plan, lambda: cluster.spread, progress)


def _numbered(
    loaded: Loaded, run: Callable[[Measurement], Identification]
) -> tuple[Loaded, Identification]:
    """The identification with the sphere numbers that its own distances tell."""
    done = run(loaded.measured)
    for _ in range(ROUNDS):
        before, loaded = loaded, loaded.told_by(done.identified.spheres)
        if before.raw is None or loaded.raw is None:
            return loaded, done
        if before.raw.numbering.numbers == loaded.raw.numbering.numbers:
            break
        done = run(loaded.measured)
    if loaded.raw is not None and loaded.raw.numbering.assumed:
        done = replace(done, warnings=(*done.warnings, loaded.raw.numbering.line()))
    return loaded, done


def _resampled(
    done: Identification,
    plan: resampling.Plan,
    spread: Callable[[], resampling.Spread],
    progress: Progress | None,
) -> resampling.Resampled | None:
    return None if plan.empty else resampling.resample(done, plan, spread(), progress)
