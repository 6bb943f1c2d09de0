"""The band is where the response of a vehicle is, and not where a controller answers air and noise."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Model, Response
from quadid_logs.data.settings import IdentifySettings, in_band
from quadid_logs.errors import SettingsError
from quadid_logs.identify import identify
from quadid_logs.identify.response import (
    EVERYWHERE,
    Band,
    feedback_in,
    fitted_band,
    known_from,
    responses,
    vehicle_band,
)
from quadid_logs.identify.structures import DAMPED
from quadid_logs.maths.band import angular_frequency

from .vehicles import PERIOD_S, QUAD, fly, fly_in_gusts, multisine

#: Third octaves from half a hertz to 32 Hz, as the package has them.
FREQUENCY_HZ = 0.5 * 2.0 ** ((np.arange(18) + 0.5) / 3.0)
S = 2j * np.pi * FREQUENCY_HZ
#: A vehicle behind 40 ms of lag and 8 ms of delay, with damping.
VEHICLE = 100.0 * np.exp(-0.008 * S) / (1.0 + 0.04 * S) * S / (S + 1.5)
#: What torque and acceleration make of each other under feedback alone: -1/C of a rate loop.
INVERSE_CONTROLLER = -S / (0.3 + 0.5 / S)


def response(gain: np.ndarray, error: float | np.ndarray = 0.03, power: float | np.ndarray = 1.0) -> Response:
    return Response(
        frequency_hz=FREQUENCY_HZ,
        gain=gain,
        error=np.broadcast_to(error, gain.shape),
        coherence=np.full(gain.shape, 0.9),
        torque_power=np.broadcast_to(power, gain.shape),
    )


def test_a_vehicle_behind_lag_and_delay_keeps_the_whole_band() -> None:
    """Its damping is no bend. Above 16 Hz the lags and delays that are tried are too far apart to tell."""
    low_hz, high_hz = vehicle_band(response(VEHICLE))
    assert low_hz == 0.0
    assert high_hz > 16.0


def test_the_band_begins_where_the_inverse_controller_ends() -> None:
    """At the very third octave."""
    mixed = np.where(FREQUENCY_HZ < 1.5, INVERSE_CONTROLLER, VEHICLE)
    edge = vehicle_band(response(mixed)).low_hz
    assert FREQUENCY_HZ[FREQUENCY_HZ < 1.5][-1] < edge < FREQUENCY_HZ[FREQUENCY_HZ > 1.5][0]


def test_the_inverse_controller_alone_is_no_vehicle_anywhere() -> None:
    """No band of two octaves is found in it: its phase leads or lags by a right angle, and its size grows."""
    assert vehicle_band(response(INVERSE_CONTROLLER)) == EVERYWHERE


def test_a_third_octave_of_which_nothing_is_known_disagrees_with_nothing() -> None:
    """However far off it is."""
    mixed = np.where(FREQUENCY_HZ < 1.5, INVERSE_CONTROLLER, VEHICLE)
    error = np.where(FREQUENCY_HZ < 1.5, 0.9, 0.03)
    assert vehicle_band(response(mixed, error)).low_hz == 0.0


def test_what_lies_below_the_first_known_third_octave_can_be_left_out() -> None:
    """From 1.6 Hz on the response is known to 5 %: two octaves from there on are fitted."""
    error = np.where(FREQUENCY_HZ < 1.59, 0.5, 0.05)
    hidden = response(VEHICLE, error)
    assert known_from(hidden) == pytest.approx(0.5 * 2.0 ** (5.0 / 3.0))
    assert fitted_band([hidden], Band(0.3, 5.0), 0.0025) == Band(0.3, 5.0)
    found = fitted_band([hidden, response(VEHICLE)], Band(0.3, 5.0), 0.0025, from_known=True)
    assert found == pytest.approx((1.587, 6.35), abs=0.01)


def test_a_third_octave_without_a_line_hides_nothing() -> None:
    """Windows of four seconds resolve no half hertz."""
    gain = np.where(FREQUENCY_HZ < 0.6, np.nan, VEHICLE)
    assert known_from(response(gain, np.where(FREQUENCY_HZ < 0.6, np.inf, 0.03))) == 0.0


def test_the_band_ends_where_the_inverse_controller_begins() -> None:
    """As it does where the gyro's noise outweighs the manoeuvre."""
    mixed = np.where(FREQUENCY_HZ > 4.0, INVERSE_CONTROLLER, VEHICLE)
    edge = vehicle_band(response(mixed)).high_hz
    assert FREQUENCY_HZ[FREQUENCY_HZ < 4.0][-1] < edge < FREQUENCY_HZ[FREQUENCY_HZ > 4.0][0]


DEFAULT = Band(0.3, 5.0)


