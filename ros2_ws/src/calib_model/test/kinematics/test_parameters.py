# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from calib_model.errors import DataError
from calib_model.instruments import ActiveProbe, Arm
from calib_model.kinematics.forward import point_derivatives, points
from calib_model.kinematics.parameters import ParameterTable


@pytest.fixture
def table(kr5: Arm, probe: ActiveProbe) -> ParameterTable:
    return ParameterTable.of(kr5, probe)


def test_names_are_the_contracts_in_its_order(table: ParameterTable) -> None:
    joints = range(1, 7)
    expected = [f'{kind}{i}' for kind in ('a', 'alpha', 'd', 'theta_0_', 'beta') for i in joints]
    expected += ['probe_x', 'probe_y', 'probe_z', 'probe_rx', 'probe_ry', 'probe_rz']
    assert list(table.names) == expected
    units = {p.name: p.unit for p in table.parameters}
    assert [units[name] for name in ('a1', 'alpha1', 'd6', 'theta_0_2', 'beta3')] == [
        'm',
        'rad',
        'm',
        'rad',
        'rad',
    ]
    assert (units['probe_x'], units['probe_rx']) == ('m', 'rad')


def test_applying_the_nominal_vector_changes_nothing(
    table: ParameterTable, kr5: Arm, probe: ActiveProbe
) -> None:
    arm, mounted = table.apply(table.nominal, kr5, probe)
    assert arm == kr5
    assert mounted.styli == probe.styli
    np.testing.assert_array_equal(mounted.flange_T_probe.matrix(), probe.flange_T_probe.matrix())


def test_every_name_lands_on_its_own_value(
    table: ParameterTable, kr5: Arm, probe: ActiveProbe
) -> None:
    for column, name in enumerate(table.names):
        vector = table.nominal.copy()
        vector[table.column(name)] += 1.0
        again = ParameterTable.of(*table.apply(vector, kr5, probe))
        changed = np.flatnonzero(again.nominal != table.nominal)
        assert changed.tolist() == [column]


def test_columns_are_those_of_the_jacobian(
    table: ParameterTable, kr5: Arm, probe: ActiveProbe
) -> None:
    q, p = np.full((1, 6), 0.3), np.array([0.01, 0.02, 0.1])
    columns = point_derivatives(kr5, q, p).geometry.reshape(3, -1)
    for name in ('a2', 'alpha4', 'd3', 'theta_0_5', 'beta2'):
        vector = table.nominal.copy()
        vector[table.column(name)] += 1e-6
        moved = points(table.apply(vector, kr5, probe)[0], q, p) - points(kr5, q, p)
        np.testing.assert_allclose(moved[0] / 1e-6, columns[:, table.column(name)], atol=1e-5)


def test_frozen_columns_keep_their_nominal_value_and_say_why(table: ParameterTable) -> None:
    held = table.frozen_at(table.matching('beta*') + [table.column('d1')], 'not seen')
    assert len(held.free) == 36 - 7
    full = held.full(np.arange(29.0))
    assert full[held.column('d1')] == held.nominal[held.column('d1')]
    assert full[held.free_columns].tolist() == list(range(29))
    assert held.parameters[held.column('d1')].reason == 'not seen'
    freed = held.freed([held.column('d1')])
    assert freed.parameters[freed.column('d1')].free
    assert freed.parameters[freed.column('d1')].reason == 'not seen'
    assert len(table.free) == 36  # the table itself is never changed


def test_a_pattern_takes_only_what_it_matches(table: ParameterTable) -> None:
    names = [table.names[i] for i in table.matching('a?')]
    assert names == ['a1', 'a2', 'a3', 'a4', 'a5', 'a6']
    with pytest.raises(DataError, match=r"no parameter is called 'gamma\*' \(there are a1, a2"):
        table.matching('gamma*')
