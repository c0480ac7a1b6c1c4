# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from selfcenter_probe.sensing import Status
from selfcenter_probe.simulation.health import Health, Level
from selfcenter_probe.simulation.readings import Readings

pytestmark = pytest.mark.timeout(30)


def read(*status):
    """One reading for each row of three statuses."""
    rows = np.array(status, np.uint8).reshape(-1, 3)
    stamps = np.arange(len(rows), dtype=np.int64)
    return Readings(stamps, np.full((len(rows), 3), 1e-4), rows)


OK, GONE, FAR, WEAK = Status.OK, Status.NO_CONTACT, Status.OVER_TRAVEL, Status.WEAK_SIGNAL


@pytest.mark.parametrize(
    ('status', 'level', 'message'),
    [
        ([OK, OK, OK], Level.OK, 'reading'),
        ([GONE, GONE, GONE], Level.OK, 'no contact'),
        ([OK, FAR, OK], Level.WARN, 'over-travel of stylus 2'),
        ([WEAK, FAR, WEAK], Level.ERROR, 'weak signal of stylus 1, 3'),
    ],
)
def test_the_worst_of_the_last_moments_is_told(status, level, message):
    health = Health()
    health.take(read(status, [OK, OK, OK]) if level else read(status))
    report = health.report(1.0)
    assert (report.level, report.message) == (level, message)


def test_silence_is_stale_and_counting_starts_again_with_every_report():
    health = Health()
    assert health.report(1.0).level == Level.STALE
    health.take(read(*[[FAR, OK, OK]] * 50))
    first = health.report(0.5)
    assert first.values['readings per second'] == '100.0'
    assert first.values['contact'] == 'True'
    assert first.values['stylus 1 over-travel readings'] == '50'
    health.take(read([FAR, GONE, OK]))
    second = health.report(1.0)
    assert second.values['readings per second'] == '1.0'
    assert second.values['stylus 1 over-travel readings'] == '51'
    assert second.values['stylus 2 signal'] == 'NO_CONTACT'
    assert second.values['contact'] == 'False'
    assert health.report(1.0).level == Level.STALE
