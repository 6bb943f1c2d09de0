"""Simulated vehicles fly with the rate laws of the autopilots: their logs replay, or say what was done."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from quadid_logs.autopilots import named
from quadid_logs.control.replay import replay
from quadid_logs.data.controller import RemarkKind, Replay, ReplayReason
from quadid_logs.data.log import FlightLog
from quadid_logs.load import load
from quadid_logs.simulator import simulate
from quadid_logs.simulator.closed_loop import Tuning
from quadid_logs.simulator.control import Gains, rate_law, reset_rates
from quadid_logs.writers import write_log
from tests.control.flown_controller import AP_PID, ap_pid, motion
from tests.marks import thorough_but

SUFFIX = {"ardupilot": ".bin", "px4": ".ulg"}
STEP_S = 0.0025


def flown(tmp_path: Path, scenario: str, autopilot: str) -> tuple[FlightLog, dict[str, Replay]]:
    """Fly, write, read and replay."""
    path = tmp_path / f"flight{SUFFIX[autopilot]}"
    write_log(simulate(scenario, seed=1, duration_s=20.0, autopilot=autopilot).log, path)
    prepared = load(path)
    controllers = named(autopilot).controllers(prepared.log, prepared.log.parameters)
    assert controllers is not None
    inputs = named(autopilot).replay_inputs(prepared.log, controllers, prepared.flights)
    return prepared.log, replay(controllers, inputs, prepared.log.parameter_changes)


@pytest.mark.parametrize("autopilot", thorough_but(["ardupilot"], SUFFIX))
def test_a_simulated_flight_replays_from_its_file(tmp_path: Path, autopilot: str) -> None:
    _, found = flown(tmp_path, "doublets", autopilot)
    for axis, one in found.items():
        assert one.agrees, (axis, one)
        # The stamps jitter by 10 us; the simulated controller's own steps do not.
        assert one.relative_rms["output"] < 2e-3


@pytest.mark.parametrize("autopilot", thorough_but(["ardupilot"], SUFFIX))
def test_gains_changed_in_a_simulated_flight_are_named_from_its_file(tmp_path: Path, autopilot: str) -> None:
    log, found = flown(tmp_path, "gains-changed", autopilot)
    assert {one.reason for one in found.values()} == {ReplayReason.GAINS_CHANGED}
    change = next(one for one in log.parameter_changes if one.name.endswith("_P"))
    assert change.value / change.before == pytest.approx(1.5, rel=1e-6)
    assert log.parameters[change.name] == change.value
    assert log.parameters_at(0)[change.name] == change.before


def test_a_simulated_slew_limiter_is_told_by_its_logged_factor(tmp_path: Path) -> None:
    log, found = flown(tmp_path, "slew-limited", "ardupilot")
    roll = found["roll"]
    assert (roll.agrees, roll.reason) == (False, ReplayReason.SLEW_LIMITED)
    # With the logged factor the terms themselves are replayed.
    assert roll.relative_rms["P"] < 0.01
    controllers = named("ardupilot").controllers(log, log.parameters)
    assert controllers is not None
    assert {remark.kind for remark in controllers.remarks} == {RemarkKind.SLEW_LIMIT}


@pytest.mark.thorough
def test_a_detuned_filter_is_flown_and_in_the_parameters(tmp_path: Path) -> None:
    log, found = flown(tmp_path, "detuned-filter", "ardupilot")
    assert log.parameters["ATC_RAT_RLL_FLTE"] == 4.0
    assert found["roll"].relative_rms["P"] < 0.01


@pytest.mark.thorough
def test_a_chirp_at_the_mixer_is_told_from_the_controllers_output(tmp_path: Path) -> None:
    log, found = flown(tmp_path, "single-axis", "ardupilot")
    assert log.parameters["SID_AXIS"] == 10.0
    assert found["roll"].relative_rms["output"] < 0.01


def gains(**changed: float) -> Gains:
    every = {name: (AP_PID[short],) * 3 for name, short in PARTS.items()}
    return Gains(
        attitude=(4.5,) * 3,
        derivative_weight=(weight(20.0),) * 3,
        target_weight=weight(20.0),
        step_s=STEP_S,
        **every,
        **changed,
    )


PARTS = {"proportional": "P", "integral": "I", "derivative": "D"}


def weight(cutoff_hz: float) -> float:
    return STEP_S / (STEP_S + 1.0 / (2.0 * np.pi * cutoff_hz))


def run(autopilot: str, used: Gains, target: np.ndarray, rate: np.ndarray, limited: np.ndarray) -> np.ndarray:
    """Return P, I, D of the simulator's law over a series; shape (n, 3)."""
    law = rate_law(autopilot)
    memory = reset_rates((target[0],) * 3, (rate[0],) * 3)[0]
    rows = [(memory.proportional, memory.integral, memory.derivative)]
    for r, w, stopped in zip(target[1:], rate[1:], limited[1:], strict=True):
        memory = law(float(r), float(w), memory, used, 0, float(stopped))
        rows.append((memory.proportional, memory.integral, memory.derivative))
    return np.array(rows)


