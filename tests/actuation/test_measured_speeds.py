"""Rotor speeds that were measured: the torque's first source where they are as dense as the commands."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from quadid_logs.align import Prepared, cut
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.model import Identification, Model
from quadid_logs.data.settings import AlignSettings, IdentifySettings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.diagnose.torque_findings import find_in_torque
from quadid_logs.identify import identify
from quadid_logs.load import load, prepare
from quadid_logs.simulator import find_scenario, fly, plan_flights
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.truth import flight_truth
from tests.analyses import Analyzed
from tests.identify.structures import ACTUATED

SAMPLES = Path(__file__).parents[2] / "sample_logs"
RATE_HZ, AGE_S, NOISE_RAD_S = 200.0, 0.012, 8.0
VEHICLE = Vehicle(mass_kg=1.5, arm_length_m=0.225, torque_to_thrust_m=0.016)


@cache
def flown(every: int) -> tuple[FlightLog, dict]:  # type: ignore[type-arg]
    """Return a flight with an expo of 0.2 instead of 0.6, and telemetry that is late and noisy."""
    (setup,) = plan_flights(find_scenario("expo-mismatch"), seed=4, duration_s=35.0, rate_hz=RATE_HZ)
    record = fly(setup)
    logging = Logging(rate_hz=RATE_HZ)
    truth = flight_truth((record,), scenario="expo-mismatch", boot_s=logging.boot_s)
    log = log_flights((record,), logging)
    rate = log.signals["body_rate"][0].rows
    when_s = logging.boot_s + record.time_s[::every] + AGE_S
    inside = (when_s > rate.time_s[0]) & (when_s < rate.time_s[-1])
    position = np.interp(when_s[inside], rate.time_s, rate.position).astype(np.int64) + 1
    speed = record.channels["rotor_speed"][::every][inside]
    speed = speed + NOISE_RAD_S * np.random.default_rng(1).standard_normal(speed.shape)
    telemetry = Signal(
        name="rotor_speed", rows=Rows(when_s[inside], position), values=speed, source="ESC.RPM"
    )
    return replace(log, signals={**log.signals, "rotor_speed": (telemetry,)}), truth


@cache
def read(vehicle: Vehicle | None = None) -> Prepared:
    """Return the flight as it is prepared, which compares both sources of torque, once for all tests."""
    return prepare(flown(2)[0], vehicle)


@cache
def found(vehicle: Vehicle | None = None) -> Model:
    data = cut(read(vehicle), AlignSettings())
    assert data.input is not None
    assert data.input.source == "ESC.RPM squared"
    model = identify(data, IdentifySettings(), ACTUATED).recommended
    assert model is not None
    return model


def test_the_motors_lag_is_in_the_speeds_and_not_found_again() -> None:
    """30 ms on commands; nothing is left, although telemetry came 12 ms late."""
    actuator = found().actuator
    assert actuator is not None
    assert actuator.lag_s < 0.003


def test_the_thrust_curve_of_the_firmware_no_longer_matters() -> None:
    """Effectiveness on the scale of the command, of which the speeds know nothing: within 2 %."""
    truth = np.diag(np.array(flown(2)[1]["models"]["damped"]["B"]))
    np.testing.assert_allclose(np.diag(found().B), truth, rtol=0.02)


@pytest.mark.thorough
def test_no_expo_is_looked_for_in_measured_thrust() -> None:
    """It goes with the square of speed."""
    data = cut(read(), AlignSettings())
    assert identify(data, IdentifySettings(), ACTUATED).thrust_curve is None


@pytest.mark.thorough
def test_inertia_follows_from_speeds_and_take_off_mass() -> None:
    """Within 2 % and in the interval."""
    inertia = found(VEHICLE).inertia
    assert inertia is not None
    truth = np.diag(np.array(flown(2)[1]["vehicle"]["inertia_kg_m2"]))
    np.testing.assert_allclose(np.diag(inertia.matrix), truth, rtol=0.02)
    assert (np.diag(inertia.ci95_low) <= truth).all()
    assert (truth <= np.diag(inertia.ci95_high)).all()


def test_slow_telemetry_is_no_input_and_says_so() -> None:
    """25 Hz beside commands of 200 Hz."""
    prepared = prepare(flown(16)[0])
    assert prepared.log.torque is not None
    assert (
        "logged at 25 Hz, too slowly for the model's input, which needs 160 Hz"
        in prepared.log.torque.rotor_speed
    )
    assert prepared.torque is not None
    assert "through the mixer" in prepared.torque.series.source


def test_commands_that_are_too_slow_tell_no_scale_of_speeds() -> None:
    """Telemetry of 20 Hz, outputs of 10 Hz: what doublets did between these was missing, and yaw 26 % low."""
    prepared = load(SAMPLES / "doublets.tlog")
    assert prepared.log.torque is not None
    assert "commands at 10 Hz are too slow to show their scale" in prepared.log.torque.rotor_speed
    assert prepared.torque is not None
    assert "servoN_raw" in prepared.torque.series.source


def test_a_thrust_stands_curve_goes_before_speeds() -> None:
    """It is over the motor command, which a speed does not tell."""
    throttle = np.linspace(0.0, 1.0, 11)
    given = replace(
        VEHICLE, thrust_curve=np.column_stack([throttle, 9.0 * (0.4 * throttle + 0.6 * throttle**2)])
    )
    prepared = prepare(flown(2)[0], given)
    assert prepared.torque is not None
    assert "ESC" not in prepared.torque.series.source


@pytest.mark.thorough
@pytest.mark.parametrize("vehicle", [None, VEHICLE])
def test_speeds_are_put_back_to_when_they_were_true(vehicle: Vehicle | None) -> None:
    """By the delay with which they follow the commands, to two samples."""
    prepared = read(vehicle)
    assert prepared.torque is not None
    logged_s = prepared.clean.sources("rotor_speed")[0].time_s
    shift_s = logged_s[0] - prepared.torque.series.time_s[0]
    assert shift_s == pytest.approx(AGE_S, abs=0.005)


@cache
def averaged() -> FlightLog:
    """Return the same flight with speeds that each ESC averages over 0.1 s, as some do."""
    log = flown(2)[0]
    (telemetry,) = log.signals["rotor_speed"]
    values = uniform_filter1d(telemetry.values, round(0.1 * RATE_HZ), axis=0)
    return replace(log, signals={**log.signals, "rotor_speed": (replace(telemetry, values=values),)})


@cache
def averaged_read() -> Prepared:
    return prepare(averaged())


@pytest.mark.thorough
def test_speeds_that_predict_the_flight_worse_than_the_motor_commands_are_no_input() -> None:
    """Roll and pitch came out 22 % high, and usable."""
    prepared = averaged_read()
    assert prepared.torque is not None
    assert "through the mixer" in prepared.torque.series.source


@pytest.mark.thorough
def test_where_measured_speeds_are_no_input_the_effectiveness_is_right() -> None:
    model = identify(cut(averaged_read(), AlignSettings()), IdentifySettings(), ACTUATED).recommended
    assert model is not None
    truth = np.diag(np.array(flown(2)[1]["models"]["damped"]["B"]))
    np.testing.assert_allclose(np.diag(model.B), truth, rtol=0.02)


@pytest.mark.thorough
def test_inertia_is_calibrated_by_the_motor_commands_where_they_are_the_input() -> None:
    """Not by the speeds that were not believed."""
    data = cut(prepare(averaged(), VEHICLE), AlignSettings())
    assert data.input is not None
    assert data.input.unit == "N m"
    model = identify(data, IdentifySettings(), ACTUATED).recommended
    assert model is not None
    assert model.inertia is not None
    truth = np.diag(np.array(flown(2)[1]["vehicle"]["inertia_kg_m2"]))
    np.testing.assert_allclose(np.diag(model.inertia.matrix), truth, rtol=0.02)


def test_two_sources_that_disagree_are_a_finding() -> None:
    """By how much, and that each ESC is to be checked; yaw, which agrees to 5 %, is not named."""
    prepared = averaged_read()
    data = cut(prepared, AlignSettings())
    (said,) = (each for each in find_in_torque(prepared.log, data, Identification()) if each.code == "QL312")
    assert said.level == "info"
    assert set(said.axes) == {"roll", "pitch"}
    assert said.evidence["other"] == "ESC.RPM squared"
    ratio = said.evidence["effectiveness_of_other_over_used"]
    assert isinstance(ratio, dict)
    assert ratio["roll"] == pytest.approx(1.22, abs=0.03)
    assert "ESC" in said.advice


@pytest.mark.thorough
def test_two_sources_that_agree_are_no_finding_and_the_speeds_stay() -> None:
    """Their noise leaves a thousandth unexplained, and the effectiveness is the same."""
    prepared = read()
    data = cut(prepared, AlignSettings())
    codes = [each.code for each in find_in_torque(prepared.log, data, Identification())]
    assert "QL312" not in codes
    assert data.input is not None
    assert data.input.source == "ESC.RPM squared"


def test_sources_between_which_the_flight_does_not_decide_are_a_caution() -> None:
    """Of two numbers nobody knows which one is right."""
    prepared = averaged_read()
    torque = prepared.log.torque
    assert torque is not None
    assert torque.comparison is not None
    undecided = replace(torque, comparison=replace(torque.comparison, decided=False))
    log = replace(prepared.log, torque=undecided)
    (said,) = (
        each
        for each in find_in_torque(log, cut(prepared, AlignSettings()), Identification())
        if each.code == "QL312"
    )
    assert said.level == "warning"
    assert "doublets" in said.advice


def test_a_log_with_one_source_is_not_fitted_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would cost every log what few need."""

    def never(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr("quadid_logs.load.compare_torques", never)
    without = {name: each for name, each in flown(2)[0].signals.items() if name != "rotor_speed"}
    assert prepare(replace(flown(2)[0], signals=without)).torque is not None
    assert prepare(flown(16)[0]).torque is not None


@pytest.mark.thorough
def test_speeds_that_a_simulator_made_up_give_way_to_the_motor_commands(
    corpus: Path, analyzed: Analyzed
) -> None:
    """12 to 17 % low and usable, with a lag of nothing in the place of 48 ms."""
    path = corpus / "firmware" / "px4_sih_hex_esc.ulg"
    truth = np.diag(json.loads(path.with_suffix(".truth.json").read_text())["B_rad_s2_per_torque_setpoint"])
    result = analyzed(path)
    (said,) = (each for each in result.diagnosis.findings if each.code == "QL312")
    assert set(said.axes) == {"roll", "pitch", "yaw"}
    model = result.identification.recommended
    assert model is not None
    assert model.actuator is not None
    np.testing.assert_allclose(np.diag(model.B), truth, rtol=0.01)
    assert model.actuator.lag_s == pytest.approx(0.048, abs=0.001)
