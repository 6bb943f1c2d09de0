"""One frequency an axis tells a lag from an effectiveness badly, and must say how badly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.data.settings import AlignSettings
from quadid_logs.identify.spectral_effects import fit_by_spectra
from quadid_logs.load import prepare
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.simulator import fly, plan_flights
from quadid_logs.simulator.logger import log_flights
from quadid_logs.simulator.scenarios import SCENARIOS
from quadid_logs.simulator.truth import flight_truth


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 7])
def test_one_tone_an_axis_holds_lag_and_effectiveness(seed: int) -> None:
    """How a tone begins and ends is no second frequency, in calm air neither."""
    scenario = replace(SCENARIOS["single-tone"], duration_s=40.0)
    (setup,) = plan_flights(scenario, seed=seed, duration_s=40.0, rate_hz=scenario.logging.rate_hz)
    record = fly(setup)
    truth = flight_truth((record,), scenario=scenario.name, boot_s=scenario.logging.boot_s)
    fits = fit_by_spectra(cut(prepare(log_flights((record,), scenario.logging)), AlignSettings()))
    half_lag_s = NORMAL_95 * float(np.sqrt(fits[0].covariance[2, 2]))
    assert fits[0].mean[2] == pytest.approx(truth["actuator"]["lag_s"], abs=half_lag_s)
    for axis, fit in enumerate(fits):
        assert fit.gain == pytest.approx(truth["models"]["damped"]["B"][axis][axis], abs=fit.half_width)
