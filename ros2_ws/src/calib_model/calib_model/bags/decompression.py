# SPDX-License-Identifier: Apache-2.0
"""Unpacking what a bag compressed, within bounds: a few kilobytes can stand for terabytes."""

from __future__ import annotations

import zlib

import zstandard
from mcap.records import Chunk

#: bytes of one record, packed or unpacked; recorders begin a new chunk after a few megabytes
LARGEST_RECORD = 1 << 28
STEP = 1 << 10  # bytes, that can be 30 MB unpacked


def unpacked_zstd(data: bytes) -> bytes:
    """What a zstd frame holds.

    Raises:
        ValueError: more than `LARGEST_RECORD` bytes.
        zstandard.ZstdError: damaged.
    """
    said = zstandard.frame_content_size(data)  # -1 where it does not say
    _refuse_more(said)
    if said >= 0:
        return zstandard.ZstdDecompressor().decompress(data)
    unpacking = zstandard.ZstdDecompressor().decompressobj()
    parts, size = [], 0
    for begin in range(0, len(data), STEP):
        parts.append(unpacking.decompress(data[begin : begin + STEP]))
        size += len(parts[-1])
        _refuse_more(size)
        if unpacking.eof:
            return b''.join(parts)
    raise ValueError('a zstd frame that is cut short')


def chunk_content(chunk: Chunk) -> bytes:
    """The records of a chunk as bytes, held against its checksum.

    Raises:
        ValueError: more than `LARGEST_RECORD` bytes, of an unknown compression, or damaged.
        RuntimeError, zstandard.ZstdError: damaged.
    """
    _refuse_more(chunk.uncompressed_size)
    if chunk.compression == 'zstd':
        content = unpacked_zstd(chunk.data)
    elif chunk.compression == 'lz4':
        content = _unpacked_lz4(chunk.data)
    elif chunk.compression == '':
        content = chunk.data
    else:
        raise ValueError(f'a chunk is compressed as {chunk.compression!r}')
    if chunk.uncompressed_crc not in (0, zlib.crc32(content)):
        raise ValueError('a chunk does not have its checksum')
    return content


def _unpacked_lz4(data: bytes) -> bytes:
    try:
        from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]
    except ImportError as error:
        raise ValueError('compressed with LZ4, and python3-lz4 is not installed') from error
    unpacking = LZ4FrameDecompressor()
    content: bytes = unpacking.decompress(data, LARGEST_RECORD)
    if not unpacking.eof:
        raise ValueError('an LZ4 chunk that is cut short, or larger than it may be')
    return content


def _refuse_more(size: int) -> None:
    if size > LARGEST_RECORD:
        raise ValueError(f'unpacked, a record has {size} bytes: {LARGEST_RECORD} at most')
