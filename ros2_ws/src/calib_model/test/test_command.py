# SPDX-License-Identifier: Apache-2.0
import subprocess
import sys

import pytest

from calib_model.command import CommandParser, run_command
from calib_model.errors import CalibrationError


def raising(error: BaseException) -> int:
    def work() -> None:
        raise error

    return run_command(work)


def test_an_error_is_one_line_and_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert raising(CalibrationError('bag.mcap: damaged\n  somewhere')) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ('', 'bag.mcap: damaged somewhere\n')


def test_ctrl_c_is_130_and_a_bug_is_not_hidden() -> None:
    assert raising(KeyboardInterrupt()) == 130
    with pytest.raises(ZeroDivisionError):
        raising(ZeroDivisionError())


def test_the_work_decides_the_code_otherwise() -> None:
    assert run_command(lambda: None) == 0
    assert run_command(lambda: 3) == 3


def test_wrong_arguments_are_one_line_too(capsys: pytest.CaptureFixture[str]) -> None:
    parser = CommandParser('measure', 'About.', 'example: measure')
    parser.add_argument('bag')
    assert run_command(lambda: parser.parse_args([]) and None) == 2
    assert capsys.readouterr().err.count('\n') == 1
    assert run_command(lambda: parser.parse_args(['a', '--what']) and None) == 2
    assert 'unrecognized arguments: --what' in capsys.readouterr().err


def test_a_reader_that_goes_away_is_no_error() -> None:
    code = (
        'import sys; from calib_model.command import run_command\n'
        'def work():\n    for i in range(100000): print(i)\n'
        'sys.exit(run_command(work))'
    )
    command = subprocess.Popen(
        [sys.executable, '-c', code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert command.stdout is not None
    command.stdout.readline()
    command.stdout.close()
    assert command.wait(timeout=30) == 0
    assert command.stderr is not None
    with command.stderr:
        assert command.stderr.read() == b''
