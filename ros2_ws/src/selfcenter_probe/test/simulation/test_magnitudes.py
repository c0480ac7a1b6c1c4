# SPDX-License-Identifier: Apache-2.0
import pytest

from calib_model.errors import DescriptionError
from selfcenter_probe.simulation.magnitudes import Magnitudes, parse_magnitudes


def test_the_default_world_is_off_in_everything_it_should_be(magnitudes):
    assert magnitudes.seed == 1
    arm, probe, gauge, psd = magnitudes.arm, magnitudes.probe, magnitudes.gauge, magnitudes.psd
    assert min(arm.length, arm.angle, arm.repeatability, probe.translation, probe.rotation) > 0
    assert min(gauge.translation, gauge.rotation, gauge.certificate) > 0
    assert min(psd.amplifier_noise, psd.bandwidth, psd.linearity_error, psd.adc_bits) > 0
    assert 0 < psd.weak_signal < psd.photocurrent < psd.adc_range


def test_noise_none_keeps_what_is_to_be_identified(default_world_file, magnitudes):
    text = default_world_file.read_text().replace('noise: full', 'noise: none')
    exact = parse_magnitudes(text)
    assert exact == magnitudes.without_noise()
    assert exact.arm.length == magnitudes.arm.length
    assert exact.probe == magnitudes.probe
    assert exact.gauge.translation == magnitudes.gauge.translation
    assert exact.arm.repeatability == exact.gauge.certificate == exact.psd.linearity_error == 0
    assert exact.psd.adc_bits == exact.psd.amplifier_noise == exact.psd.bandwidth == 0


def test_what_is_left_out_is_zero():
    assert parse_magnitudes('{seed: 7}') == Magnitudes(seed=7)


@pytest.mark.parametrize(
    ('text', 'where'),
    [
        ('[]', 'world: expected a mapping'),
        ('arm: {lenght: 1e-3}', "is it 'length'"),
        ('arm: {length: -1}', 'arm.length'),
        ('arm: {travel: 0}', 'arm.travel'),
        ('arm: 3', 'arm: expected a mapping'),
        ('seed: 1.5', 'seed'),
        ('seed: -1', 'seed'),
        ('noise: some', "'full' or 'none'"),
        ('bound: 0.5', 'bound'),
        ('psd: {adc_bits: 12.5}', 'psd.adc_bits'),
        ('psd: {length: 0}', 'psd.length'),
        ('probe: {translation: big}', 'probe.translation'),
        ('gauge: {certificate: .nan}', 'gauge.certificate'),
        ('hand: {seat_force: -1}', 'hand.seat_force'),
        ('hand: {seat_froce: 1}', "is it 'seat_force'"),
    ],
)
def test_a_value_that_cannot_be_used_is_named(text, where):
    with pytest.raises(DescriptionError) as error:
        parse_magnitudes(text)
    assert where in str(error.value)
    assert '\n' not in str(error.value)
