# SPDX-License-Identifier: Apache-2.0
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from calib_model.command_line import CommandParser, number_from, run_command, whole_from
from calib_model.errors import CalibrationError
from calib_model.starting import ENDING


def raising(error: BaseException) -> int:
    def work() -> None:
        raise error

    return run_command(work)


def ended(code: str, within: float) -> tuple[int, bytes, bytes]:
    """The exit code of a program, and what it printed, at most `within` s after its start."""
    words = [sys.executable, '-c', code]
    ran = subprocess.run(words, capture_output=True, timeout=within, check=False)
    return ran.returncode, ran.stdout, ran.stderr


def test_an_error_is_one_line_and_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert raising(CalibrationError('bag.mcap: damaged\n  somewhere')) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ('', 'bag.mcap: damaged somewhere\n')


def test_ctrl_c_is_130_and_a_bug_is_not_hidden() -> None:
    assert raising(KeyboardInterrupt()) == 130
    with pytest.raises(ZeroDivisionError):
        raising(ZeroDivisionError())


@pytest.mark.parametrize(
    ('number', 'begin'), [('SIGINT', True), ('SIGTERM', True), ('SIGTERM', False)]
)
def test_a_signal_while_handlers_are_set_ends_with_130(number: str, begin: bool) -> None:
    """Python looks for signals in each `signal.signal`; with `begin` as a program of ours."""
    code = f"""
import os, signal, sys
from calib_model import command_line, starting
usual = signal.signal
def then_it_comes(one, handler):
    usual(one, handler)
    if one == signal.{number} and callable(handler):
        os.kill(os.getpid(), one)
signal.signal = then_it_comes
starting._Program.code = 130 if {begin} else None
sys.exit(command_line.run_command(lambda: print('never')))
"""
    assert ended(code, within=30) == (130, b'', b'')


def test_an_interrupt_that_became_another_exception_on_its_way_is_130() -> None:
    """As up to Python 3.11 of a class that is being made while the signal comes."""
    code = """
import os, signal, sys
from calib_model.command_line import run_command
def work():
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        signal.pause()
    except KeyboardInterrupt as told:
        raise RuntimeError('Error calling __set_name__') from told
sys.exit(run_command(work))
"""
    ran = subprocess.run([sys.executable, '-c', code], capture_output=True, timeout=30, check=False)
    assert (ran.returncode, ran.stderr) == (130, b'')


def test_an_interrupt_that_a_callback_swallows_comes_again() -> None:
    code = """
import os, signal, sys, time, weakref
from calib_model.command_line import run_command
class Lock: pass
def work():
    lock = Lock()
    told = weakref.ref(lock, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    del lock
    time.sleep(20)
    print('never')
sys.exit(run_command(work))
"""
    assert ended(code, within=15) == (130, b'', b'')


def test_an_interrupt_comes_again_until_it_is_heard() -> None:
    """The first to come again is lost, as one is that comes just before a call that waits."""
    code = """
import os, signal, sys, time, weakref
from calib_model.command_line import run_command
class Lock: pass
def work():
    lock = Lock()
    told = weakref.ref(lock, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])
    del lock
    signal.sigwait([signal.SIGALRM])
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGALRM])
    time.sleep(20)
    print('never')
sys.exit(run_command(work))
"""
    assert ended(code, within=15) == (130, b'', b'')


def test_an_interrupt_that_a_library_prints_comes_again() -> None:
    """As C does that imports by itself, and prints what comes of it."""
    code = """
import ctypes, sys, time
from calib_model.command_line import run_command
def work():
    ctypes.pythonapi.PyRun_SimpleString(b'import os; os.kill(os.getpid(), 15); print(end="")')
    time.sleep(20)
    print('never')
sys.exit(run_command(work))
"""
    assert ended(code, within=15) == (130, b'', b'')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_waits_until_an_extension_module_is_loaded(number: int) -> None:
    """One that is written in C++ and makes Python's enums as it is loaded."""
    pytest.importorskip('ruckig')
    code = f"""
import enum, os, signal, sys, time
from calib_model.command_line import run_command
made = enum.EnumMeta.__call__
def told_meanwhile(*arguments, **options):
    if 'module' in options or len(arguments) > 2:
        print('made', flush=True)
        os.kill(os.getpid(), {int(number)})
    return made(*arguments, **options)
def work():
    signal.signal({int(number)}, signal.getsignal(signal.SIGTERM))
    enum.EnumMeta.__call__ = told_meanwhile
    import ruckig
    print('loaded', flush=True)
    time.sleep(20)
    print('never')
sys.exit(run_command(work))
"""
    ran = subprocess.run([sys.executable, '-c', code], capture_output=True, timeout=15, check=False)
    said = ran.stdout.decode().split()
    assert (ran.returncode, ran.stderr) == (130, b'')
    assert said[0] == 'made'
    assert 'never' not in said


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


