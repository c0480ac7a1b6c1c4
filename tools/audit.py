# SPDX-License-Identifier: Apache-2.0
"""Ask the OSV database for known vulnerabilities of what requirements*.txt pin.

Says what it found, a line each, and never fails a build: a database's news of tomorrow must not
break what was right today. Where the database cannot be reached it says so.
"""

import json
import re
import urllib.error
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DATABASE = 'https://api.osv.dev/v1/querybatch'
PINNED = re.compile(r'^([A-Za-z0-9._-]+)==([^\s;\\]+)', re.MULTILINE)
PATIENCE = 10  # s


def pinned() -> list[tuple[str, str]]:
    """Names and versions of everything that set-up installs."""
    lists = (ROOT / f'requirements{part}.txt' for part in ('', '-dev'))
    return sorted({found for path in lists for found in PINNED.findall(path.read_text())})


def known(packages: list[tuple[str, str]]) -> list[list[str]]:
    """For each package the identifiers of its known vulnerabilities."""
    queries = [
        {'package': {'name': name, 'ecosystem': 'PyPI'}, 'version': version}
        for name, version in packages
    ]
    request = urllib.request.Request(
        DATABASE, json.dumps({'queries': queries}).encode(), {'Content-Type': 'application/json'}
    )
    with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
        results = json.load(answer)['results']
    return [[one['id'] for one in result.get('vulns', [])] for result in results]


def main() -> None:
    packages = pinned()
    try:
        found = known(packages)
    except (urllib.error.URLError, TimeoutError) as error:
        print(f'audit: not done, {DATABASE} cannot be reached ({error})')
        return
    for (name, version), identifiers in zip(packages, found, strict=True):
        if identifiers:
            print(f'audit: {name} {version}: {", ".join(identifiers)}')
    print(f'audit: {len(packages)} packages, {sum(map(bool, found))} with known vulnerabilities')


if __name__ == '__main__':
    main()
