# SPDX-License-Identifier: Apache-2.0
"""Calibrations of one arm in the order of their dates, and what changed from each to the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib_model.errors import DataError
from calib_solver.acceptance.comparison import LEVEL, Compared, Positions, difference, positions
from calib_solver.acceptance.stored_result import StoredResult, read_result
from calib_solver.results import Record

NO_CHANGE = 'no change beyond uncertainty'
CHANGED = 'changed'


@dataclass(frozen=True)
class Step:
    """From one calibration to a later one: how the parameters differ, where the arm is elsewhere,
    and the `level` at which chance is told from change."""

    earlier: StoredResult
    later: StoredResult
    compared: Compared
    positions: Positions
    level: float

    @property
    def changed(self) -> bool:
        """Whether anything changed beyond uncertainty."""
        return self.compared.chance() < self.level

    @property
    def arm_changed(self) -> bool:
        """Whether it is the arm, too, and not the probe's place on the flange alone."""
        return self.changed and self._part(True).chance() < self.level

    @property
    def probe_changed(self) -> bool:
        """Whether it is the probe's place on the flange, too."""
        return self.changed and self._part(False).chance() < self.level

    def _part(self, of_arm: bool) -> Compared:
        return self.compared.part(self.compared.of_arm == of_arm)

    def record(self) -> Record:
        """What `compare --json` says of the step, SI."""
        found, there = self.compared, self.positions
        worst = int(np.argmax(there.size))
        beyond = found.beyond(self.level) if self.changed else np.zeros(len(found.names), bool)
        return {
            'earlier': self.earlier.folder,
            'later': self.later.folder,
            'verdict': CHANGED if self.changed else NO_CHANGE,
            'chance': found.chance(),
            'level': self.level,
            'arm': {'changed': self.arm_changed, 'chance': self._part(True).chance()},
            'probe': {'changed': self.probe_changed, 'chance': self._part(False).chance()},
            'parameters': [
                {
                    'name': name,
                    'unit': unit,
                    'earlier': float(before),
                    'later': float(after),
                    'difference': float(size),
                    'standard_uncertainty': float(standard),
                    'beyond': bool(over),
                }
                for name, unit, before, after, size, standard, over in zip(
                    found.names,
                    found.units,
                    found.earlier,
                    found.later,
                    found.size,
                    found.standard,
                    beyond,
                    strict=True,
                )
            ],
            'positions': {
                'rms': float(np.sqrt(np.mean(there.size**2))),
                'max': float(there.size[worst]),
                'standard_uncertainty': float(np.sqrt(np.mean(there.standard**2))),
                'max_position': there.points[worst].tolist(),
                'max_joints': there.joints[worst].tolist(),
                'share_beyond': float(there.beyond.mean()) if self.arm_changed else 0.0,
            },
        }


@dataclass(frozen=True)
class History:
    """Calibrations in the order of their dates and the `steps` between them: each to the next, and
    of three or more the first to the last. `notes` say what to know of the order."""

    results: tuple[StoredResult, ...]
    steps: tuple[Step, ...]
    notes: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """In a line: that nothing changed, or from where to where."""
        changed = [step for step in self.steps if step.changed]
        if not changed:
            return NO_CHANGE
        ways = ', '.join(f'{step.earlier.folder} to {step.later.folder}' for step in changed)
        return f'{CHANGED}: {ways}'

    def record(self) -> Record:
        """What `compare --json` says."""
        return {
            'verdict': CHANGED if any(step.changed for step in self.steps) else NO_CHANGE,
            'level': LEVEL,
            'results': [
                {'folder': one.folder, 'date': one.date, 'arm': one.arm.name}
                for one in self.results
            ],
            'steps': [step.record() for step in self.steps],
            'notes': list(self.notes),
        }


def compare(folders: Sequence[str]) -> History:
    """What changed between the calibrations in these folders.

    Raises:
        CalibrationError: there are less than two, a folder is no result or a mixture of several,
            or they are of two arms; names it.
    """
    if len(folders) < 2:
        raise DataError('expected two results or more to compare')
    given = [read_result(folder) for folder in folders]
    results, notes = in_order(given)
    pairs = list(pairwise(results))
    if len(results) > 2:
        pairs.append((results[0], results[-1]))
    level = LEVEL / len(pairs)
    steps = []
    for earlier, later in pairs:
        compared = difference(earlier, later)
        there = positions(earlier, later, compared, level)
        steps.append(Step(earlier, later, compared, there, level))
    return History(tuple(results), tuple(steps), (*notes, *_left_aside(results)))


def in_order(given: Sequence[StoredResult]) -> tuple[list[StoredResult], tuple[str, ...]]:
    """By the dates of their readings; as they were given where one has none, with a note."""
    undated = [one.folder for one in given if one.date is None]
    if undated:
        return list(given), (f'{undated[0]}: its readings have no date; taken in the order given',)
    return sorted(given, key=lambda one: str(one.date)), ()


def _left_aside(results: Sequence[StoredResult]) -> tuple[str, ...]:
    found = [one for one in results if (one.record.get('correction') or {}).get('accepted')]
    return tuple(
        f'{one.folder}: positions are compared with eq. 12, whose uncertainty is not counted'
        for one in found
    )


def history_lines(history: History) -> list[str]:
    """The comparison for people: mm and degrees."""
    lines = [f'{one.date or "no date"}  {one.folder}' for one in history.results]
    lines += history.notes
    for step in history.steps:
        lines += ['', *step_lines(step)]
    return [*lines, '', history.verdict]


def step_lines(step: Step) -> list[str]:
    """One step: its verdict, the positions, and the parameters that stand out."""
    record = step.record()
    there = record['positions']
    name = f'{step.earlier.folder} to {step.later.folder}'
    lines = [
        f'{name}: {record["verdict"]} (by chance in {100 * record["chance"]:.2g} % of cases)',
        f'  the arm over its workspace: {there["rms"] * 1e3:.4f} mm rms elsewhere, joint standard '
        f'uncertainty {there["standard_uncertainty"] * 1e3:.4f} mm; '
        f'{there["max"] * 1e3:.4f} mm at most, at {_place(there["max_position"])}',
    ]
    if not step.changed:
        return lines
    if record['arm']['changed']:
        lines.append(
            f'  the arm changed: beyond uncertainty in {100 * there["share_beyond"]:.0f} % of its '
            'workspace'
        )
    if record['probe']['changed']:
        lines.append(
            '  the probe changed its place on the flange, or the flange its place on the last axis'
        )
    over = [one for one in record['parameters'] if one['beyond']]
    lines += [f'  {_parameter(one)}' for one in sorted(over, key=_significance, reverse=True)]
    if not over:
        lines.append('  no parameter stands out by itself: it is several together')
    return lines


def _significance(one: Record) -> float:
    return float(abs(one['difference']) / (one['standard_uncertainty'] or 1e-300))


def _parameter(one: Record) -> str:
    factor, unit = (1e3, 'mm') if one['unit'] == 'm' else (1e3, f'm{one["unit"]}')
    return (
        f'{one["name"]}: {one["difference"] * factor:+.4f} {unit}, joint standard uncertainty '
        f'{one["standard_uncertainty"] * factor:.4f} {unit}'
    )


def _place(point: list[float]) -> str:
    return '({:.3f}, {:.3f}, {:.3f}) m'.format(*point)
