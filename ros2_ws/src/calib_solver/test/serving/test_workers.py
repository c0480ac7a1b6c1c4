# SPDX-License-Identifier: Apache-2.0
"""Requests in processes of their own: bounded in number, time and memory, ended when told to."""

from __future__ import annotations

import os
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

from calib_model.errors import CalibrationError, DataError
from calib_model.files import Folders
from calib_solver.serving import Opened, Workers, workers

pytestmark = [pytest.mark.system, pytest.mark.timeout(60)]
EVERYTHING = Folders('any', ('/',))
OPENED = Opened(EVERYTHING, EVERYTHING, ())


def tell(request, opened):
    return {'told': request.told, 'process': os.getpid()}


def hang(request, opened):
    """Deaf to all but SIGKILL where `deaf`; says so in a file."""
    path = Path(request.path)
    try:
        path.write_text(str(os.getpid()))
        while True:
            try:
                time.sleep(60)
            except KeyboardInterrupt:
                if not request.deaf:
                    raise
    finally:
        path.unlink()


def fail(request, opened):
    raise DataError('row 7 is wrong')


def die(request, opened):
    os._exit(9)


def crash(request, opened):
    raise RuntimeError('a bug')


def swell(request, opened):
    return {'long': len(bytearray(3 << 30))}


@pytest.fixture(scope='module')
def workers_of_one_server():
    one = Workers()
    yield one
    one.close()


@pytest.fixture
def run(workers_of_one_server):
    def given(work, limit=0.0, **request):
        return workers_of_one_server.run(work, request, OPENED, limit)

    return given


@pytest.fixture
def begun(run, tmp_path):
    """Begins work that never ends, and returns its future once it is under way, and its file."""
    with ThreadPoolExecutor(32) as pool:

        def begin(name: str, deaf: bool = False, limit: float = 0.0) -> tuple[Future, Path]:
            path = tmp_path / name
            future = pool.submit(run, hang, limit, path=str(path), deaf=deaf)
            return future, path

        yield begin


def until(done, seconds=20.0):
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_work_is_done_in_another_process_and_its_errors_come_back(run):
    answer = run(tell, told=[1.5, 'x'])
    assert answer['told'] == [1.5, 'x'] and answer['process'] != os.getpid()
    with pytest.raises(CalibrationError, match='^row 7 is wrong$'):
        run(fail)


@pytest.mark.parametrize(
    ('work', 'said'), [(die, 'exit code 9'), (crash, 'exit code 1'), (swell, 'not enough memory')]
)
def test_a_worker_that_dies_or_swells_is_one_line(run, work, said):
    with pytest.raises(CalibrationError, match=said):
        run(work)
    assert run(tell, told=1)['told'] == 1


@pytest.mark.parametrize('deaf', [False, True])
def test_cancel_ends_work_and_says_so(run, begun, workers_of_one_server, deaf):
    future, path = begun('one', deaf)
    until(path.exists)
    pid = path.read_text
    until(pid)
    number = int(pid())
    assert workers_of_one_server.cancel() == 1
    with pytest.raises(CalibrationError, match='^cancelled: '):
        future.result(20)
    assert not Path(f'/proc/{number}').exists()
    assert path.exists() == deaf  # what could take down what it had begun has done so
    assert workers_of_one_server.cancel() == 0
    assert workers_of_one_server.idle()


def test_a_time_limit_ends_what_takes_longer_and_nothing_else(run, begun):
    future, _ = begun('late', limit=0.7)
    with pytest.raises(CalibrationError, match=r'^time_limit: ended after 0\.7 s'):
        future.result(20)
    for never in (0.0, -1.0, float('nan'), float('inf'), 1e300):
        assert run(tell, never, told=2)['told'] == 2


def test_requests_wait_for_their_turn_and_too_many_are_refused(
    run, begun, workers_of_one_server, monkeypatch
):
    monkeypatch.setattr(workers, 'AT_ONCE', 2)
    monkeypatch.setattr(workers, 'WAITING', 1)
    going = [begun(f'{number}') for number in range(2)]
    until(lambda: all(path.exists() for _, path in going))
    third, path = begun('third')
    until(lambda: len(workers_of_one_server._jobs) == 3)
    with pytest.raises(CalibrationError, match='^busy: 2 requests are under way and 1 wait'):
        run(tell, told=3)
    assert not path.exists()
    workers_of_one_server.cancel()
    for future in (*(future for future, _ in going), third):
        with pytest.raises(CalibrationError, match='^cancelled'):
            future.result(20)
    assert run(tell, told=4)['told'] == 4


def test_identifications_leave_room_for_others(workers_of_one_server, tmp_path, monkeypatch):
    monkeypatch.setattr(workers, 'LONG', 1)
    paths = [tmp_path / 'first', tmp_path / 'second']
    threads = []
    for path in paths:
        request = {'path': str(path), 'deaf': False}

        def ask(request=request):
            with pytest.raises(CalibrationError, match='^cancelled'):
                workers_of_one_server.run(hang, request, OPENED, long=True)

        threads.append(threading.Thread(target=ask))
        threads[-1].start()
        until(lambda: len(workers_of_one_server._jobs) == len(threads))
    until(paths[0].exists)
    short = workers_of_one_server.run(tell, {'told': 5}, OPENED)
    assert short['told'] == 5 and not paths[1].exists()
    workers_of_one_server.cancel()
    for thread in threads:
        thread.join(20)
