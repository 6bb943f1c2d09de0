"""Transfer functions of the loop: against the formulas they come from, and against loops that were flown."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.autopilots import named
from quadid_logs.control.closed_loop import close_loop
from quadid_logs.control.loop import close, integrators
from quadid_logs.control.margins import figures_of, grid_hz
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.model import Identification
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify
from tests.control.flown_controller import ApFlight, Px4Flight
from tests.control.loop_flights import AXES, PERIOD_S, Vehicle, controllers, flight

F = np.geomspace(0.1, 190.0, 300)
B, A, LAG, DELAY = 440.0, -2.0, 0.02, 0.003


def one(B: float = B, A: float = A, lag_s: float = LAG, delay_s: float = DELAY) -> Plant:
    return Plant(*(np.array([value]) for value in (B, A, lag_s, delay_s)))


def low_pass(f: np.ndarray, cutoff_hz: float, T: float) -> np.ndarray:
    a = 1.0 if cutoff_hz <= 0 else T / (T + 1 / (2 * np.pi * cutoff_hz))
    return a / (1 - (1 - a) * np.exp(-2j * np.pi * f * T))


def butterworth(f: np.ndarray, cutoff_hz: float, T: float) -> np.ndarray:
    z1, o = np.exp(-2j * np.pi * f * T), np.tan(np.pi * cutoff_hz * T)
    c = 1 + np.sqrt(2) * o + o * o
    poles = 1 + 2 * (o * o - 1) / c * z1 + (1 - np.sqrt(2) * o + o * o) / c * z1**2
    return o * o / c * (1 + z1) ** 2 / poles


def body(f: np.ndarray, T: float) -> np.ndarray:
    s = 2j * np.pi * f
    hold = np.exp(-1j * np.pi * f * T) * np.sinc(f * T)
    return hold * B / (s - A) / (1 + LAG * s) * np.exp(-s * DELAY)


def test_the_ardupilot_loop_is_that_of_its_equations() -> None:
    """P, I and D act on the error; the angle loop skips the gyro filter, and comes a loop later."""
    log = ApFlight().log()
    p, controller = log.parameters, named("ardupilot").controllers(log, log.parameters).axes["roll"]
    T, Tg = controller.period_s, controller.gyro[0].period_s
    z1 = np.exp(-2j * np.pi * F * T)
    pid = p["ATC_RAT_RLL_P"] + p["ATC_RAT_RLL_I"] * T / (1 - z1)
    pid = pid + p["ATC_RAT_RLL_D"] * (1 - z1) / T * low_pass(F, p["ATC_RAT_RLL_FLTD"], T)
    rate = pid * body(F, T) * butterworth(F, p["INS_GYRO_FILTER"], Tg)
    angle = p["ATC_ANG_RLL_P"] / (2j * np.pi * F) * z1
    full = rate + pid * body(F, T) * low_pass(F, p["ATC_RAT_RLL_FLTT"], T) * angle
    loop = close(controller, one(), F)
    assert loop.full is not None
    np.testing.assert_allclose(loop.rate[0], rate, rtol=1e-9)
    np.testing.assert_allclose(loop.full[0], full, rtol=1e-9)


def test_the_px4_derivative_acts_on_the_rate_alone() -> None:
    """It closes the loop as P and I do, and a set-point does not pass it."""
    log = Px4Flight().log()
    p, controller = log.parameters, named("px4").controllers(log, log.parameters).axes["roll"]
    T, Tg = controller.period_s, controller.gyro[0].period_s
    z1, zg = np.exp(-2j * np.pi * F * T), np.exp(-2j * np.pi * F * Tg)
    on_error = p["MC_ROLLRATE_P"] + p["MC_ROLLRATE_I"] * T * z1 / (1 - z1)
    slope = p["MC_ROLLRATE_D"] * (1 - zg) / Tg * low_pass(F, p["IMU_DGYRO_CUTOFF"], Tg)
    gyro = butterworth(F, p["IMU_GYRO_CUTOFF"], Tg)
    rate = (on_error + slope) * body(F, T) * gyro
    loop = close(controller, one(), F)
    np.testing.assert_allclose(loop.rate[0], rate, rtol=1e-9)
    np.testing.assert_allclose(loop.target_to_rate[0], on_error * body(F, T) * gyro / (1 + rate), rtol=1e-9)


def test_a_rate_loop_with_an_integral_term_has_one_integrator() -> None:
    assert integrators(AXES["roll"].controller) == 1
    assert integrators(Vehicle(I=0.0).controller) == 0


@pytest.fixture(scope="module")
def identified() -> Identification:
    return identify(flight(), IdentifySettings())


@pytest.mark.thorough
@pytest.mark.parametrize("axis", ["roll", "pitch", "yaw"])
def test_margins_from_an_identified_model_are_those_of_the_loop_that_flew(
    identified: Identification, axis: str
) -> None:
    """The identified delay contains half a loop's zero-order hold, which the loop's formulas have by
    themselves.

    Taken twice, it would cost 360 * crossover * 1.25 ms: more than the tolerance.
    """
    model = identified.recommended
    assert model is not None
    vehicle = AXES[axis]
    found = close_loop(flight(), model, controllers(), {}, low_hz=0.3).axes[axis]
    frequency_hz = grid_hz(PERIOD_S)
    truth = one(vehicle.B, vehicle.A, vehicle.lag_s, vehicle.delay_steps * PERIOD_S)
    loop = close(vehicle.controller, truth, frequency_hz)
    true = figures_of(frequency_hz, loop.rate, 1, np.array([False]))
    assert found.margins is not None
    rate = found.margins.rate
    assert rate.crossover_hz is not None
    assert rate.phase_margin_deg is not None
    assert rate.gain_margin_db is not None
    assert rate.crossover_hz.value == pytest.approx(true.crossover_hz[0], rel=0.02)
    phase_deg = float(np.degrees(true.phase_margin_rad[0]))
    assert rate.phase_margin_deg.value == pytest.approx(phase_deg, abs=0.5)
    assert rate.gain_margin_db.value == pytest.approx(20 * np.log10(true.gain_margin[0]), abs=0.2)
    assert rate.phase_margin_deg.ci95[0] <= phase_deg <= rate.phase_margin_deg.ci95[1]


def test_accelerating_rotors_turn_the_vehicle_before_their_drag_does() -> None:
    """Yaw leads by (1 + s T), whatever else there is."""
    frequency_hz = np.array([0.5, 4.0])
    plain = one()
    ratio = plain._replace(lead_s=0.04).response(frequency_hz, 0.0025) / plain.response(frequency_hz, 0.0025)
    np.testing.assert_allclose(ratio[0], 1.0 + 2j * np.pi * frequency_hz * 0.04, rtol=1e-12)


def test_for_verdicts_the_loop_predicts_the_flight_and_tells_no_margins(
    identified: Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What contradicts the model is heard; the rest is not worked out."""
    told = object()
    monkeypatch.setattr("quadid_logs.control.closed_loop.predict", lambda *_: told)
    model = identified.recommended
    assert model is not None
    found = close_loop(flight(), model, controllers(), {}, low_hz=0.3, wanted="verdict").axes["roll"]
    assert found.prediction is told
    assert found.effectiveness is not None
    assert (found.margins, found.step, found.frame) == (None, None, None)
