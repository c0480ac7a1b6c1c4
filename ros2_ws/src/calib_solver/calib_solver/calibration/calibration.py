# SPDX-License-Identifier: Apache-2.0
"""Measurements and results from the paths that a command line or a service request names."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib_model.arm import Arm
from calib_model.arm_from_urdf import read_urdf
from calib_model.bag_reader import cut_files
from calib_model.correction import Correction
from calib_model.description import parse_arm, parse_gauge, parse_probe, read_description
from calib_model.errors import DataError
from calib_model.gravity import read_links
from calib_model.probe import Probe
from calib_model.probing import Measurement, ProbingSet
from calib_model.progress import Pace, Progress
from calib_model.raw_measurement import Instruments, RawChoice
from calib_solver.cluster import connected
from calib_solver.compiled import threads
from calib_solver.copies import copied_lines, copies, noise_lines, seen_lines
from calib_solver.held_out import HeldOut, refuse_other_instruments
from calib_solver.identification import Identification, Options, identify
from calib_solver.parallel import Spread, in_processes
from calib_solver.problem import Problem
from calib_solver.quality import ProbedSpheres, Quality, assess
from calib_solver.raw_bags import Part, RawSpheres, read_part
from calib_solver.report import report_html
from calib_solver.report_instruments import Inputs
from calib_solver.resampling import Plan, Resampled, refuse_plan, resample
from calib_solver.result import Record, result_record, write_results
from calib_solver.user_urdf import write_corrected_urdf

ROUNDS = 3  # identifications at most until the numbers of a raw bag's spheres stay the same


@dataclass(frozen=True)
class Sources:
    """Bags that make one measurement, and YAML files that take the place of their descriptions;
    `links` is a YAML or URDF file with what the arm's links weigh. Bags without poses are paired
    and sorted as `raw` says, `anew` those with poses, too."""

    bags: tuple[str, ...]
    arm: str = ''
    probe: str = ''
    gauge: str = ''
    links: str = ''
    raw: RawChoice = RawChoice()
    anew: bool = False


def bag_list(text: str) -> tuple[str, ...]:
    """The bags a request names: one path, or several separated by ':'."""
    if not text or os.path.exists(text):
        return (text,) if text else ()
    return tuple(part for part in text.split(':') if part)


@dataclass(frozen=True)
class Loaded:
    """A measurement, and what its bags without poses say of the numbers of their spheres."""

    measured: Measurement
    raw: RawSpheres | None = None
    copies: int = 0  # poses that were left out: others are the same to the last digit

    def told_by(self, spheres: ProbedSpheres) -> Loaded:
        """Numbered as the distances between these centres tell, where they do so clearly."""
        if self.raw is None or not self.raw.numbering.open:
            return self
        told = self.raw.told_by(spheres)
        return replace(self, measured=told.relabelled(self.measured, self.raw.numbering), raw=told)

    def told_with(self, arm: Arm, probe: Probe, model: Correction | None = None) -> Loaded:
        """Numbered by the distances that this arm sees."""
        if self.raw is None or not self.raw.numbering.open:
            return self
        return self.told_by(assess(Problem.of(self.measured), arm, probe, model).spheres)

    @property
    def lines(self) -> tuple[str, ...]:
        """How bags without poses became a measurement."""
        return () if self.raw is None else (*self.raw.lines, self.raw.numbering.line())

    def apart_from_copies(self) -> Loaded:
        """Each pose once."""
        poses = self.measured.poses
        copy = copies(poses)
        if not copy.any():
            return self
        measured = replace(self.measured, poses=poses.take(~copy))
        return replace(self, measured=measured, copies=int(copy.sum()))


def load(sources: Sources) -> Measurement:
    """The measurement of one or several bags; each further bag's locations are its own.

    Raises:
        CalibrationError: a bag or a description cannot be read, or they do not go together.
    """
    loaded = load_all(sources)
    return loaded.told_with(loaded.measured.arm, loaded.measured.probe).measured


def load_all(sources: Sources, progress: Progress | None = None) -> Loaded:
    """As `load`, with the numbers of a raw bag's spheres still open; tells how far reading is.

    Raises:
        CalibrationError: a bag or a description cannot be read, or they do not go together.
    """
    if not sources.bags:
        raise DataError('no bag given')
    given = Instruments(
        read_description(sources.arm, parse_arm) if sources.arm else None,
        read_description(sources.probe, parse_probe) if sources.probe else None,
        read_description(sources.gauge, parse_gauge) if sources.gauge else None,
    )
    found: list[Part] = []
    for bag in sources.bags:
        pace = Pace(progress, f'reading {bag}', 'MB', 1e6)
        found.append(read_part(bag, given, sources.raw, sources.anew, pace))
        pace.end()
    sorted_bags = [part.raw for part in found if part.raw is not None]
    if not sorted_bags:
        return Loaded(_joined([part.measured for part in found])[0]).apart_from_copies()
    raw = RawSpheres.of(sorted_bags)
    numbered = iter(raw.measurements())
    parts = [part.measured if part.raw is None else next(numbered) for part in found]
    measured, shifts = _joined(parts)
    locations = tuple(
        number + shift
        for part, shift in zip(found, shifts, strict=True) if part.raw is not None
        for number in range(1, len(part.raw.locations) + 1)
    )  # fmt: skip
    return Loaded(measured, replace(raw, locations=locations)).apart_from_copies()


def _joined(parts: Sequence[Measurement]) -> tuple[Measurement, list[int]]:
    """Bags of one arm as one measurement, and how far up the location numbers of each were moved
    so that none is used twice."""
    first = parts[0]
    if len(parts) == 1:
        return first, [0]
    sets: list[ProbingSet] = []
    used: set[int] = set()
    shifts: list[int] = []
    for part in parts:
        refuse_other_instruments(part, first)
        if not np.array_equal(part.arm.geometry, first.arm.geometry):
            raise DataError(f'{part.source}: other nominal parameters than in {first.source}')
        if part.gauge != first.gauge:
            raise DataError(f'{part.source}: another gauge than in {first.source}')
        own = set(map(int, part.poses.location))
        shift = max(used) + 1 - min(own) if own & used else 0
        used |= {number + shift for number in own}
        shifts.append(shift)
        poses = part.poses
        sets.append(
            ProbingSet(
                np.asarray(poses.location) + shift, poses.sphere, poses.joints,
                poses.displacement, poses.stamp, poses.readings,
            )
        )  # fmt: skip
    source = ', '.join(part.source for part in parts)
    joined = ProbingSet.joined(sets)
    return Measurement(first.arm, first.probe, first.gauge, joined, source), shifts


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
        fit = self.done.fit
        outcome = 'converged' if fit.converged else 'NOT CONVERGED'
        return f'{outcome} after {fit.iterations} iterations: {fit.reason}'


@dataclass(frozen=True)
class Effort:
    """Work beyond a single identification, and where it is done.

    `scheduler` is the address of a Dask scheduler; '' is this machine alone. `progress` is told
    how far the repetitions are, `reading` how far the reading of bags without poses is.
    """

    plan: Plan = Plan()
    scheduler: str = ''
    progress: Progress | None = None
    reading: Progress | None = None


def calibrate(
    sources: Sources,
    options: Options,
    test: Sequence[str] = (),
    output: str = '',
    effort: Effort | None = None,
) -> Calibration:
    """Identify from bags, judge on held-out ones, write the results: command and service alike.

    Raises:
        CalibrationError: anything that keeps it from being done; nothing is written then.
    """
    effort = effort or Effort()
    unseen = load_all(replace(sources, bags=tuple(test)), effort.reading) if test else None
    loaded = load_all(sources, effort.reading)
    if sources.links:
        options = replace(options, links=read_links(sources.links, loaded.measured.arm))
    loaded, done, resampled = _identified(loaded, options, effort)
    first = (*_cut((*sources.bags, *test)), *copied_lines(loaded.copies), *noise_lines(done))
    done = replace(done, warnings=(*first, *done.warnings))
    held_out, notes = None, loaded.lines
    if unseen is not None:
        unseen = unseen.told_with(done.arm, done.probe, done.model)
        seen = seen_lines(unseen.measured, loaded.measured)
        done = replace(done, warnings=(*seen, *done.warnings))
        held_out = HeldOut.by(unseen.measured, done)
        notes = (*notes, *unseen.lines)
    record = result_record(done, held_out, resampled)
    written: list[Path] = []
    if output:
        report = report_html(done, record, _inputs(sources, test), held_out)
        written = write_results(output, done, record, report)
    return Calibration(done, held_out, record, tuple(written), notes)


def with_urdf(urdf: str, output: str, calibrated: Callable[[], Calibration]) -> Calibration:
    """A calibration, and the user's own file `urdf` with corrected joint origins in `output`.

    Raises:
        CalibrationError: the file cannot be read or corrected, or there is nowhere to write it.
    """
    if not urdf:
        return calibrated()
    if not output:
        raise DataError('a corrected URDF is written beside the results: name a folder for them')
    own = read_urdf(urdf)
    finished = calibrated()
    measured = finished.done.problem.measured
    path = write_corrected_urdf(output, own, measured.arm, finished.done.arm, urdf)
    return replace(finished, written=(*finished.written, path))


def _cut(bags: Sequence[str]) -> tuple[str, ...]:
    """A line for each file that ends before its end."""
    return tuple(
        f'{file}: cut short, what was whole is used; ros2 run calib_capture recover says how much '
        'that is'
        for bag in bags for file in cut_files(bag)
    )  # fmt: skip


def _inputs(sources: Sources, test: Sequence[str]) -> Inputs:
    """The files that the report names."""
    given = ('arm', 'probe', 'gauge', 'links')
    named = ((of, getattr(sources, of)) for of in given)
    return Inputs(sources.bags, tuple(test), tuple((of, path) for of, path in named if path))


def _identified(
    loaded: Loaded, options: Options, effort: Effort
) -> tuple[Loaded, Identification, Resampled | None]:
    """The identification and its repetitions, on this machine or on a cluster."""
    plan, progress, measured = effort.plan, effort.progress, loaded.measured
    refuse_plan(plan, len(np.unique(measured.poses.location)), measured.source)
    if not effort.scheduler:
        loaded, done = _numbered(loaded, lambda measured: identify(measured, options))
        return loaded, done, _resampled(done, plan, in_processes(threads()), progress)
    with connected(effort.scheduler) as cluster:
        loaded, done = _numbered(
            loaded, lambda measured: identify(measured, options, cluster.passes())
        )
        return loaded, done, _resampled(done, plan, cluster.spread, progress)


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
    done: Identification, plan: Plan, spread: Spread, progress: Progress | None
) -> Resampled | None:
    return resample(done, plan, spread, progress) if plan != Plan(seed=plan.seed) else None
