# SPDX-License-Identifier: Apache-2.0
"""The chapter's findings on its FARO Sterling, on two hand-guided ones that are simulated.

The study `pattern` shows them on twenty, with as many poses as the chapter has.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

from studies import pattern, table_1
from studies.running import RESULTS, written

POSES = 45  # per sphere: enough for the pattern, the digits take the chapter's 385
SEEDS = (1,)
pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]


@cache
def arm(seed: int) -> pattern.Pair:
    """Both probes on the arm of a seed."""
    return pattern.outcomes(seed, POSES, POSES)


@pytest.mark.parametrize('seed', SEEDS)
def test_what_the_chapter_found_holds_here(seed):
    failed = [claim for claim, holds in pattern.claims(arm(seed)).items() if not holds]
    assert failed == []


@pytest.mark.parametrize('seed', SEEDS)
def test_what_is_left_is_of_the_chapters_order(seed):
    passive, active = arm(seed)['passive'], arm(seed)['active']
    for outcome, least, most in ((passive, 0.05, 0.2), (active, 0.02, 0.12)):
        assert least < outcome.own.two_sigma < most
        assert least < outcome.test.two_sigma < most
        assert 0.005 < outcome.test.distance < 0.1


def test_the_study_saw_it_on_all_of_its_arms():
    text = (RESULTS / 'pattern.txt').read_text(encoding='utf-8')
    for claim in pattern.claims(arm(SEEDS[0])):
        assert f'yes 20 of 20: {claim}\n' in text


def test_table_1_comes_out_again_to_the_last_digit():
    text = written('table_1', table_1.ABOUT, table_1.table(1))
    assert text == (RESULTS / 'table_1.txt').read_text(encoding='utf-8')
