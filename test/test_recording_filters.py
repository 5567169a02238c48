"""The low-pass and the derivative do what their descriptions state."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from dvrk_gravity.errors import RecordingError, ShapeError
from dvrk_gravity.recording import LowPass, derivative, lowpass

RATE = 200.0
TIME = np.arange(4000) / RATE


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("cutoff", [2.0, 5.65, 20.0])
def test_lowpass_halves_the_amplitude_at_the_cutoff_and_shifts_nothing(order, cutoff):
    low = LowPass(cutoff, RATE, order)
    wave = np.sin(2 * np.pi * cutoff * TIME)
    middle = slice(1000, 3000)
    np.testing.assert_allclose(low(wave)[middle], 0.5 * wave[middle], atol=1e-6)
    slow = np.sin(2 * np.pi * cutoff / 20 * TIME)
    gain = 1 / (
        1 + (np.tan(np.pi * cutoff / 20 / RATE) / np.tan(np.pi * cutoff / RATE)) ** (2 * order)
    )
    np.testing.assert_allclose(low(slow)[middle], gain * slow[middle], atol=1e-6)


@pytest.mark.parametrize("shape", [(640,), (641, 3), (600, 2, 2), (600, 0)])
@pytest.mark.parametrize("cutoff", [2.0, 5.65, 60.0, 99.0])
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_the_lowpass_is_scipy_s(order, cutoff, shape):
    signal = np.cumsum(np.random.default_rng(0).normal(size=shape), axis=0)
    low = LowPass(cutoff, RATE, order)
    sections = butter(order, cutoff, fs=RATE, output="sos")
    expected = sosfiltfilt(sections, signal, axis=0, padlen=low.edge)
    np.testing.assert_allclose(low(signal), expected, atol=1e-9 * np.abs(signal).max(initial=0.0))
    poles = butter(order, cutoff, fs=RATE, output="zpk")[1]
    assert low.edge == int(np.ceil(np.log(1e-3) / np.log(np.abs(poles).max())))


def test_edge_is_where_the_ends_stop_to_matter():
    """Two signals that differ only beyond the end: the filter sees one of them cut short."""
    rng = np.random.default_rng(0)
    signal = np.cumsum(rng.normal(size=4000)) / 20
    low = LowPass(5.65, RATE)
    error = np.abs(low(signal[:2000]) - low(signal)[:2000])
    assert error[-1] > 0.05
    assert error[: -low.edge].max() < 2e-3 * error.max()
    assert error[: -low.edge // 2].max() > 2e-3 * error.max()
    assert f"{low.edge} samples" in str(low)
    assert "5.65 Hz" in str(low)


def test_columns_are_filtered_alike():
    columns = np.random.default_rng(0).normal(size=(300, 4))
    together = lowpass(columns, RATE, 10.0)
    for k in range(4):
        np.testing.assert_allclose(together[:, k], lowpass(columns[:, k], RATE, 10.0), atol=1e-12)
    np.testing.assert_allclose(
        lowpass(columns @ [1.0, 2.0, 3.0, 4.0], RATE, 10.0),
        together @ [1.0, 2.0, 3.0, 4.0],
        atol=1e-12,
    )


def test_derivative_is_exact_to_degree_four_ends_included():
    time = np.linspace(-1.0, 1.0, 21)
    powers = time[:, None] ** np.arange(5)
    expected = np.arange(5) * time[:, None] ** np.maximum(np.arange(5) - 1, 0)
    np.testing.assert_allclose(derivative(powers, 10.0), expected, atol=1e-12)
    np.testing.assert_allclose(derivative(time**4, 10.0), expected[:, 4], atol=1e-12)
    assert np.abs(derivative(time**5, 10.0) - 5 * time**4).max() > 1e-4


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 100.0, float("nan")])
def test_impossible_cutoffs_are_refused(cutoff):
    with pytest.raises(RecordingError, match="expected above 0 and below 100 Hz"):
        LowPass(cutoff, RATE)


def test_too_few_samples_are_refused():
    with pytest.raises(ShapeError, match="to filter"):
        lowpass(np.zeros(5), RATE, 5.0)
    with pytest.raises(ShapeError, match="to differentiate"):
        derivative(np.zeros(4), RATE)
