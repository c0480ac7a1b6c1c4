# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import subprocess
import sys

import pytest

from calib_model.files.folder_lock import FolderLock

HOLD = """
import sys
from calib_model.files import FolderLock
lock = FolderLock(sys.argv[1])
print(lock.take(), flush=True)
sys.stdin.read()
"""


@pytest.mark.system
def test_a_folder_is_one_writers_until_it_lets_go_or_dies(tmp_path):
    first, second = FolderLock(tmp_path), FolderLock(tmp_path)
    assert first.take()
    assert not second.take()
    first.release()
    first.release()
    assert second.take()
    second.release()
    holder = subprocess.Popen(
        [sys.executable, '-c', HOLD, str(tmp_path)],
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert holder.stdout.readline() == 'True\n'
    assert not first.take()
    holder.kill()
    holder.communicate()
    assert first.take()
    first.release()