def test_a_raised_lower_edge_takes_the_upper_one_two_octaves_with_it() -> None:
    """A narrower band tells no gain from a lag."""
    mixed = np.where(FREQUENCY_HZ < 1.5, INVERSE_CONTROLLER, VEHICLE)
    low_hz, high_hz = fitted_band([response(VEHICLE), response(mixed)], DEFAULT, PERIOD_S)
    assert high_hz == pytest.approx(max(4.0 * low_hz, 5.0))
    assert 1.0 < low_hz < 1.8


def test_the_upper_edge_is_that_of_the_axis_whose_response_ends_first() -> None:
    """One band is fitted for all of them."""
    mixed = np.where(FREQUENCY_HZ > 4.0, INVERSE_CONTROLLER, VEHICLE)
    found = fitted_band([response(VEHICLE), response(mixed)], DEFAULT, PERIOD_S)
    assert found == Band(0.3, vehicle_band(response(mixed)).high_hz)


def test_axes_without_two_octaves_in_common_keep_the_default_band() -> None:
    """What is left would tell nothing."""
    late = np.where(FREQUENCY_HZ < 3.0, INVERSE_CONTROLLER, VEHICLE)
    early = np.where(FREQUENCY_HZ > 4.0, INVERSE_CONTROLLER, VEHICLE)
    assert fitted_band([response(late), response(early)], DEFAULT, PERIOD_S) == DEFAULT


def test_the_band_ends_where_the_samples_hold_eight_per_cycle() -> None:
    """A lower edge that would need more is not taken."""
    late = np.where(FREQUENCY_HZ < 3.0, INVERSE_CONTROLLER, VEHICLE)
    assert fitted_band([response(late)], DEFAULT, PERIOD_S).low_hz > 2.0
    assert fitted_band([response(late)], DEFAULT, 0.0125) == DEFAULT


@pytest.mark.parametrize(
    "controller",
    [
        -S / (0.3 + 0.5 / S),
        -S / (0.3 + 0.003 * S),
        -S / (0.3 + 0.2 / S) * np.exp(0.012 * S),
        -S / 0.3 * (1.0 + S / (2.0 * np.pi * 2.0)),
    ],
    ids=["PI", "PD", "behind the gyro's filters", "behind a low-pass of 2 Hz on yaw"],
)
def test_the_inverse_of_a_controller_is_told_by_phase_and_slope(controller: np.ndarray) -> None:
    """Whatever its terms and filters are, it grows with frequency and does not lead."""
    found = feedback_in(response(controller), DEFAULT)
    assert found is not None
    assert found.fraction > 0.9


@pytest.mark.parametrize(
    "vehicle",
    [
        VEHICLE,
        100.0 * S / (S + 25.0),
        100.0 * np.exp(-0.06 * S) * S / (S + 3.0),
        100.0 / (1.0 + 0.25 * S),
        100.0 * (1.0 + 0.15 * S),
    ],
    ids=[
        "lag, delay and damping",
        "strong damping",
        "longest delay",
        "longest lag",
        "rotors' reaction in yaw",
    ],
)
def test_no_vehicle_is_taken_for_the_inverse_of_a_controller(vehicle: np.ndarray) -> None:
    """Its response leads where it grows."""
    assert feedback_in(response(vehicle), DEFAULT) is None


def test_feedback_outside_of_the_fitted_band_is_no_objection() -> None:
    """Every good flight shows the controller's answer to noise above its manoeuvres."""
    mixed = np.where(FREQUENCY_HZ > 6.0, INVERSE_CONTROLLER, VEHICLE)
    assert feedback_in(response(mixed), DEFAULT) is None
    assert feedback_in(response(mixed), Band(6.0, 20.0)) is not None


def test_what_a_fit_hardly_weighs_does_not_count() -> None:
    """Beside a strong manoeuvre of few lines most third octaves show the controller's answer to noise."""
    mixed = np.where(FREQUENCY_HZ > 0.95, INVERSE_CONTROLLER, VEHICLE)
    power = np.where(FREQUENCY_HZ > 0.95, 1e-3, 1.0)
    assert feedback_in(response(mixed), DEFAULT) is not None
    assert feedback_in(response(mixed, power=power), DEFAULT) is None


def test_a_step_up_beside_the_last_line_of_a_manoeuvre_is_no_growth() -> None:
    """Level up to there, and far higher behind it: no power of frequency goes through both."""
    step = np.where(FREQUENCY_HZ > 2.2, 4.0, 1.0) * 10.0 * np.exp(-0.02 * S)
    power = np.where(FREQUENCY_HZ > 2.2, 1e-4, FREQUENCY_HZ**4)
    assert feedback_in(response(step, power=power), DEFAULT) is None


