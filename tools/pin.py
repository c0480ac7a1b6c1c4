# SPDX-License-Identifier: Apache-2.0
"""Pin requirements*.in for all supported interpreters at once.

Usage: python tools/pin.py PYTHON3.10 PYTHON3.11 PYTHON3.12 PYTHON3.13

The oldest interpreter chooses the versions, the others have to live with them: a package that
dropped 3.10 is pinned to the last release with wheels for all. What only some interpreters need
gets a marker. Each line carries the SHA-256 of the files that may be installed for it, so pip
refuses anything else.
"""

import json
import subprocess
import sys
import tempfile
import urllib.request
from pathlib import Path

from packaging.tags import Tag, compatible_tags, cpython_tags
from packaging.utils import InvalidWheelFilename, parse_wheel_filename

ROOT = Path(__file__).resolve().parent.parent
HEADER = '# Made by tools/pin.py from {source}; `make` installs it --no-deps, hashes checked.\n'
INDEX = 'https://pypi.org/simple'
SOURCE_ONLY = 'empy'  # rosidl's template engine has no wheels


def resolve(python: str, sources: list[Path], limits: dict[str, str]) -> dict[str, str]:
    """Names and versions pip would install on `python`, within `limits`."""
    with tempfile.TemporaryDirectory() as folder:
        constraints, report = Path(folder, 'limits.txt'), Path(folder, 'report.json')
        constraints.write_text(''.join(f'{n}=={v}\n' for n, v in limits.items()))
        files = [part for source in sources for part in ('-r', str(source))]
        subprocess.run(
            [
                python,
                '-m',
                'pip',
                'install',
                '--dry-run',
                '--quiet',
                '--ignore-installed',
                '--only-binary',
                ':all:',
                '--no-binary',
                SOURCE_ONLY,
                '--report',
                str(report),
                '-c',
                str(constraints),
                *files,
            ],
            check=True,
        )
        installs = json.loads(report.read_text())['install']
    return {i['metadata']['name'].lower(): i['metadata']['version'] for i in installs}


def minor(python: str) -> str:
    line = 'import sys; print("%d.%d" % sys.version_info[:2])'
    return subprocess.run(
        [python, '-c', line], check=True, capture_output=True, text=True
    ).stdout.strip()


def marked(name: str, by_minor: dict[str, dict[str, str]]) -> str:
    """One requirements line: with a marker where only some interpreters need the package."""
    minors = [m for m, packages in by_minor.items() if name in packages]
    version = by_minor[minors[0]][name]
    if len(minors) == len(by_minor):
        return f'{name}=={version}\n'
    marker = ' or '.join(f"python_version == '{m}'" for m in minors)
    return f'{name}=={version} ; {marker}\n'


def installable(minors: list[str]) -> set[Tag]:
    """Tags of the wheels that those CPythons take on Linux x86_64."""
    platforms = [f'manylinux_2_{n}_x86_64' for n in range(5, 40)]
    platforms += [
        'manylinux2014_x86_64',
        'manylinux2010_x86_64',
        'manylinux1_x86_64',
        'linux_x86_64',
    ]
    tags: set[Tag] = set()
    for text in minors:
        version = tuple(int(part) for part in text.split('.'))
        tags.update(cpython_tags(version, platforms=platforms))
        tags.update(compatible_tags(version, f'cp{version[0]}{version[1]}', platforms))
    return tags


def hashes(name: str, version: str, tags: set[Tag]) -> list[str]:
    """SHA-256 of the files of one release that may be installed, from the index."""
    request = urllib.request.Request(
        f'{INDEX}/{name}/', headers={'Accept': 'application/vnd.pypi.simple.v1+json'}
    )
    with urllib.request.urlopen(request, timeout=60) as answer:
        files = json.load(answer)['files']
    return sorted(f['hashes']['sha256'] for f in files if taken(f['filename'], name, version, tags))


def taken(filename: str, name: str, version: str, tags: set[Tag]) -> bool:
    if name == SOURCE_ONLY:
        return filename == f'{name}-{version}.tar.gz'
    try:
        _, of, _, wheel_tags = parse_wheel_filename(filename)
    except InvalidWheelFilename:
        return False
    return str(of) == version and bool(wheel_tags & tags)


def hashed(line: str, name: str, tags: set[Tag]) -> str:
    """A requirements line with the hashes that pip is to hold the download against."""
    found = hashes(name, line.split('==')[1].split()[0], tags)
    if not found:
        sys.exit(f'{name}: the index lists no file to install for {line.strip()}')
    return ' \\\n'.join([line.rstrip(), *(f'    --hash=sha256:{h}' for h in found)]) + '\n'


def pin(pythons: list[str], sources: list[Path], known: dict[str, str]) -> dict[str, str]:
    """Requirements lines by package name; versions in `known` are kept."""
    limits = resolve(pythons[0], sources, known)
    by_minor = {minor(p): resolve(p, sources, limits) for p in pythons}
    names = sorted({name for packages in by_minor.values() for name in packages})
    return {name: marked(name, by_minor) for name in names}


def main() -> None:
    pythons = sorted(sys.argv[1:], key=lambda p: int(minor(p).split('.')[1]))
    if not pythons:
        sys.exit(__doc__)
    sources = [ROOT / 'requirements.in', ROOT / 'requirements-dev.in']
    run_time = pin(pythons, sources[:1], {})
    known = {name: line.split('==')[1].split()[0] for name, line in run_time.items()}
    everything = pin(pythons, sources, known)
    # A package that only some interpreters need at run time may be needed by all of them here.
    development = {name: line for name, line in everything.items() if line != run_time.get(name)}
    tags = installable([minor(p) for p in pythons])
    for source, lines in zip(sources, (run_time, development), strict=True):
        pinned = (hashed(line, name, tags) for name, line in lines.items())
        source.with_suffix('.txt').write_text(HEADER.format(source=source.name) + ''.join(pinned))


if __name__ == '__main__':
    main()
