# SPDX-License-Identifier: Apache-2.0
"""Callers come no further than the folders that were opened to them."""

import pytest

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
