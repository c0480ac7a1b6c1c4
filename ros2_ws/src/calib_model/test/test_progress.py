# SPDX-License-Identifier: Apache-2.0
"""Long work tells of itself: by a bar on a terminal, by plain lines elsewhere."""

import io

import pytest

from calib_model import progress
from calib_model.progress import Pace, Progress, paced


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    """Seconds that pass only when told."""
    seconds = [0.0]
    monkeypatch.setattr(progress.time, 'monotonic', lambda: seconds[0])
    return seconds


def told(stream, clock, steps):
    pace = Pace(Progress(stream), 'reading bag', 'MB', 1e6)
    for second, done in steps:
        clock[0] = second
        pace(done * 1_000_000, 100_000_000)
    pace.end()
    return stream.getvalue()


def test_short_work_passes_without_a_word(clock):
    assert told(io.StringIO(), clock, [(0.1, 10), (0.9, 90)]) == ''
    assert told(Terminal(), clock, [(1.1, 10), (1.8, 90)]) == ''


def test_lines_come_seldom_and_say_what_is_left(clock):
    said = told(io.StringIO(), clock, [(0.0, 0), (2.0, 20), (3.0, 30), (8.0, 80)])
    assert said.splitlines() == [
        '20 of 100 MB, 8 s left, reading bag',
        '80 of 100 MB, 2 s left, reading bag',
    ]


def test_a_terminal_gets_a_bar_that_goes_away(clock):
    said = told(Terminal(), clock, [(0.0, 0), (20.0, 50)])
    assert '[###############...............] 50/100, 20 s left, reading bag' in said
    assert said.endswith('\r\x1b[K')


def test_the_first_steps_promise_nothing(clock):
    assert told(io.StringIO(), clock, [(0.0, 0), (3.0, 1)]) == '1 of 100 MB, reading bag\n'


def test_paced_items_are_the_items(clock):
    stream, seen = io.StringIO(), []
    for item in paced('abcd', Progress(stream), 'pairing', 'messages', every=2):
        seen.append(item)
        clock[0] += 2.0
    assert seen == list('abcd')
    assert stream.getvalue() == '2 of 4 messages, 4 s left, pairing\n'
    assert list(paced([1, 2], None, 'pairing', 'messages')) == [1, 2]


def test_more_than_was_to_be_had_is_no_share_of_it(clock):
    for stream, said in ((io.StringIO(), '12 poses, sphere 1\n'), (Terminal(), '#] 12/10, sphere')):
        clock[0] += 10.0
        Progress(stream).show(12, 10, float('nan'), 'sphere 1', clock[0], 'poses')
        assert said in stream.getvalue()
        assert '#' * 31 not in stream.getvalue()


def test_a_line_on_a_terminal_never_wraps():
    stream = Terminal()
    bar = Progress(stream)
    bar.show(7, 1680, 3725.0, 'location 12, sphere 14, ' + 'and so on ' * 20, 1.0)
    (_, line) = stream.getvalue().split('\r')
    shown = line.removesuffix('\x1b[K')
    assert len(shown) < 80
    assert shown.startswith('[........] 7/1680, 1.0 h left, location 12, sphere 14')


def test_progress_is_a_bar_on_a_terminal_and_lines_elsewhere():
    terminal, file = Terminal(), io.StringIO()
    for stream in (terminal, file):
        progress = Progress(stream)
        progress.show(5, 10, 90.0, 'location 1, sphere 6', 0.0)
        progress.show(6, 10, 80.0, 'location 1, sphere 6', 0.01)  # too soon to be read
        progress.say('done')
    assert '[###############...............] 5/10, 1 min 30 s left' in terminal.getvalue()
    assert '6/10' not in terminal.getvalue()
    assert terminal.getvalue().endswith('\r\x1b[Kdone\n')
    assert file.getvalue() == '5 of 10 poses, 1 min 30 s left, location 1, sphere 6\ndone\n'
