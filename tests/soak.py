# SPDX-License-Identifier: Apache-2.0
"""What `make soak` saw, kept as it comes in output/soak.json and told in docs/soak.md."""

from __future__ import annotations

import fcntl
import json
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SOAK = os.environ.get('SOAK') == '1'
HEADER = [
    '| load | what came of it | lost without a word | memory early → at the end |',
    '| --- | --- | --- | --- |',
]


def note(**figures: object) -> None:
    """Keep figures of a soak; outside of one do nothing."""
    if not SOAK:
        return
    file = ROOT / 'output' / 'soak.json'
    file.parent.mkdir(exist_ok=True)
    with file.open('a+') as held:
        fcntl.flock(held, fcntl.LOCK_EX)  # tests go side by side
        text = file.read_text()
        kept = (json.loads(text) if text else {}) | figures
        file.write_text(json.dumps(kept, indent=1) + '\n')
        (ROOT / 'docs' / 'soak.md').write_text(page(kept))


def page(seen: dict[str, Any]) -> str:
    """The figures of a soak as a page of Markdown."""
    lines = [
        '# Soak',
        '',
        'What the last `make soak` saw; it writes this page. '
        f'{os.cpu_count()} cores, CPython {platform.python_version()}, commit {commit()}.',
        '',
        '## Load',
        '',
        *HEADER,
    ]
    if 'led_seconds' in seen:
        lines.append(
            f'| a hand-guided arm for {seen["led_seconds"] / 60:.0f} min, 500 joint states and '
            f'1000 readings in each second | {seen["led_joint_states"]} joint states and '
            f'{seen["led_readings"]} readings recorded, {seen["led_poses"]} poses; '
            f'{seen["led_lost_reported"]} messages lost on the way, reported | '
            f'{seen["led_lost_unreported"]} | {memory(seen["led_memory"])} |'
        )
    for kind in ('evaluate', 'identify'):
        if f'{kind}_calls' in seen:
            lines.append(
                f'| {seen[f"{kind}_calls"]} calls of /{kind} in a row | '
                f'{seen[f"{kind}_answered"]} answered, all alike | 0 | '
                f'{memory(seen[f"{kind}_memory"])} |'
            )
    recordings = {key[10:]: seen[key] for key in seen if key.startswith('recording ')}
    if recordings:
        lines += [
            '',
            '## A raw recording',
            '',
            'A led arm, an hour of it: 1000 readings and 500 joint states in each second.',
            '',
            '| command | GB | s of the CPU | memory at most |',
            '| --- | --- | --- | --- |',
        ]
        lines += [
            f'| {name} | {size / 1e9:.2f} | {seconds:.0f} | {held:.0f} MiB |'
            for name, (size, seconds, held) in recordings.items()
        ]
    ended = {key[6:]: seen[key] for key in seen if key.startswith('ended ')}
    if ended:
        lines += [
            '',
            '## Signals',
            '',
            'SIGINT and SIGTERM at random moments: how often it ended with each exit code.',
            '',
            '| command | ended |',
            '| --- | --- |',
        ]
        for name, counts in ended.items():
            codes = ', '.join(f'{code}: {count}' for code, count in sorted(counts.items()))
            lines.append(f'| {name} | {codes} |')
    fuzz = {key: counts for key, counts in seen.items() if key.startswith('damaged ')}
    if fuzz:
        lines += [
            '',
            '## Damaged input',
            '',
            'Each case was read right or refused in one line.',
            '',
            '| input | read right | refused |',
            '| --- | --- | --- |',
        ]
        lines += [f'| {key[8:]} | {well} | {refused} |' for key, (well, refused) in fuzz.items()]
    return '\n'.join(lines) + '\n'


def memory(figures: list[float]) -> str:
    """Memory early and late (MiB), and what it grew by."""
    early, late = figures
    return f'{early:.1f} → {late:.1f} MiB ({(late / early - 1) * 100:+.1f} %)'


def commit() -> str:
    """The commit that was tried, short; 'unknown' outside of a clone."""
    done = subprocess.run(
        ['git', 'rev-parse', '--short', 'HEAD'], cwd=ROOT, capture_output=True, text=True
    )
    return done.stdout.strip() or 'unknown'
