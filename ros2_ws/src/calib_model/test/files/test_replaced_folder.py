# SPDX-License-Identifier: Apache-2.0
"""A set of files is replaced in one step, whenever the process is killed; folders appear whole."""

import fcntl
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from calib_model.files import made_whole, replace_set
from calib_model.files.replaced_folder import _exchange

KNOWN = ('a.yaml', 'b.json', 'c.urdf')
OLD = {'a.yaml': b'old a', 'c.urdf': b'old c'}
NEW = {'a.yaml': b'new a', 'b.json': b'new b'}

# forks for each moment from a process without threads; a moment is a call that Python audits
KILLER = """
import json, os, signal, sys
from pathlib import Path
from calib_model.files import refuse_unwritable, replace_set
root, shape = Path(sys.argv[1]), sys.argv[2]
OLD, NEW, KNOWN = json.loads(sys.argv[3])
encoded = lambda texts: {name: text.encode() for name, text in texts.items()}
replace_set(root / 'warm', encoded(OLD), KNOWN)
replace_set(root / 'warm', encoded(NEW), KNOWN)

def killed_at(moment, place):
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1] != 0
    left = moment
    def count(event, args):
        nonlocal left
        left -= event.split('.')[0] in ('os', 'open', 'fcntl', 'ctypes', 'shutil')
        if left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
    sys.addaudithook(count)
    refuse_unwritable(place, KNOWN)
    replace_set(place, encoded(NEW), KNOWN)
    os._exit(0)

for moment in range(1000):
    place = root / f'at{moment}' / 'X'
    place.parent.mkdir()
    if shape != 'none':
        replace_set(place, encoded(OLD), KNOWN)
        (place / 'own.txt').write_text('mine')
    if not killed_at(moment, place):
        break
print(moment)
"""


def content(folder):
    return {each.name: each.read_bytes() for each in folder.iterdir() if each.is_file()}


def exchanges(folder):
    (folder / '1').mkdir()
    (folder / '2').mkdir()
    above = os.open(folder, os.O_RDONLY)
    try:
        return _exchange(above, '1', '2')
    finally:
        os.close(above)


@pytest.mark.parametrize('shape', ['none', 'old'])
def test_a_kill_at_any_moment_leaves_the_old_set_or_the_new_and_the_next_writer_cleans_up(
    tmp_path, shape
):
    if not exchanges(tmp_path):
        pytest.skip('this file system knows no exchange')
    texts = [{name: text.decode() for name, text in each.items()} for each in (OLD, NEW)]
    told = subprocess.run(
        [sys.executable, '-c', KILLER, str(tmp_path), shape, json.dumps([*texts, KNOWN])],
        capture_output=True,
        text=True,
        check=True,
    )
    moments = int(told.stdout)
    assert moments > 10
    own = {'own.txt': b'mine'} if shape == 'old' else {}
    seen = []
    for moment in range(moments):
        place = tmp_path / f'at{moment}' / 'X'
        there = content(place) if place.exists() else {}
        seen.append('new' if there == NEW | own else 'old')
        assert there in (NEW | own, OLD | own if own else {}), moment
        replace_set(place, NEW, KNOWN)
        assert content(place) == NEW | own
        assert os.listdir(place.parent) == ['X'], moment
    assert seen == sorted(seen, reverse=True)
    assert shape == 'none' or 'new' in seen


def test_what_is_not_of_the_set_stays_and_what_is_of_the_old_one_goes(tmp_path):
    place = tmp_path / 'X'
    replace_set(place, OLD, KNOWN)
    place.chmod(0o750)
    (place / 'notes.txt').write_text('mine')
    (place / 'link').symlink_to('nowhere')
    (place / '.a.yaml.1-1.part').write_text('of a dead one')
    replace_set(place, NEW, KNOWN)
    assert content(place) == NEW | {'notes.txt': b'mine'}
    assert (place / 'link').is_symlink() and place.stat().st_mode & 0o777 == 0o750
    assert sorted(os.listdir(place)) == ['a.yaml', 'b.json', 'link', 'notes.txt']


@pytest.mark.parametrize('why', ['a folder in it', 'our working folder', 'a link to it'])
def test_a_folder_that_cannot_be_exchanged_stays_the_one_it_is(tmp_path, monkeypatch, why):
    place = tmp_path / 'X'
    replace_set(place, OLD, KNOWN)
    (place / '.a.yaml.1-1.part').write_text('of a dead one')
    named = place
    if why == 'a folder in it':
        (place / 'figures').mkdir()
    elif why == 'our working folder':
        monkeypatch.chdir(place)
        named = Path()
    else:
        named = tmp_path / 'link'
        named.symlink_to(place)
    before = place.stat().st_ino
    replace_set(named, NEW, KNOWN)
    assert content(place) == NEW
    assert why == 'a link to it' or place.stat().st_ino == before
    assert sorted(os.listdir(tmp_path)) == (['X', 'link'] if 'link' in why else ['X'])


@pytest.mark.parametrize('name', ['a.yaml', 'c.urdf'])
def test_a_folder_that_has_a_file_s_name_is_refused_and_nothing_changes(tmp_path, name):
    place = tmp_path / 'X'
    place.mkdir()
    (place / 'b.json').write_bytes(b'old b')
    (place / name).mkdir()
    with pytest.raises(OSError):
        replace_set(place, NEW, KNOWN)
    assert content(place) == {'b.json': b'old b'} and (place / name).is_dir()
    assert os.listdir(tmp_path) == ['X']


def test_a_folder_is_made_whole_or_not_at_all(tmp_path):
    with made_whole(tmp_path / 'sub' / 'bag') as place:
        place.mkdir()
        (place / 'file').write_text('')
        assert not (tmp_path / 'sub' / 'bag').exists()
    assert os.listdir(tmp_path / 'sub') == ['bag']
    with pytest.raises(KeyboardInterrupt), made_whole(tmp_path / 'other') as place:
        place.mkdir()
        raise KeyboardInterrupt
    assert os.listdir(tmp_path) == ['sub']


def test_what_a_killed_maker_left_is_removed_and_what_one_at_work_has_is_not(tmp_path):
    (tmp_path / '.bag.999999-999999.part' / 'bag').mkdir(parents=True)
    at_work = tmp_path / '.bag.999999-2.part'
    for mine in (at_work, tmp_path / '.bag.of mine.part'):
        mine.mkdir()
    held = os.open(at_work, os.O_RDONLY)
    fcntl.flock(held, fcntl.LOCK_EX)
    with made_whole(tmp_path / 'bag') as place:
        place.mkdir()
    os.close(held)
    assert sorted(os.listdir(tmp_path)) == ['.bag.999999-2.part', '.bag.of mine.part', 'bag']
