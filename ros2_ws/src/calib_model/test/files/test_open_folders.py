# SPDX-License-Identifier: Apache-2.0
"""Callers come no further than the folders that were opened to them."""

import os
from threading import Thread

import pytest

from calib_model.files import (
    FolderLock,
    HeldFolder,
    confined,
    file_content,
    is_there,
    open_file,
    refuse_unwritable,
    replace_set,
    write_whole,
)
from calib_model.files.open_folders import Folders, NotPermittedError, usual_reading, usual_writing


@pytest.fixture
def places(tmp_path):
    for name in ('open/bag', 'closed/bag'):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / 'bag_0.mcap').write_bytes(b'')
    return tmp_path


@pytest.fixture
def folders(places):
    return Folders('bag_folders', (str(places / 'open'),))


def refused(folders, path):
    with pytest.raises(NotPermittedError, match=r'outside the folders open to callers .*bag_fold'):
        folders.permit(path)


def test_inside_is_permitted_there_or_not(folders, places):
    folders.permit(places / 'open' / 'bag')
    folders.permit(places / 'open' / 'bag' / 'bag_0.mcap')
    folders.permit(places / 'open' / 'nothing' / 'here')
    folders.permit_all(['', places / 'open'])


@pytest.mark.parametrize(
    'path',
    [
        'closed/bag',
        'open/../closed/bag',
        'open/nothing/../../closed',
        'opened',
        '.',
        '/etc/passwd',
    ],
)
def test_outside_is_refused_however_it_is_written(folders, places, path):
    refused(folders, places / path)
    with pytest.raises(NotPermittedError):
        folders.permit_all([places / 'open', places / path])


def test_a_relative_path_is_one_from_the_working_folder(folders, places, monkeypatch):
    monkeypatch.chdir(places / 'open')
    folders.permit('bag')
    refused(folders, '../closed')


def test_links_count_for_what_they_lead_to(folders, places):
    (places / 'open' / 'way_out').symlink_to(places / 'closed')
    refused(folders, places / 'open' / 'way_out' / 'bag')
    (places / 'closed' / 'way_in').symlink_to(places / 'open')
    folders.permit(places / 'closed' / 'way_in' / 'bag')
    (places / 'open' / 'circle').symlink_to(places / 'open' / 'circle')
    refused(folders, places / 'open' / 'circle')


def test_a_bag_whose_file_is_a_link_elsewhere_is_refused(folders, places):
    (places / 'open' / 'bag' / 'bag_1.mcap').symlink_to(places / 'closed' / 'bag' / 'bag_0.mcap')
    refused(folders, places / 'open' / 'bag')


def test_the_open_folder_itself_is_written_to(folders, places):
    with confined(folders, folders):
        refuse_unwritable(places / 'open' / 'new' / 'result', ('a',))
        refuse_unwritable(places / 'open', ('a',))
        replace_set(places / 'open', {'a': b'a'}, ('b',))
        with pytest.raises(OSError):
            refuse_unwritable(places / 'open', ('bag',))
    assert sorted(os.listdir(places / 'open')) == ['a', 'bag']


def test_what_is_no_path_is_refused_in_one_line(folders):
    refused(folders, 'x' * 5000 + '/..' * 2000 + '/etc')
    refused(folders, '\0')


def test_a_node_opens_its_own_the_temporary_and_for_reading_the_user_s_folder(
    monkeypatch, tmp_path
):
    monkeypatch.setenv('HOME', str(tmp_path / 'home'))
    monkeypatch.setenv('TMPDIR', '/nowhere')
    monkeypatch.chdir(tmp_path)
    Folders('bag_folders', usual_writing()).permit(tmp_path / 'bag')
    assert str(tmp_path / 'home') in usual_reading()
    assert str(tmp_path / 'home') not in usual_writing()


def test_of_a_folder_where_everybody_may_write_what_is_the_users_own_is_open(places, monkeypatch):
    shared = places / 'shared'
    for name in ('own', 'open to all'):
        (shared / name).mkdir(parents=True)
        (shared / name / 'file').write_bytes(b'')
    (shared / 'file').write_bytes(b'')
    (shared / 'open to all').chmod(0o777)
    shared.chmod(0o1777)
    folders = Folders('bag_folders', (str(shared),))
    with confined(folders, folders):
        assert file_content(shared / 'own' / 'file') == file_content(shared / 'file') == b''
        replace_set(shared / 'new', {'a': b'a'}, ())
        refused(folders, shared / 'open to all' / 'file')
    me = os.geteuid()
    monkeypatch.setattr(os, 'geteuid', lambda: me + 1)
    with confined(folders, folders):
        for path in ('own/file', 'file', 'new/a'):
            refused(folders, shared / path)
            with pytest.raises(NotPermittedError):
                file_content(shared / path)
    shared.chmod(0o755)
    folders.permit(shared / 'own' / 'file')