@pytest.mark.system
def test_a_reader_that_goes_away_is_no_error() -> None:
    code = (
        'import sys; from calib_model.command_line import run_command\n'
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


@pytest.mark.system
@pytest.mark.parametrize('error', [OSError(28, 'No space left on device'), MemoryError('of 9 GiB')])
def test_what_the_machine_refuses_is_one_line_too(
    error: Exception,
) -> None:
    code = (
        'import sys; from calib_model.command_line import run_command\n'
        f'def work(): print("half"); raise {type(error).__name__}{error.args}\n'
        'sys.exit(run_command(work))'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.count('\n')) == (2, 1)
    assert str(error.args[-1]) in done.stderr


@pytest.mark.system
def test_a_full_disk_behind_the_output_is_one_line() -> None:
    code = (
        'import sys; from calib_model.command_line import run_command\n'
        'sys.exit(run_command(lambda: print("figures")))'
    )
    with open('/dev/full', 'w') as full:
        done = subprocess.run(
            [sys.executable, '-c', code],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == 'output: No space left on device\n'


@pytest.mark.system
def test_a_name_that_is_no_text_is_printed_all_the_same() -> None:
    code = (
        'import sys; from calib_model.command_line import run_command\n'
        'sys.exit(run_command(lambda: print(sys.argv[1])))'
    )
    done = subprocess.run([sys.executable, '-c', code, b'a\xff'], capture_output=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, b'a\\udcff\n', b'')


@pytest.mark.parametrize(
    ('word', 'said'),
    [
        ('--share=2', "expected a number from 0 to 1, got '2'"),
        ('--share=nan', "expected a number from 0 to 1, got 'nan'"),
        ('--count=1.5', "expected a whole number from 1 to 9, got '1.5'"),
        ('--count=10', "expected a whole number from 1 to 9, got '10'"),
        ('--count=--', "--count: expected a value, got '--'"),
    ],
)
def test_numbers_out_of_range_name_their_option(
    word: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = CommandParser('measure', 'About.', 'example: measure')
    parser.add_argument('--share', type=number_from(0, 1))
    parser.add_argument('--count', type=whole_from(1, 9))
    assert run_command(lambda: parser.parse_args([word]) and None) == 2
    err = capsys.readouterr().err
    assert said in err and err.count('\n') == 1
    assert parser.parse_args(['--share', '0.5', '--count', '9']).count == 9


@pytest.mark.parametrize('number', ENDING, ids=lambda number: number.name)
@pytest.mark.parametrize(('room', 'code'), [('nodes', 0), ('commands', 130)])
def test_what_is_told_to_end_before_it_minds_signals_ends_as_its_room_says(
    room: str, code: int, number: signal.Signals, tmp_path: Path
) -> None:
    folder = tmp_path / 'rover' / room
    folder.mkdir(parents=True)
    (folder / '__init__.py').write_text(
        f'from calib_model.starting import begin\nbegin(__name__, {code})\n'
    )
    (folder / 'drive.py').write_text(f"""
import os, signal, sys, time
from calib_model.command_line import run_command
def work():
    os.kill(os.getpid(), {int(number)})
    time.sleep(10)
sys.exit(run_command(work))
""")
    words = [sys.executable, '-m', f'rover.{room}.drive']
    ran = subprocess.run(
        words,
        cwd=tmp_path,
        capture_output=True,
        timeout=30,
        check=False,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),  # nohup has it ignored
    )
    assert (ran.returncode, ran.stdout, ran.stderr) == (code, b'', b'')
