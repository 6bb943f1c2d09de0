"""The band begins where the response of a vehicle does, and not where a controller answers the air."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Model
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify
from quadid_logs.identify.response import Response, lower_edge_hz, responses
from quadid_logs.identify.structures import DAMPED

from .vehicles import PERIOD_S, QUAD, fly, fly_in_gusts, multisine

#: Third octaves from half a hertz to 32 Hz, as the package has them.
FREQUENCY_HZ = 0.5 * 2.0 ** ((np.arange(18) + 0.5) / 3.0)
S = 2j * np.pi * FREQUENCY_HZ
#: A vehicle behind 40 ms of lag and 8 ms of delay, with damping.
VEHICLE = 100.0 * np.exp(-0.008 * S) / (1.0 + 0.04 * S) * S / (S + 1.5)
#: What torque and acceleration make of each other under feedback alone: -1/C of a rate loop.
INVERSE_CONTROLLER = -S / (0.3 + 0.5 / S)


def response(gain: np.ndarray, error: float = 0.03) -> Response:
    return Response(FREQUENCY_HZ, gain, np.full(gain.shape, error))


def test_a_vehicle_behind_lag_and_delay_keeps_the_whole_band() -> None:
    """Its damping is no bend."""
    assert lower_edge_hz(response(VEHICLE), PERIOD_S) == 0.0


def test_the_band_begins_where_the_inverse_controller_ends() -> None:
    """At the very third octave."""
    mixed = np.where(FREQUENCY_HZ < 1.5, INVERSE_CONTROLLER, VEHICLE)
    edge = lower_edge_hz(response(mixed), PERIOD_S)
    assert FREQUENCY_HZ[FREQUENCY_HZ < 1.5][-1] < edge < FREQUENCY_HZ[FREQUENCY_HZ > 1.5][0]


def test_the_inverse_controller_alone_is_no_vehicle_anywhere() -> None:
    """No band of two octaves is found in it: its phase leads or lags by a right angle, and its size grows."""
    assert lower_edge_hz(response(INVERSE_CONTROLLER), PERIOD_S) == 0.0


def test_a_third_octave_of_which_nothing_is_known_disagrees_with_nothing() -> None:
    """However far off it is."""
    mixed = np.where(FREQUENCY_HZ < 1.5, INVERSE_CONTROLLER, VEHICLE)
    error = np.where(FREQUENCY_HZ < 1.5, 0.9, 0.03)
    assert lower_edge_hz(Response(FREQUENCY_HZ, mixed, error), PERIOD_S) == 0.0


def test_the_response_of_a_flight_is_that_of_its_vehicle() -> None:
    """Gain and phase of each third octave inside the manoeuvre; beyond, the controller answers noise."""
    roll, *_ = responses(fly(QUAD, multisine(60.0), feedback=8.0), instruments=False)
    known = np.isfinite(roll.gain) & (roll.frequency_hz > 0.6) & (roll.frequency_hz < 3.3)
    s = 2j * np.pi * roll.frequency_hz[known]
    lag = QUAD.lag_s
    true = QUAD.B[0, 0] * np.exp(-QUAD.delay_s * s) / (1.0 + lag * s) * s / (s + QUAD.damping[0, 0])
    off = np.abs(roll.gain[known] / true - 1.0)
    assert off.size >= 6
    assert (off < 0.1 + 2.0 * roll.error[known]).all()
    assert np.median(off) < 0.05


@pytest.fixture(scope="module")
def gusty() -> FlightData:
    return fly_in_gusts(np.arange(2.0, 9.0, 0.75), gust_rad_s2=3.0)


@pytest.fixture(scope="module")
def model(gusty: FlightData) -> Model:
    return identify(gusty, IdentifySettings(), (DAMPED,)).models[0]


def error_of(model: Model) -> np.ndarray:
    return np.diag(model.B) / np.diag(QUAD.B) - 1.0


def test_slow_gusts_raise_the_lower_edge_of_the_band(model: Model) -> None:
    """To where the manoeuvre is."""
    assert model.band is not None
    assert 1.0 < model.band.low_hz[0] <= 2.0


def test_the_gain_of_a_flight_in_slow_gusts_is_right_above_them(model: Model) -> None:
    """What is left of the gusts there costs some per cent."""
    assert np.abs(error_of(model)).max() < 0.04


def test_the_default_band_would_be_far_off_in_slow_gusts(gusty: FlightData) -> None:
    """A band that the user fixes stays: the gain is a fifth low, at a held-out R2 of 0.9."""
    model = identify(gusty, IdentifySettings(smoothing_hz=5.0), (DAMPED,)).models[0]
    assert error_of(model).max() < -0.15
    assert min(model.validation.r2_acceleration.values()) > 0.85


def test_calm_flight_keeps_the_default_band() -> None:
    """There is nothing to leave out."""
    model = identify(fly(QUAD, multisine(60.0), feedback=8.0), IdentifySettings(), (DAMPED,)).models[0]
    assert model.band is not None
    assert model.band.low_hz[0] == IdentifySettings().high_pass_hz