USES = {
    'read a file': lambda path: file_content(path / 'bag_0.mcap'),
    'open a file': lambda path: open_file(path / 'bag_0.mcap').close(),
    'list a folder': lambda path: HeldFolder(path).close(),
    'make a folder': lambda path: HeldFolder(path / 'new', make=True).close(),
    'make one only': lambda path: HeldFolder.new(path / 'new').close(),
    'lock a folder': lambda path: FolderLock(path, writing=True).take(),
    'write a file': lambda path: write_whole(path / 'file', 'text'),
    'replace a set': lambda path: replace_set(path, {'file': b'text'}, ('other',)),
    'ask for a file': lambda path: is_there(path / 'bag_0.mcap'),
}


@pytest.mark.parametrize('use', USES)
def test_a_link_that_is_put_in_place_after_the_check_leads_nowhere(folders, places, use):
    inside = places / 'open' / 'bag'
    folders.permit(inside)
    with confined(folders, folders):
        USES[use](inside)
        before = sorted(places.glob('closed/**'))
        inside.rename(places / 'open' / 'moved')
        inside.symlink_to(places / 'closed' / 'bag')
        with pytest.raises((NotPermittedError, OSError)):
            USES[use](inside)
    assert sorted(places.glob('closed/**')) == before
    assert not os.listdir(places / 'closed' / 'bag')[1:]


def test_a_link_among_the_files_leads_nowhere_and_one_that_stays_inside_is_followed(
    folders, places
):
    out, within = places / 'open' / 'bag' / 'out', places / 'open' / 'within'
    out.symlink_to(places / 'closed' / 'bag' / 'bag_0.mcap')
    within.symlink_to(places / 'open' / 'bag' / 'bag_0.mcap')
    with confined(folders, folders):
        with pytest.raises(NotPermittedError):
            file_content(out)
        assert file_content(within) == b''


def test_what_changes_between_a_look_at_the_path_and_its_use_is_not_followed(folders, places):
    """A thread puts a link in the place of a folder, and back, while files are read and written."""
    inside, moved = places / 'open' / 'bag', places / 'open' / 'moved'
    (places / 'closed' / 'bag' / 'bag_0.mcap').write_bytes(b'secret')
    going = True

    def exchange():
        while going:
            inside.rename(moved)
            inside.symlink_to(places / 'closed' / 'bag')
            inside.unlink()
            moved.rename(inside)

    thread, found = Thread(target=exchange), set()
    thread.start()
    try:
        with confined(folders, folders):
            for _ in range(400):
                for use in (
                    lambda: file_content(inside / 'bag_0.mcap'),
                    lambda: write_whole(inside / 'file', b'text'),
                ):
                    try:
                        found.add(use())
                    except (NotPermittedError, OSError):
                        found.add('refused')
    finally:
        going = False
        thread.join()
    assert found <= {b'', None, 'refused'}
    assert os.listdir(places / 'closed' / 'bag') == ['bag_0.mcap']


@pytest.mark.parametrize('count', [2100, 5000])
def test_no_folder_is_made_deeper_than_its_whole_name_can_be(folders, places, count):
    deep = places / 'open' / ('b/' * count)
    with confined(folders, folders):
        with pytest.raises(OSError, match='File name too long'):
            HeldFolder(deep, make=True)
        with pytest.raises(OSError, match='File name too long'):
            refuse_unwritable(deep, ('result.json',))
    assert not (places / 'open' / 'b').exists()


@pytest.mark.parametrize('within', [True, False])
def test_a_pipe_or_a_device_is_named_and_never_waited_for(folders, places, within):
    pipe = places / 'open' / 'bag' / 'pipe'
    os.mkfifo(pipe)
    for path in (pipe, '/dev/zero'):
        try:
            if within:
                with confined(folders, folders):
                    file_content(path)
            else:
                file_content(path)
        except NotPermittedError:
            assert within and path == '/dev/zero'
        except OSError as error:
            assert error.strerror == 'not a regular file'
        else:
            pytest.fail('read')
