"""An axis that a fit in time does not explain is told by its commands, or by nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Identification, SpectralFit
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.diagnose.model_findings import find_in_models
from quadid_logs.identify import _BySpectra, _told_by_spectra, identify
from tests.align.flights import flight_log
from tests.identify.vehicles import QUAD, fly, multisine

FIT = SpectralFit(
    mean=np.array([100.0, -1.0, 0.03, 0.005, 0.0]),
    covariance=np.eye(5),
    departure=0.03,
    commanded=0.7,
    r2_commanded=0.99,
    n_blocks=20,
    half_width=12.0,
)


@pytest.fixture(scope="module")
def data() -> FlightData:
    """A flight that a fit in time explains."""
    return fly(QUAD, multisine(30.0), feedback=8.0)


@pytest.fixture(scope="module")
def good(data: FlightData) -> Identification:
    """Its identification: nothing else speaks against its pitch."""
    return identify(data, IdentifySettings())


def errors(good: Identification, **pitch: object) -> list[Finding]:
    """Return why pitch is refused where its commands tell this."""
    fits = (FIT, replace(FIT, **pitch), FIT)  # type: ignore[arg-type]
    found = find_in_models(flight_log(), replace(good, spectral=fits))
    return [each for each in found if each.level == "error" and each.axes == ("pitch",)]


def test_a_fit_in_time_that_explains_stands_where_commands_tell_nothing(good: Identification) -> None:
    """Nothing was commanded of it, say."""
    assert not errors(good, half_width=60.0)


def test_a_wide_answer_to_commands_is_no_reason_to_take_a_fit_in_time(good: Identification) -> None:
    """Air biases that; the reader is told how wide."""
    (found,) = errors(good, half_width=60.0, alone=True)
    assert found.code == "QL505"
    assert "60 %" in found.title


def test_more_commands_are_advised_however_much_air_turned_the_axis(good: Identification) -> None:
    """Larger manoeuvres 'would not help' a pitch whose interval they narrow."""
    fast = tuple(replace(each, rate_rms_rad_s=1.0) for each in good.excitation)
    (found,) = errors(replace(good, excitation=fast), half_width=60.0, alone=True)
    assert "would not help" not in found.advice
    assert "doublets" in found.advice


def test_an_answer_that_one_equation_does_not_explain_is_refused(good: Identification) -> None:
    """Two thirds of what was commanded."""
    (found,) = errors(good, r2_commanded=0.66, alone=True)
    assert found.code == "QL504"
    assert "responds to its commands" in found.title


@pytest.mark.parametrize(("alone", "told"), [((1,), (1,)), ((), ())])
def test_a_refused_number_is_that_of_the_commands_where_these_tell_alone(
    data: FlightData, good: Identification, alone: tuple[int, ...], told: tuple[int, ...]
) -> None:
    """Known to 40 %: too wide to use, and the only number that the reason speaks of."""
    wide = (replace(FIT, half_width=40.0),) * 3
    asked = _BySpectra(plain=wide, fits=wide)
    model = good.models[0]
    assert _told_by_spectra(asked, data, model, good.excitation, None, alone) == told


def test_an_axis_of_which_commands_leave_everything_open_is_refused_for_that(good: Identification) -> None:
    """However well the torque goes with the motion."""
    (found,) = errors(good, half_width=np.inf, r2_commanded=np.nan, alone=True)
    assert found.code == "QL403"


def test_an_answer_that_departs_from_one_lag_is_refused_for_that(good: Identification) -> None:
    """Whatever its width."""
    (found,) = errors(good, departure=0.2, alone=True)
    assert found.code == "QL504"