def test_the_simulated_ardupilot_law_is_that_of_ac_pid() -> None:
    n = 3000
    target, rate = motion(n, 5, 3.0)[:, 0], motion(n, 6)[:, 0]
    limited = np.random.default_rng(0).random(n) < 0.1
    found = run("ardupilot", gains(error_weight=weight(10.0)), target, rate, limited)
    pid = AP_PID | {"FLTE": 10.0}
    p, i, d, _ = ap_pid(target, rate, np.full(n, STEP_S), limited, pid)
    p[0] = 0.0  # the simulator's memory begins without an output
    np.testing.assert_allclose(found, np.column_stack([p, i, d]), atol=1e-12)


def test_the_simulated_px4_law_has_d_on_the_rate_and_integrates_late() -> None:
    step = np.r_[np.zeros(5), np.ones(5)]
    to_target = run("px4", gains(), step, np.zeros(10), np.zeros(10))
    assert not to_target[:, 2].any()
    assert to_target[5, 1] == 0.0
    assert to_target[6, 1] == pytest.approx(AP_PID["I"] * STEP_S * (1.0 - 1.0 / np.radians(400.0) ** 2))
    to_rate = run("px4", gains(), np.zeros(10), step, np.zeros(10))
    assert to_rate[5, 2] == pytest.approx(-AP_PID["D"] * weight(20.0) / STEP_S)


def test_the_px4_integrator_stops_only_in_the_direction_of_the_limit() -> None:
    ones = np.ones(20)
    pushed = run("px4", gains(), ones, 0.0 * ones, ones)
    assert not pushed[:, 1].any()


def test_the_slew_limiter_scales_a_fast_command_down_and_leaves_a_slow_one() -> None:
    time_s = STEP_S * np.arange(2000)
    slow, fast = np.sin(2.0 * np.pi * 0.5 * time_s), np.sin(2.0 * np.pi * 20.0 * time_s)
    free, held = gains(), gains(slew_limit=2.0)
    nothing = np.zeros(2000)
    for wave, factor in ((slow, 1.0), (fast, 0.5)):
        limited, plain = (run("ardupilot", used, nothing, wave, nothing) for used in (held, free))
        size = np.abs(limited[1000:, 0]).max() / np.abs(plain[1000:, 0]).max()
        assert size == 1.0 if factor == 1.0 else size < factor


def test_a_simulated_tuning_without_change_leaves_the_parameters_alone() -> None:
    flight = simulate("hover", seed=0, duration_s=15.0)
    assert flight.log.parameter_changes == ()
    assert Tuning().later_gain is None


def test_the_px4_integrator_stays_within_its_bound() -> None:
    ones = np.ones(4000)
    found = run("px4", gains(integral_limit=0.1), ones, 0.0 * ones, 0.0 * ones)
    assert found[:, 1].max() == 0.1
