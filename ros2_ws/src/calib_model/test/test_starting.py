# SPDX-License-Identifier: Apache-2.0
import subprocess
import sys
import threading

import pytest

from calib_model.starting import held_back, interrupt


def test_an_interrupt_waits_for_the_end_of_all_that_is_held_back() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), held_back():
        with held_back():
            interrupt()
            done.append('inner')
        done.append('outer')
    assert done == ['inner', 'outer']
    with pytest.raises(KeyboardInterrupt):
        interrupt()
    with held_back():  # nothing is left of it
        pass


def test_other_threads_hold_nothing_back() -> None:
    inside, over = threading.Event(), threading.Event()

    def work() -> None:
        with held_back():
            inside.set()
            over.wait(10)

    thread = threading.Thread(target=work)
    thread.start()
    inside.wait(10)
    with pytest.raises(KeyboardInterrupt):
        interrupt()
    over.set()
    thread.join()


@pytest.mark.timeout(60)
def test_a_signal_while_a_folder_takes_the_place_of_another_leaves_nothing_beside_it(tmp_path):
    """It comes when the old one already has the working folder's name."""
    code = """
import os, signal, sys
from calib_model.command_line import run_command
from calib_model.files import replaced_folder
retire = replaced_folder._retire
def late(*folders):
    os.kill(os.getpid(), signal.SIGTERM)
    retire(*folders)
replaced_folder._retire = late
def work():
    replaced_folder.replace_set('result', {'one': b'1'}, ())
    replaced_folder.replace_set('result', {'one': b'2'}, ())
    print('never')
sys.exit(run_command(work))
"""
    ran = subprocess.run(
        [sys.executable, '-c', code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stdout, ran.stderr) == (130, '', '')
    assert [path.name for path in tmp_path.iterdir()] == ['result']
    assert (tmp_path / 'result' / 'one').read_bytes() == b'2'
