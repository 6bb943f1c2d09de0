"""At which frequency an effectiveness comes and goes: of products that are made here."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.identify.varying_gain import Variation, likeliest_variation

PERIOD_S = 0.01
TIME_S = PERIOD_S * np.arange(6000)


def _likeliest(seed: int, varies: np.ndarray, *, kept: np.ndarray | None = None) -> Variation:
    """Three axes that explain white motion, in noise as large; ``kept``: samples without the gaps."""
    rng = np.random.default_rng(seed)
    explained, noise = 10.0 * rng.standard_normal((2, TIME_S.size, 3))
    error = varies[:, np.newaxis] * explained + noise
    rows = slice(None) if kept is None else kept
    found = likeliest_variation(TIME_S[rows], error[rows], explained[rows], PERIOD_S)
    assert found is not None
    return found


@pytest.mark.parametrize("frequency_hz", [0.03, 0.21, 1.3])
def test_frequency_and_phase_of_a_variation_are_found(frequency_hz: float) -> None:
    """To a quarter of what a minute tells apart."""
    varies = 0.2 * np.cos(2.0 * np.pi * frequency_hz * TIME_S - 0.7)
    found = _likeliest(0, varies)
    assert found.frequency_hz == pytest.approx(frequency_hz, abs=0.25 / 60.0)
    own = np.cos(2.0 * np.pi * found.frequency_hz * TIME_S - found.phase_rad)
    assert np.corrcoef(own, varies)[0, 1] > 0.9


def test_a_gap_changes_nothing_about_it() -> None:
    """Ten seconds are missing."""
    kept = np.flatnonzero((TIME_S < 20.0) | (TIME_S > 30.0))
    found = _likeliest(1, 0.2 * np.cos(2.0 * np.pi * 0.21 * TIME_S), kept=kept)
    assert found.frequency_hz == pytest.approx(0.21, abs=0.005)


def test_what_varies_stands_out_of_all_frequencies() -> None:
    """Its evidence is far above the mean of all frequencies; in noise that of the best is not."""
    varying, steady = _likeliest(2, 0.2 * np.sin(2.0 * np.pi * 0.5 * TIME_S)), _likeliest(2, 0.0 * TIME_S)
    assert varying.weight < 0.25 * steady.weight


def test_a_mean_that_is_off_is_no_variation() -> None:
    """An effectiveness that is a tenth too large all the time has the evidence of one that is right."""
    steady, too_large = _likeliest(3, 0.0 * TIME_S), _likeliest(3, np.full(TIME_S.size, 0.1))
    assert too_large.weight == pytest.approx(steady.weight, rel=0.5)


def test_nothing_explained_varies_not() -> None:
    """No torque, no flight: none."""
    nothing = np.zeros((100, 3))
    assert likeliest_variation(TIME_S[:100], nothing + 1.0, nothing, PERIOD_S) is None
    assert likeliest_variation(TIME_S[:0], nothing[:0], nothing[:0], PERIOD_S) is None
