"""The script that flies a plan: whatever ends it, parameters return and no sweep exceeds its limit."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import cache, partial

import lupa.lua53
import lupa.lua54
import numpy as np
import pytest

from quadid_logs.autopilots.ardupilot.flight_script import flight_script
from quadid_logs.maths.multisine import orthogonal
from tests.autopilots.scripted_copter import (
    DEFAULTS,
    GUIDED,
    LAND,
    LOOP_S,
    RTL,
    STABILIZE,
    SYSTEM_ID,
    Copter,
)
from tests.marks import thorough_but

LIMITS = {10: 0.06, 11: 0.07, 12: 0.2}
MAGNITUDES = {10: 0.03, 11: 0.07, 12: 0.15}
RECORD_S = 5.0
RATE_LIMIT_DPS = 20.0


def sweep(axis: int, name: str) -> dict[str, float | str]:
    """Return one sweep of a plan, short, so that a flight is."""
    return {
        "name": name,
        "limit": LIMITS[axis],
        "SID_AXIS": axis,
        "SID_MAGNITUDE": MAGNITUDES[axis],
        "SID_F_START_HZ": 0.5,
        "SID_F_STOP_HZ": 20.0,
        "SID_T_FADE_IN": 1.0,
        "SID_T_REC": RECORD_S,
        "SID_T_FADE_OUT": 1.0,
    }


@cache
def script(*, multisine: bool = False) -> str:
    """Return a script of three sweeps and a multisine of 2 x 4 s."""
    sines = orthogonal(((3.0, 40.0), (3.0, 40.0), (3.0, 40.0)), 8)
    text = flight_script(
        [sweep(10, "roll"), sweep(11, "pitch"), sweep(12, "yaw")],
        {
            "period_s": 4.0,
            "periods": 2,
            "scale_dps": [RATE_LIMIT_DPS / one.peak for one in sines],
            "limit_dps": [RATE_LIMIT_DPS] * 3,
            "lines": [
                list(zip((one.harmonics / 4.0).tolist(), one.phases.tolist(), strict=True)) for one in sines
            ],
        },
    )
    return text.replace("FLY_MULTISINE = false", "FLY_MULTISINE = true") if multisine else text


def starting(event: Callable[[Copter], None], event_s: float) -> Callable[[Copter], None]:
    """Return what turns the switch on; `event` comes later."""

    def start(copter: Copter) -> None:
        copter.switch = 2
        plain = copter.main_loop

        def watched() -> None:
            plain()
            if copter.time_s >= event_s and not getattr(copter, "happened", False):
                copter.happened = True  # type: ignore[attr-defined]
                event(copter)

        copter.main_loop = watched  # type: ignore[method-assign]

    return start


def lost_link(copter: Copter) -> None:
    """Lose the radio; its failsafe takes over a moment later or at once."""
    copter.link = False
    if copter.rng.random() < 0.5:
        copter.change_mode(RTL)


def error(copter: Copter) -> None:
    """Let calls of the interface fail and be refused, as a full heap makes them."""
    copter.broken, copter.refused = 0.02, 0.1


def stuck(copter: Copter) -> None:
    """Ask it to end where no other mode can be entered, and its first order is lost."""
    copter.switch, copter.modes_refused, copter.refused = 0, True, 0.5


EVENTS: dict[str, Callable[[Copter], None]] = {
    "switch": lambda copter: setattr(copter, "switch", int(copter.rng.integers(0, 2))),
    "tilt": lambda copter: setattr(copter, "roll_rad", math.radians(40.0)),
    "low": lambda copter: setattr(copter, "height_m", 2.0),
    "no height": lambda copter: setattr(copter, "height_m", None),
    "battery": lambda copter: setattr(copter, "battery_percent", 20),
    "battery failsafe": lambda copter: setattr(copter, "battery_failsafe", True),
    "link": lost_link,
    "pilot": lambda copter: copter.change_mode(int(copter.rng.choice([STABILIZE, 5]))) and None,
    "disarmed": lambda copter: setattr(copter, "armed", False),
    "error": error,
    "stuck": stuck,
    "nothing": lambda _: None,
}


def flight(number: int) -> tuple[Copter, str, dict[str, float]]:
    """Fly once: what happens and when, and what was set before, is drawn."""
    rng = np.random.default_rng([number, *b"flight script"])
    name = str(rng.choice(list(EVENTS)))
    flown = DEFAULTS | {
        "SID_AXIS": float(rng.choice([0, 1, 10, 12])),
        "SID_MAGNITUDE": float(rng.choice([15.0, 0.5])),
    }
    multisine = bool(rng.random() < 0.5)
    copter = Copter(rng=rng, parameters=dict(flown), rate_targets=bool(rng.random() < 0.8))
    copter.refused = float(rng.choice([0.0, 0.01]))
    event = starting(EVENTS[name], 1.0 + rng.uniform(0.0, 38.0))
    copter.run(script(multisine=multisine), 46.0, event, 1.0)
    # What made the calls fail ends, and so does the test.
    copter.broken = copter.refused = 0.0
    copter.switch = 0
    return copter, name, flown


@pytest.mark.parametrize("number", thorough_but(range(50), range(200)))
def test_every_flight_gives_back_every_parameter_and_keeps_every_limit(number: int) -> None:
    """Flights that end at any time by switch, tilt, height, battery, link, pilot, or error."""
    copter, name, flown = flight(number)
    assert {key: copter.parameters[key] for key in flown} == pytest.approx(flown, rel=1e-6), name
    assert all(magnitude <= LIMITS[axis] * (1.0 + 1e-6) for axis, magnitude in copter.injected), name
    assert not copter.testing, name
    assert name == "stuck" or copter.mode not in (SYSTEM_ID, GUIDED), name


@pytest.mark.parametrize("version", [lupa.lua53, lupa.lua54])
def test_an_interpreter_accepts_the_script(version: object) -> None:
    """ArduPilot runs Lua 5.3; nothing of it is newer."""
    runtime = version.LuaRuntime()  # type: ignore[attr-defined]
    check = runtime.eval("function(text) return load(text) ~= nil end")
    assert check(script(multisine=True))


def flown_through(*, multisine: bool = False) -> Copter:
    """Fly to the end."""
    copter = Copter(rng=np.random.default_rng(1))
    copter.run(script(multisine=multisine), 50.0, starting(lambda _: None, 1e9), 1.0)
    return copter


def test_an_undisturbed_flight_sweeps_every_axis_for_its_time() -> None:
    """Roll, pitch, yaw; the mode's own record is over before the script leaves it."""
    copter = flown_through()
    for axis, magnitude in MAGNITUDES.items():
        flown = [size for number, size in copter.injected if number == axis]
        assert len(flown) * LOOP_S == pytest.approx(RECORD_S, abs=0.1)
        assert set(flown) == {float(np.float32(magnitude))}
    assert copter.mode == STABILIZE


