# SPDX-License-Identifier: Apache-2.0
"""The records of an MCAP one after the other, bounded in size, and what may follow its end."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.stream_reader import StreamReader

from calib_model.bags.decompression import LARGEST_RECORD
from calib_model.errors import BagError

# what a damaged file makes the reader and its decompressors raise; a wrong size asks for memory
DAMAGE = (
    McapError,
    struct.error,
    ValueError,
    KeyError,
    EOFError,
    OverflowError,
    RuntimeError,
    MemoryError,
    zstandard.ZstdError,
)
MAGIC = b'\x89MCAP0\r\n'


class RecordReader(StreamReader):
    """The library's reader, chunks whole. It passes the indexes by unless they are asked for: a
    third of the time goes into their entries, and the messages are read in order."""

    def __init__(
        self,
        stream: IO[bytes],
        validate_crcs: bool = False,
        skip_magic: bool = False,
        indexes: bool = False,
    ) -> None:
        super().__init__(
            stream,
            skip_magic=skip_magic,
            emit_chunks=True,
            validate_crcs=validate_crcs,
            record_size_limit=LARGEST_RECORD,
        )
        self._indexes = indexes

    def _read_record(self, opcode: int, length: int) -> Any:
        if opcode == Opcode.MESSAGE_INDEX and not self._indexes:
            return None  # what is not read here is passed over, with its part of the checksum
        return super()._read_record(opcode, length)


def another_follows(file: Path, stream: IO[bytes]) -> bool:
    """Whether behind the end of an MCAP there is another one; its first bytes are read then.

    Raises:
        BagError: there is something else.
    """
    begin = stream.read(len(MAGIC))
    if begin not in (b'', MAGIC):
        raise BagError(
            f'{file}: damaged: behind its end there is more, and no MCAP: `recover` leaves it out'
        )
    return bool(begin)
