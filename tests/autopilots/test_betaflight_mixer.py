"""Betaflight's mixer: thrust linearisation and sag compensation between the PID sums and the outputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.actuation.airframe import Airframe
from quadid_logs.align import clean
from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.betaflight.airframe import find_airframe
from quadid_logs.autopilots.betaflight.mixer import highest_output, unmixed
from quadid_logs.autopilots.betaflight.signals import TO_FRD
from quadid_logs.autopilots.betaflight.torque import rebuild
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.result import Result
from quadid_logs.pipeline import analyze
from quadid_logs.simulator import SCENARIOS, Record, fly, plan_flights
from quadid_logs.simulator.control import thrust_of_throttle
from quadid_logs.simulator.logger import log_flights
from quadid_logs.vocabulary import AXES, ON_AXIS
from quadid_logs.writers import write_log
from tests.autopilots.test_betaflight import MIX, SAG


@pytest.fixture(scope="module")
def flown() -> Record:
    """Doublets with both settings, on a battery that is full."""
    (setup,) = plan_flights(
        SCENARIOS["doublets"], seed=1, duration_s=30.0, rate_hz=200.0, autopilot="betaflight"
    )
    effects = replace(setup.effects, thrust_linear=0.4, sag_compensation=1.0)
    return fly(replace(setup, effects=effects))


@pytest.fixture(scope="module")
def analysed(flown: Record, tmp_path_factory: pytest.TempPathFactory) -> Result:
    """From nothing but the file."""
    path = tmp_path_factory.mktemp("mixer") / "flight.bbl"
    write_log(log_flights((flown,), replace(SCENARIOS["doublets"].logging, rate_hz=200.0)), path)
    return analyze(path)


def effectiveness(record: Record) -> FloatArray:
    """Least squares of the flight's true control acceleration on the mixer's sums, on the axes."""
    setup, channels = record.setup, record.channels
    rows = (record.time_s > setup.schedule.manoeuvre_s) & (record.time_s < setup.schedule.land_s)
    frame = setup.airframe
    thrust = frame.rotor_thrust_n * thrust_of_throttle(
        channels["actuator"] * channels["voltage"], frame.thrust_expo
    )
    acceleration = np.linalg.solve(frame.inertia_kg_m2, frame.torque_per_thrust @ thrust[rows].T).T
    sums = np.column_stack([channels["achieved"][rows], np.ones(np.count_nonzero(rows))])
    return np.diag(np.linalg.lstsq(sums, acceleration, rcond=None)[0][:3])


@pytest.mark.thorough
@pytest.mark.parametrize("axis", AXES)
def test_gains_hold_with_linearised_outputs_that_a_full_battery_holds_back(
    axis: str, flown: Record, analysed: Result
) -> None:
    """A unit of the PID sums is a quarter less than without: none of it is in a parameter of the model."""
    model = analysed.identification.recommended
    assert model is not None
    low, high = model.entries[ON_AXIS[axis]].ci95
    true = effectiveness(flown)[AXES.index(axis)]
    assert low <= true <= high
    assert high - low < 0.1 * true


def near_full(voltage: float) -> tuple[FlightLog, FloatArray]:
    """Fly sums at much throttle on a battery; return how far beyond its stop a motor was asked, too."""
    rng = np.random.default_rng(0)
    sums, throttle = rng.integers(-150, 150, (4000, 3)) / 1000.0, rng.integers(500, 900, 4000) / 1000.0
    highest = float(highest_output(np.array([voltage]), SAG)[0])
    asked = throttle[:, None] + sums @ MIX.T
    # The log begins and ends with motors that idle, from which the flight is found.
    asked[:200] = asked[-200:] = 0.0
    outputs = np.rint(1889 * highest * np.clip(asked, 0.0, 1.0)) / 1889
    rows = Rows(5e-3 * np.arange(4000), np.arange(4000))
    columns = {
        "body_rate": rng.normal(0.0, 0.3, (4000, 3)),
        "torque_command": sums * TO_FRD,
        "throttle": throttle[:, None],
        "motor_thrust": outputs,
        "battery_voltage": np.full((4000, 1), voltage),
    }
    log = FlightLog(
        path="", format="blackbox", autopilot="betaflight", n_bytes=0, vehicle_type="multirotor",
        parameters=SAG | {"features": float(1 << 22)},
        signals={
            name: (Signal(name=name, source="main", reason="", rows=rows, values=values),)
            for name, values in columns.items()
        },
    )  # fmt: skip
    return log, (asked - 1.0).max(axis=1)


@pytest.mark.parametrize("voltage", [16.8, 15.4, 13.0])
def test_motors_that_sag_compensation_stops_are_at_their_limit(voltage: float) -> None:
    """With a full battery at five sixths of the range: no motor ever reached the end of it."""
    log, beyond = near_full(voltage)
    airframe = find_airframe(log)
    assert isinstance(airframe, Airframe)
    (series,) = rebuild(clean(log), airframe).series
    found = series.saturated.any(axis=1)[200:-200]
    beyond = beyond[200:-200]
    assert found[beyond > 0.1].all()
    assert not found[beyond < 0.0].any()


@pytest.mark.parametrize(
    ("autopilot", "firmware", "factor"),
    [
        ("betaflight", "Betaflight v4.3.1 (a) F4", 1.0),
        ("betaflight", "Betaflight v4.4.0 (a) F4", 0.6),
        ("betaflight", "Betaflight", 0.6),
        ("inav", "INAV v9.0.1 (a) F7", 1.0),
    ],
)
def test_only_since_4_4_sums_count_less_without_airmode(autopilot: str, firmware: str, factor: float) -> None:
    """Before, and in INAV, the mixer takes all of them at low throttle too."""
    frame = Airframe(
        name="quad X",
        source="",
        factors=np.column_stack([MIX * TO_FRD, np.ones(4)]),
        position=np.column_stack([-MIX[:, 1], -MIX[:, 0], np.zeros(4)]) / np.sqrt(2.0),
        spin=np.sign(MIX[:, 2]),
    )
    sums, throttle = np.array([[0.05, -0.02, 0.01]]), np.array([0.1])
    log = FlightLog(
        path="",
        format="blackbox",
        autopilot=autopilot,
        n_bytes=0,
        signals={},
        firmware=firmware,
        parameters={"features": 0.0},
    )
    outputs = throttle[:, None] + factor * sums @ (MIX * TO_FRD).T
    np.testing.assert_allclose(unmixed(outputs, throttle, frame, log), sums, rtol=1e-9)
