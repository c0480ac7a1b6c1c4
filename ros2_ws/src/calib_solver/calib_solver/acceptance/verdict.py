# SPDX-License-Identifier: Apache-2.0
"""The verdict of a verification, by limits or by what was stated, and how it is said."""

from __future__ import annotations

from collections.abc import Sequence

from calib_solver.results import Judged

PASSED, FAILED, WITHIN, BEYOND = 'passed', 'failed', 'within', 'beyond'


def verdict_of(limits: Sequence[Judged], within: bool) -> str:
    """`passed` or `failed` by limits; without any, `within` or `beyond` what was stated."""
    if limits:
        return PASSED if all(one.passed for one in limits) else FAILED
    return WITHIN if within else BEYOND


def verdict_words(verdict: str) -> str:
    """A verdict for people."""
    words = {WITHIN: 'within what the calibration states', BEYOND: 'beyond what it states'}
    return words.get(verdict, verdict)


def limit_lines(limits: Sequence[Judged]) -> list[str]:
    """How each limit stands, mm."""
    return [
        f'{one.name}: {one.value * 1e3:.4f} mm, allowed {one.limit * 1e3:.4f} mm: '
        f'{PASSED if one.passed else FAILED}'
        for one in limits
    ]