def test_growth_across_a_third_octave_of_which_nothing_is_known_is_no_run() -> None:
    """Three on one side and one on the other make no octave in a row."""
    rising = np.arange(FREQUENCY_HZ.size) % 4 == 3
    error = np.where(rising, 0.9, 0.03)
    assert feedback_in(response(INVERSE_CONTROLLER), DEFAULT) is not None
    assert feedback_in(response(INVERSE_CONTROLLER, error), DEFAULT) is None


def test_feedback_is_all_that_is_seen_where_nothing_is_known_of_the_band() -> None:
    """A hover so calm that only noise is left."""
    mixed = np.where(FREQUENCY_HZ > 6.0, INVERSE_CONTROLLER, VEHICLE)
    error = np.where(FREQUENCY_HZ > 6.0, 0.03, 0.9)
    assert feedback_in(response(mixed, error), DEFAULT) is not None


def test_the_response_of_a_flight_is_that_of_its_vehicle() -> None:
    """Gain and phase of each third octave inside the manoeuvre; beyond, the controller answers noise."""
    roll, *_ = responses(fly(QUAD, multisine(60.0), feedback=8.0), by_setpoints=())
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


@pytest.mark.thorough
def test_slow_gusts_raise_the_lower_edge_of_the_band(model: Model) -> None:
    """To where the manoeuvre is."""
    assert model.band is not None
    assert 1.0 < model.band.low_hz[0] <= 2.0


@pytest.mark.thorough
def test_the_gain_of_a_flight_in_slow_gusts_is_right_above_them(model: Model) -> None:
    """What is left of the gusts there costs some per cent."""
    assert np.abs(error_of(model)).max() < 0.04


@pytest.mark.thorough
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


def sweep(duration_s: float, top_hz: float) -> np.ndarray:
    """Return torques with as much power in each octave up to a frequency; shape (n_samples, 3)."""
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, duration_s, PERIOD_S)
    lines_hz = np.geomspace(0.4, top_hz, 26)
    torque = np.zeros((time_s.size, 3))
    for axis in range(3):
        for line_hz in lines_hz * (1.0 + 0.03 * axis):
            torque[:, axis] += np.sin(2.0 * np.pi * line_hz * time_s + rng.uniform(0.0, 2.0 * np.pi))
    return 0.06 * torque * np.diag(QUAD.inertia) / 0.014


def bent(data: FlightData, mode_hz: float, part: float) -> FlightData:
    """Return a flight whose gyro sits on an arm that bends: a resonance beside the rigid body."""
    (segment,) = data.segments
    s = angular_frequency(segment.n_samples, PERIOD_S)[:, np.newaxis]
    w = 2.0 * np.pi * mode_hz
    mode = part * np.diag(QUAD.B) * s / (s**2 + 0.06 * w * s + w**2)
    mode = mode * np.exp(-s * QUAD.delay_s) / (1.0 + s * QUAD.lag_s)
    shaken = np.fft.irfft(np.fft.rfft(segment.torque, axis=0) * mode, segment.n_samples, axis=0)
    rate = segment.body_rate_rad_s + shaken
    return dataclasses.replace(data, segments=(dataclasses.replace(segment, body_rate_rad_s=rate),))


@pytest.fixture(scope="module")
def bending() -> FlightData:
    return bent(fly(QUAD, sweep(40.0, 10.0), feedback=8.0), 5.0, 0.1)


@pytest.mark.thorough
def test_a_mode_of_the_frame_lowers_the_upper_edge_and_the_error(bending: FlightData) -> None:
    """From 3.1 and 4.7 % on roll and pitch to under half of it."""
    free = identify(bending, IdentifySettings(), (DAMPED,)).models[0]
    fixed = identify(bending, IdentifySettings(smoothing_hz=5.0), (DAMPED,)).models[0]
    assert free.band is not None
    assert free.band.cutoff_hz[0] < 5.0
    assert (np.abs(error_of(free))[:2] < 0.5 * np.abs(error_of(fixed))[:2]).all()


@pytest.mark.thorough
def test_the_band_that_is_set_by_hand_is_the_one_that_is_fitted(gusty: FlightData) -> None:
    """Whatever the response says."""
    settings = in_band((0.5, 6.0), IdentifySettings())
    model = identify(gusty, settings, (DAMPED,)).models[0]
    assert model.band is not None
    assert (model.band.low_hz[0], model.band.cutoff_hz[0]) == (0.5, 6.0)


@pytest.mark.parametrize("high_hz", [200.0, 300.0])
def test_no_band_goes_up_to_half_the_sample_rate(gusty: FlightData, high_hz: float) -> None:
    """It is 400 Hz here."""
    with pytest.raises(SettingsError, match="resampled to 400 Hz"):
        identify(gusty, in_band((1.0, high_hz), IdentifySettings()), (DAMPED,))


def test_where_no_band_is_set_the_settings_stay() -> None:
    """None is what the command line gives without --band."""
    assert in_band(None, IdentifySettings(window=9)) == IdentifySettings(window=9)
