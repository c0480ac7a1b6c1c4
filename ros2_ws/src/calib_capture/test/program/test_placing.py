# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from calib_capture.commands import place, plan
from calib_capture.program import Placer, Planner, ProgramError, ProgramSettings, placed_text
from calib_model.descriptions import arm_yaml, gauge_yaml, parse_placements, read_description
from calib_model.instruments import Gauge

pytestmark = pytest.mark.timeout(120)
SETTINGS = ProgramSettings(poses_per_sphere=1, pool=1)


def bar(spacing, count=6):
    centers = tuple((n, (spacing * (n - 1), 0.0, 0.0)) for n in range(1, count + 1))
    return Gauge('bar', 0.02, centers, 1e-6, 1e-6)


def test_spheres_are_spread_over_what_the_gauge_has(gauge):
    assert gauge.spread() == (1, 6, 10, 14)
    assert bar(0.1, 3).spread() == (1, 2, 3)
    for count in range(4, 30):
        numbers = bar(0.1, count).spread()
        assert len(set(numbers)) == 4
        assert numbers[0] == 1
        assert numbers[-1] >= count - 2
    turned = replace(bar(0.1, 9), spheres=bar(0.1, 9).spheres[::-1])
    assert turned.spread()[0] == 9


@pytest.mark.slow
def test_proposed_places_are_in_reach_and_each_tells_more(kr5, probe):
    placed = Placer(Planner(kr5, probe, bar(0.07), SETTINGS)).place(2)
    assert len(placed.places) == 2
    assert all(np.diff(placed.uncertainty) < 0)
    settings = replace(SETTINGS, poses_per_sphere=4)
    program = Planner(kr5, probe, bar(0.07), settings).program(placed.placements)
    assert not program.unreached
    assert len(program.poses) >= 0.9 * 2 * 4 * 4
    assert program.expected.after < 0.01 * program.expected.before


def test_a_region_holds_the_whole_gauge(kr5, probe):
    region = np.array([[0.1, 0.8], [-0.5, 0.5], [0.1, 0.6]])
    planner = Planner(kr5, probe, bar(0.05), SETTINGS)
    for each in Placer(planner, region).place(1).places:
        there = each.T_base_gauge.apply(np.array([center for _, center in bar(0.05).spheres]))
        assert (there >= region[:, 0]).all()
        assert (there <= region[:, 1]).all()


def test_what_is_in_the_way_everywhere_is_named(kr5, probe):
    far = np.array([[2.0, 3.0], [2.0, 3.0], [0.0, 1.0]])
    with pytest.raises(ProgramError, match='nowhere .* out of reach'):
        Placer(Planner(kr5, probe, bar(0.05), SETTINGS), far).place(2)
    with pytest.raises(ProgramError, match='reaches across'):
        Placer(Planner(kr5, probe, bar(1.0), SETTINGS)).place(2)


@pytest.mark.slow
def test_the_command_writes_what_plan_reads(tmp_path, capsys, monkeypatch, kr5):
    arm, out, small = (tmp_path / name for name in ('arm.yaml', 'places.yaml', 'bar.yaml'))
    arm.write_text(arm_yaml(replace(kr5, name='mine')))
    small.write_text(gauge_yaml(bar(0.06, 5)))
    given = ['--arm', str(arm), '--gauge', str(small)]
    monkeypatch.setattr('sys.argv', ['place', str(out), *given, '--count', '2'])
    assert place.main() == 0
    told = capsys.readouterr().out
    assert told.startswith(
        '2 locations of bar for mine with active_trihedron, spheres 1, 2, 4, 5\n'
    )
    assert 'places can be used' in told
    assert set(read_description(out, parse_placements)) == {1, 2}
    few = ['--poses', '1', '--pool', '1']
    monkeypatch.setattr('sys.argv', ['plan', *given, *few, '--placements', str(out)])
    assert plan.main() == 0
    assert capsys.readouterr().out.startswith('8 poses of 8 spheres at 2 locations\n')
    monkeypatch.setattr('sys.argv', ['plan', *given, *few])
    assert plan.main() == 2
    assert 'ros2 run calib_capture place --arm' in capsys.readouterr().err


def test_fewer_places_than_asked_for_are_said_to_be_fewer(kr5, probe):
    planner = Planner(kr5, probe, bar(0.05), SETTINGS)
    placed = Placer(planner).place(1)
    assert 'only 1 of the 4 asked for' in placed_text(replace(placed, asked=4), planner)
