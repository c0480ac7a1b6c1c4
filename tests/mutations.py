# SPDX-License-Identifier: Apache-2.0
"""What the fault suite does to good input, one case a number: the same number, the same damage."""

from __future__ import annotations

import copy
import datetime
import os
import random
import resource
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml
from soak import note

from calib_model.errors import CalibrationError

#: `make soak` sets it higher; cases are numbered on from those that CI has seen
ROUNDS = int(os.environ.get('FAULT_ROUNDS', '1'))
SLOWEST = 20.0  # s for one case, on a machine that does other things too
ROOM = 3 << 29  # bytes, 1.5 GiB beside what the process has already

VALUES: tuple[Any, ...] = (
    None,
    True,
    '',
    'x',
    '1e-3',
    'nan',
    '.nan',
    float('nan'),
    float('inf'),
    -float('inf'),
    0,
    -1,
    1e308,
    -1e308,
    1e-320,
    10**400,
    2**63,
    65536,
    -0.0,
    [],
    {},
    [[]],
    [1, 2, 3],
    [1, 2],
    ['a', 'b', 'c'],
    {'a': 1},
    'é\u2028\x85',
    'a\nb',
    '1_000',
    [1e308] * 3,
    [float('nan')] * 3,
    '0x10',
    '1:30',
    'x' * 10_000,
    b'abc',
    datetime.date(2020, 1, 1),
    [0, 0, 0],
    [1e-300] * 3,
    1e200,
    '../../etc/passwd',
    '\u202e',
    [[[[]]]],
    ' ',
)
SNIPPETS = (
    b'\t',
    b'\n',
    b'\r',
    b'&a ',
    b'*a',
    b'!!',
    b'{',
    b'[',
    b'- ',
    b': ',
    b'#',
    b'"',
    b"'",
    b'\xff',
    b'\x00',
    b'---\n',
    b'%',
    b'?',
    b'<<: ',
    b'|',
    b',',
    b';',
    b'nan',
    b'inf',
    b'1e999',
    b'-',
    b'e',
    b'\xef\xbb\xbf',
    b'<',
    b'>',
    b'&amp;',
    b'&x;',
    b'<!DOCTYPE a>',
    b'\xc3\xa9',
)


def dice(kind: str, number: int) -> random.Random:
    """The generator of one case."""
    return random.Random(f'{kind} {number}')


def places(value: Any, before: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The way to every item of nested mappings and lists."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, item in items:
        yield (*before, key)
        if isinstance(item, dict | list):
            yield from places(item, (*before, key))


def changed_content(content: Any, rng: random.Random) -> Any:
    """The content with one to three items taken away, doubled, renamed or replaced."""
    content = copy.deepcopy(content)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        ways = list(places(content))
        if not ways:
            break
        *way, last = rng.choice(ways)
        at = content
        for key in way:
            at = at[key]
        kind = rng.choice(('take', 'replace', 'replace', 'rename', 'add'))
        if kind == 'take':
            del at[last]
        elif kind == 'replace':
            at[last] = copy.deepcopy(rng.choice(VALUES))
        elif kind == 'rename' and isinstance(at, dict):
            at[f'{last}{rng.choice("x_é")}'] = at.pop(last)
        elif isinstance(at, dict):
            at[rng.choice(('foo', 1, None, True, 2.5))] = copy.deepcopy(rng.choice(VALUES))
        else:
            at.insert(last, copy.deepcopy(at[last]))
    return content


def changed_bytes(content: bytes, rng: random.Random) -> bytes:
    """The bytes with a few flipped, put in, taken out or cut off."""
    changed = bytearray(content)
    for _ in range(rng.randrange(1, 4)):
        at = rng.randrange(len(changed) + 1)
        kind = rng.choice(('flip', 'put', 'put', 'take', 'cut', 'double'))
        if kind == 'flip' and at < len(changed):
            changed[at] ^= 1 << rng.randrange(8)
        elif kind == 'put':
            changed[at:at] = rng.choice(SNIPPETS)
        elif kind == 'take':
            del changed[at : at + rng.randrange(1, 40)]
        elif kind == 'double':
            changed[at:at] = changed[at : at + rng.randrange(1, 200)]
        elif rng.random() < 0.3:
            del changed[at:]
    return bytes(changed)


def changed_yaml(text: str, rng: random.Random) -> str:
    """A YAML text with other content, or the same text damaged."""
    if rng.random() < 0.7:
        content = changed_content(yaml.safe_load(text), rng)
        return yaml.dump(content, allow_unicode=rng.random() < 0.5)
    return changed_bytes(text.encode(), rng).decode('utf-8', 'replace')


@contextmanager
def bounded() -> Iterator[None]:
    """No case may take much memory or time, or let a warning through to the user."""
    pages = int(Path('/proc/self/statm').read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + ROOM, hard))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('error', RuntimeWarning)
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def refused_once(kind: str, work: Callable[[], Any]) -> bool:
    """Whether this one case is refused in one line, as `outcomes` has it."""
    return outcomes(kind, 1, lambda rng: work(), rounds=1) == (0, 1)


def outcomes(
    kind: str, cases: int, work: Callable[[random.Random], Any], rounds: int = ROUNDS
) -> tuple[int, int]:
    """Do the work of so many cases; how many went well, and how many were refused in one line.

    Anything but a CalibrationError of one line is a failure that names the case.
    """
    well = refused = 0
    for number in range(cases * rounds):
        begin = time.process_time()  # of ours: the machine may be busy
        try:
            with bounded():
                work(dice(kind, number))
            well += 1
        except CalibrationError as error:
            line = str(error)
            assert line and '\n' not in line and len(line) < 2000, f'{kind} {number}: {line!r}'
            refused += 1
        except Exception as error:  # noqa: BLE001 - any other is what is looked for
            raise AssertionError(f'{kind} {number}: {type(error).__name__}: {error}') from error
        spent = time.process_time() - begin
        assert spent < SLOWEST, f'{kind} {number}: {spent:.1f} s'
    if rounds > 1:
        note(**{f'damaged {kind}': [well, refused]})
    return well, refused
