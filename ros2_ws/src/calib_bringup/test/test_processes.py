# SPDX-License-Identifier: Apache-2.0
import os
import signal
import subprocess
import sys
import time

import pytest

from calib_bringup.demo import replaceable, run
from calib_bringup.processes import Child, ChildError, Children, graph_environment
from calib_model.command_line import UsageError

pytestmark = [pytest.mark.system, pytest.mark.timeout(60)]

DEAF = 'import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\ntime.sleep(60)\n'
ROOM = 'calib_told.commands'
TOLD = """
import os, shutil, sys, time
from pathlib import Path
from calib_bringup.processes import Child, Children
from calib_model.command_line import run_command

def work():
    part = Path('part').absolute()
    part.mkdir()
    try:
        with Children() as children:
            children.start(Child('deaf', 'deaf', [], dict(os.environ), part / 'deaf.log'))
            print('started', flush=True)
            time.sleep(60)
    finally:
        shutil.rmtree(part)

sys.exit(run_command(work))
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Makes a Python module of some lines that a child can run."""
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)

    def make(name, text):
        (tmp_path / f'{name}.py').write_text(text)
        return Child(name, name, [], dict(os.environ), tmp_path / f'{name}.log')

    return make


def test_children_end_with_the_block_even_deaf_ones(module, monkeypatch):
    monkeypatch.setattr('calib_bringup.processes.PATIENCE', 0.5)
    with Children() as children:
        sleeper = children.start(module('sleeper', 'import time; time.sleep(60)'))
        stubborn = children.start(module('stubborn', DEAF))
        time.sleep(0.5)
    assert sleeper.process.returncode == -signal.SIGTERM
    assert stubborn.process.returncode == -signal.SIGKILL


def test_a_command_with_a_deaf_child_is_told_to_end_and_tidies_up_first(tmp_path):
    """Before it is ended for good, wherever it is then."""
    (tmp_path / 'deaf.py').write_text(DEAF)
    folder = tmp_path / 'calib_told' / 'commands'
    folder.mkdir(parents=True)
    (folder / '__init__.py').write_text(
        f'from calib_model.starting import begin\nbegin({ROOM!r})\n'
    )
    (folder / 'told.py').write_text(TOLD)
    env = {**os.environ, 'PYTHONPATH': os.pathsep.join([str(tmp_path), *sys.path])}
    words = [sys.executable, '-m', f'{ROOM}.told']
    with subprocess.Popen(words, cwd=tmp_path, env=env, stdout=subprocess.PIPE) as told:
        assert told.stdout.readline() == b'started\n'
        time.sleep(0.5)
        told.send_signal(signal.SIGTERM)
        assert told.wait(10) == 130
    assert not (tmp_path / 'part').exists()


def test_children_end_when_the_block_is_left_by_an_error(module):
    with pytest.raises(ZeroDivisionError), Children() as children:
        sleeper = children.start(module('sleeper', 'import time; time.sleep(60)'))
        raise ZeroDivisionError
    assert sleeper.process.returncode is not None


def test_a_failing_child_s_own_line_is_passed_on(module):
    with Children() as children:
        text = "import sys; print('first', flush=True); sys.exit('bag: no such bag')"
        child = children.start(module('solver', text))
        with pytest.raises(ChildError, match='^solver: bag: no such bag$'):
            children.wait(child, 20)


def test_a_child_that_dies_silently_is_named(module):
    with Children() as children:
        child = children.start(module('solver', 'import sys; sys.exit(3)'))
        with pytest.raises(ChildError, match='^solver ended with 3$'):
            children.wait(child, 20)


def test_waiting_for_one_notices_the_death_of_another(module):
    with Children() as children:
        children.start(module('arm', "import sys; sys.exit('arm.yaml: missing')"))
        capture = children.start(module('capture', 'import time; time.sleep(60)'))
        with pytest.raises(ChildError, match='^arm: arm.yaml: missing$'):
            children.wait(capture, 20)


def test_waiting_has_an_end(module):
    with Children() as children:
        child = children.start(module('slow', 'import time; time.sleep(60)'))
        with pytest.raises(ChildError, match='slow is not done after 0 s'):
            children.wait(child, 0.1)


def test_a_graph_of_its_own_stays_on_this_machine():
    environment = graph_environment(17)
    assert environment['ROS_DOMAIN_ID'] == '17'
    assert environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'


def test_only_nothing_and_an_earlier_demo_s_folder_are_replaced(tmp_path):
    assert replaceable(tmp_path / 'new')
    assert replaceable(tmp_path)
    (tmp_path / 'thesis.txt').write_text('')
    assert not replaceable(tmp_path)
    assert not replaceable(tmp_path / 'thesis.txt')
    (tmp_path / 'thesis.txt').rename(tmp_path / 'result.json')
    assert not replaceable(tmp_path)  # somebody's identification, not a demo
    for name in ('identification', 'held_out'):
        (tmp_path / name).mkdir()
    assert replaceable(tmp_path)
    (tmp_path / 'notes.txt').write_text('')
    assert not replaceable(tmp_path)


@pytest.mark.parametrize('words', [['--seed', '-1'], ['--poses', '1'], ['--poses', 'many']])
def test_bad_arguments_are_refused_before_anything_is_started(tmp_path, words):
    with pytest.raises(UsageError, match=words[0]):
        run([*words, '--output', str(tmp_path / 'out')])
    assert not list(tmp_path.iterdir())