def test_the_script_logs_when_each_sweep_begins() -> None:
    """Its own table: the phase, the axis and its magnitude."""
    rows = [row for row in flown_through().rows if row[0] == "QIDX"]
    assert [(row[3], row[5]) for row in rows] == [("sweep", 10), ("sweep", 11), ("sweep", 12), ("end", 0)]


def test_names_and_columns_of_its_tables_fit_a_log() -> None:
    """Four letters and 64 characters at most; as many letters of the format as columns and as values."""
    for name, labels, letters, *values in flown_through(multisine=True).rows:
        assert len(name) == 4
        assert len(f"TimeUS,{labels}") <= 64
        assert len(labels.split(",")) == len(letters) == len(values)


def test_the_multisine_keeps_its_rate_limit_and_is_periodic() -> None:
    """Beside what levels the vehicle: roll 0.02 rad and pitch 0.01 rad at 2 / s."""
    copter = flown_through(multisine=True)
    added = np.array([row[4:7] for row in copter.rows if row[0] == "QIDM"])
    time_s = np.array([row[3] for row in copter.rows if row[0] == "QIDM"])
    assert len(added) > 500
    assert np.abs(added).max() <= RATE_LIMIT_DPS * (1.0 + 1e-6)
    first, second = ((time_s >= 1.0 + 4.0 * k) & (time_s < 5.0 + 4.0 * k) for k in range(2))
    again = [np.interp(time_s[first] + 4.0, time_s[second], column[second]) for column in added.T]
    assert np.corrcoef(np.array(again)[0][:-5], added[first][:-5, 0])[0, 1] > 0.99


def test_without_rate_targets_of_the_firmware_the_flight_ends_after_its_sweeps() -> None:
    """Before 4.6 the name does not exist."""
    copter = Copter(rng=np.random.default_rng(1), rate_targets=False)
    copter.run(script(multisine=True), 50.0, starting(lambda _: None, 1e9), 1.0)
    assert not copter.targets
    assert copter.mode == STABILIZE


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"height_m": 2.0}, "height"),
        ({"battery_percent": 20}, "battery"),
        ({"mode": RTL}, "mode"),
        ({"armed": False}, "disarmed"),
    ],
)
def test_a_flight_that_may_not_begin_touches_nothing(changes: dict[str, float], words: str) -> None:
    """It says why."""
    copter = Copter(rng=np.random.default_rng(1), **changes)  # type: ignore[arg-type]
    copter.run(script(), 5.0, starting(lambda _: None, 1e9), 1.0)
    assert copter.parameters == DEFAULTS
    assert not copter.injected
    assert any(words in text for text in copter.texts)


def test_a_switch_that_is_on_at_the_start_has_to_be_released_first() -> None:
    """A restart with the switch on would begin by itself."""
    copter = Copter(rng=np.random.default_rng(1), switch=2)
    copter.run(script(), 10.0, lambda _: None, 1.0)
    assert not copter.injected


def test_a_lost_link_ends_in_land_where_no_failsafe_takes_over() -> None:
    """Stabilize without a pilot would be none."""
    copter = Copter(rng=np.random.default_rng(1))
    copter.run(script(), 20.0, starting(lambda one: setattr(one, "link", False), 8.0), 1.0)
    assert copter.mode == LAND


@pytest.mark.parametrize("mode", [RTL, 5])
def test_a_mode_that_pilot_or_failsafe_have_chosen_stays(mode: int) -> None:
    """The script leaves only what it has entered."""
    copter = Copter(rng=np.random.default_rng(1))
    copter.run(script(), 20.0, starting(lambda one: one.change_mode(mode) and None, 8.0), 1.0)
    assert copter.mode == mode


def test_a_magnitude_that_the_ground_station_raises_ends_the_sweep() -> None:
    """Within two rounds of the script."""
    copter = Copter(rng=np.random.default_rng(1))
    raised = partial(Copter.set_parameter, name="SID_MAGNITUDE", value=1.0)
    copter.run(script(), 20.0, starting(lambda one: raised(one) and None, 8.0), 1.0)
    assert sum(size > LIMITS[axis] * 1.001 for axis, size in copter.injected) * LOOP_S < 0.03
    assert copter.parameters == DEFAULTS


def test_the_script_saves_nothing() -> None:
    """A restart brings back what the vehicle had."""
    assert not re.search(r"set_and_save|:save", script(multisine=True))
