# SPDX-License-Identifier: Apache-2.0
"""New joint origins in a URDF's own text: every other byte of the file stays as it is."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from xml.parsers import expat

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DescriptionError
from calib_model.urdf.export_arm import number_text, rpy

DUST = 1e-15  # m and rad: left by rounding
QUOTED = rb'"[^"]*"|\'[^\']*\''
TAG = re.compile(rb'<[^\s/>]+(?:[^"\'>]|' + QUOTED + rb')*>')


@dataclass
class _Place:
    """Where a joint's start tag begins and, when it has one, its first origin's."""

    joint: int
    origin: int | None = None


def with_origins(text: bytes, origins: Mapping[str, Array], source: str = 'URDF') -> bytes:
    """The same URDF with other origins (4, 4) of the joints named, m.

    Only the values of `xyz` and `rpy` change; a joint without an origin gets one.

    Raises:
        DescriptionError: not XML of one byte per sign, or there is no such joint.
    """
    places = _places(text, source)
    edits: list[tuple[int, int, bytes]] = []
    for name, origin in origins.items():
        if name not in places:
            raise DescriptionError(source, '', f'no joint {name!r} to correct')
        edits.append(_edit(text, places[name], origin))
    for begin, end, new in sorted(edits, reverse=True):
        text = text[:begin] + new + text[end:]
    return text


def _places(text: bytes, source: str) -> dict[str, _Place]:
    """Byte offsets by joint name."""
    if b'\0' in text:
        raise DescriptionError(source, '', 'expected UTF-8 or Latin-1, not UTF-16')
    found: dict[str, _Place] = {}
    path: list[str] = []
    joint = ''

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal joint
        path.append(tag)
        if path == ['robot', 'joint']:
            joint = attributes.get('name', '')
            found.setdefault(joint, _Place(parser.CurrentByteIndex))
        elif path == ['robot', 'joint', 'origin'] and found[joint].origin is None:
            found[joint].origin = parser.CurrentByteIndex

    def end(_: str) -> None:
        path.pop()

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(text, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise DescriptionError(source, '', f'not XML: {error}') from error
    return found


def _edit(text: bytes, place: _Place, origin: Array) -> tuple[int, int, bytes]:
    """What to put in place of text[begin:end]."""
    parts = (origin[:3, 3], rpy(origin[:3, :3]))
    xyz, turn = (number_text(np.where(np.abs(part) < DUST, 0.0, part)).encode() for part in parts)
    if place.origin is None:
        begin = place.joint + len(_tag(text, place.joint))
        space = re.compile(rb'\s*').match(text, begin)
        gap = space.group() if space else b''
        return begin, begin, gap + b'<origin xyz="' + xyz + b'" rpy="' + turn + b'"/>'
    tag = _tag(text, place.origin)
    new = _with_attribute(_with_attribute(tag, b'rpy', turn), b'xyz', xyz)
    return place.origin, place.origin + len(tag), new


def _tag(text: bytes, begin: int) -> bytes:
    found = TAG.match(text, begin)
    return found.group() if found else b''


def _with_attribute(tag: bytes, name: bytes, value: bytes) -> bytes:
    found = re.search(rb'\s' + name + rb'\s*=\s*(' + QUOTED + rb')', tag)
    if found is None:
        opened = tag.index(b'origin') + len(b'origin')
        return tag[:opened] + b' ' + name + b'="' + value + b'"' + tag[opened:]
    quote = found.group(1)[:1]
    return tag[: found.start(1)] + quote + value + quote + tag[found.end(1) :]
