# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from selfcenter_probe.sensing.psd import PsdDesign, Psds, decode

STROKE = 0.003
readings = arrays(np.float64, (4, 3), elements=st.floats(-STROKE, STROKE))


def drawn(design, seed=3):
    return Psds.drawn(design, np.random.default_rng(seed))


@given(readings)
def test_a_perfect_psd_gives_the_displacement_back(displacement):
    read, weak = drawn(PsdDesign()).read(displacement, np.random.default_rng(0))
    np.testing.assert_allclose(read, displacement, rtol=0, atol=1e-16)
    assert not weak.any()


@given(readings)
def test_the_two_photocurrents_share_the_light(displacement):
    psds = drawn(PsdDesign(led_spread=0.2))
    currents = psds.photocurrents(displacement, np.random.default_rng(0))
    np.testing.assert_allclose(
        currents.sum(axis=-1), np.tile(psds.photocurrent, (4, 1)), rtol=1e-12
    )
    ratio = (currents[..., 1] - currents[..., 0]) / currents.sum(axis=-1)
    np.testing.assert_allclose(psds.design.length / 2 * ratio, displacement, atol=1e-15)


def test_noise_is_about_a_micrometre_and_grows_as_the_light_fades(magnitudes):
    still = np.full((4000, 3), 1e-3)
    design = replace(magnitudes.psd, linearity_error=0.0)
    read, _ = drawn(design).read(still, np.random.default_rng(1))
    noise = read.std(axis=0)
    assert np.all((noise > 0.5e-6) & (noise < 1.5e-6))
    np.testing.assert_allclose(read.mean(axis=0), 1e-3, atol=5 * 1.5e-6 / np.sqrt(4000))
    dim = replace(design, photocurrent=design.photocurrent / 2)
    faint, _ = drawn(dim).read(still, np.random.default_rng(1))
    assert np.all(faint.std(axis=0) > 1.5 * noise)


def test_shot_noise_follows_the_current_and_the_bandwidth():
    design = PsdDesign(bandwidth=1e6)
    currents = drawn(design).photocurrents(np.zeros((20000, 3)), np.random.default_rng(2))
    expected = np.sqrt(2 * 1.602176634e-19 * 0.5e-6 * 1e6)
    np.testing.assert_allclose(currents.std(axis=0), expected, rtol=0.03)


def test_linearity_error_is_a_few_micrometres_smooth_and_every_styluss_own(magnitudes):
    x = np.linspace(-STROKE, STROKE, 601)
    strokes = np.tile(x[:, None], (1, 3))
    for seed in range(20):
        error = drawn(magnitudes.psd, seed).linearity_error(strokes)
        worst = np.abs(error).max(axis=0)
        assert np.all((worst > 0.5e-6) & (worst < 10e-6))
        # at most four waves over 12 mm: steeper than this would be a kink
        slope = np.abs(np.diff(error, axis=0)).max() / (x[1] - x[0])
        assert slope < 10e-6 * 2 * np.pi * 4 / 0.012
        assert np.abs(error[:, 0] - error[:, 1]).max() > 0.2e-6


def test_the_firmware_does_not_know_the_linearity_error():
    design = PsdDesign(linearity_error=3e-6)
    psds = drawn(design)
    displacement = np.linspace(-STROKE, STROKE, 30).reshape(10, 3)
    read, _ = psds.read(displacement, np.random.default_rng(0))
    np.testing.assert_allclose(
        read - displacement, psds.linearity_error(displacement), rtol=0, atol=1e-15
    )


def test_quantisation_gives_steps_and_no_more_error_than_one():
    design = PsdDesign(adc_bits=10)
    displacement = np.linspace(-STROKE, STROKE, 3000).reshape(1000, 3)
    psds = drawn(design)
    currents = psds.photocurrents(displacement, np.random.default_rng(0))
    step = design.adc_range / 2**10
    np.testing.assert_allclose(currents / step, np.round(currents / step), atol=1e-9)
    read, _ = decode(design, currents)
    error = np.abs(read - displacement).max()
    assert 0.2 * step / design.photocurrent * design.length < error
    assert error < step / design.photocurrent * design.length


@pytest.mark.parametrize('light', [0.0, 1e-9, 0.19])
def test_too_little_light_is_a_weak_signal_and_still_a_number(magnitudes, light):
    design = replace(magnitudes.psd, photocurrent=light * 1e-6, led_spread=0.0)
    read, weak = drawn(design).read(np.zeros((500, 3)), np.random.default_rng(4))
    assert weak.all()
    assert np.isfinite(read).all()
    assert np.abs(read).max() <= design.length / 2


def test_a_converter_at_full_scale_is_not_believed(magnitudes):
    design = replace(magnitudes.psd, photocurrent=5e-6)
    _, weak = drawn(design).read(np.zeros((10, 3)), np.random.default_rng(4))
    assert weak.all()


def test_the_default_light_is_never_weak(magnitudes):
    strokes = np.random.default_rng(5).uniform(-STROKE, STROKE, (5000, 3))
    for seed in range(20):
        _, weak = drawn(magnitudes.psd, seed).read(strokes, np.random.default_rng(seed))
        assert not weak.any()
