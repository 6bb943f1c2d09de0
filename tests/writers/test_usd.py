"""Crazyflie micro-SD logs that are written: read back, by our reader and by an independent one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.data.log import FlightLog
from quadid_logs.load import read_log
from quadid_logs.simulator import simulate
from quadid_logs.writers.usd_writer import write_usd
from tests.containers import usd_maker as maker

from .conftest import flight

SIGNALS = ("body_rate", "body_rate_setpoint", "attitude", "torque_command", "throttle", "specific_force",
           "battery_voltage", "rotor_speed")  # fmt: skip


def by_lee(log: FlightLog) -> FlightLog:
    """Return the flight with a thrust in newtons, as the Lee controller commands it."""
    throttle = log.signals["throttle"][0]
    thrust = replace(throttle, name="thrust_n", values=0.4 * throttle.values)
    signals = {name: sources for name, sources in log.signals.items() if name != "throttle"}
    return replace(log, signals=signals | {"thrust_n": (thrust,)})


@pytest.mark.parametrize("make", [flight, lambda: by_lee(flight())], ids=["pid", "lee"])
def test_every_series_comes_back(
    make: Callable[[], FlightLog], written: Callable[[FlightLog, str], Path]
) -> None:
    """With its own rows, to the resolution of its type."""
    log = make()
    read = read_log(written(log, "a.usd"))
    assert (read.autopilot, read.format, read.lost, read.checksum_wrong) == ("crazyflie", "usd", (), False)
    for name in {*SIGNALS, "thrust_n"} & log.signals.keys():
        expected, found = log.signals[name][0], read.signals[name][0]
        np.testing.assert_allclose(found.time_s, expected.time_s, rtol=0.0, atol=0.51e-6)
        half_step = 0.5 * np.pi / 30.0 if name == "rotor_speed" else 0.0
        np.testing.assert_allclose(found.values, expected.values, rtol=3e-7, atol=half_step + 1e-6)


def test_arming_and_flying_come_back(written: Callable[[FlightLog, str], Path]) -> None:
    """The state at every row."""
    read = read_log(written(flight(), "a.usd"))
    for name, changes in (("armed", (13.0, 15.25)), ("landed", (13.25, 15.0))):
        state = read.signals[name][0]
        inside = (state.time_s >= changes[0]) & (state.time_s < changes[1])
        assert np.array_equal(state.values[:, 0] > 0.5, inside if name == "armed" else ~inside)


@pytest.mark.parametrize("version", [1, 2])
def test_the_file_is_as_the_description_says(version: int) -> None:
    """The independent reader finds the checksum right and the same values, in either version."""
    file = BytesIO()
    log = flight()
    write_usd(log, file, version=version)
    found = maker.read(file.getvalue())["fixedFrequency"]
    rate = log.signals["body_rate"][0]
    np.testing.assert_allclose(found["time"], rate.time_s, atol=1.01e-3 if version == 1 else 1e-6)
    np.testing.assert_allclose(found["controller.r_yaw"], -rate.values[:, 2], rtol=1e-6, atol=1e-7)


@pytest.mark.thorough
def test_a_simulated_flight_is_identified_from_its_file(tmp_path: Path) -> None:
    """Every effectiveness lies in its interval: commanded torque over inertia, as simulated."""
    from quadid_logs import analyze
    from quadid_logs.writers import write_log

    flown = simulate("sysid-quad-x", seed=3, rate_hz=250.0, autopilot="crazyflie")
    write_log(flown.log, tmp_path / "a.usd")
    found = analyze(tmp_path / "a.usd")
    truth = np.linalg.solve(flown.truth["vehicle"]["inertia_kg_m2"], flown.truth["torque_n_m_per_command"])
    for axis, name in enumerate(("roll", "pitch", "yaw")):
        assert found.verdict[name] == "usable"
        low, high = found.model[name, "LMN"[axis]].ci95
        assert low <= truth[axis, axis] <= high
