"""Off-nominal vehicles against the physics that they follow, and the limits that are held in them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from quadid_logs.autopilots import named
from quadid_logs.control.off_nominal import Factors, FlownPoint, changed, conditions, factors
from quadid_logs.control.scaled_loop import HeldLoops, Kept, scaled_loops, spare
from quadid_logs.data.closed_loop import LoopMargins, Plant
from quadid_logs.data.log import FlightLog
from quadid_logs.data.off_nominal import (
    AS_COMMANDED,
    AS_FLOWN,
    Condition,
    ConditionKind,
    Ranges,
    ThrustLaw,
    checked,
)
from quadid_logs.data.tuning import GOOD, AxisTuning
from quadid_logs.errors import SettingsError
from quadid_logs.simulator import fly, plan_flights
from quadid_logs.simulator.closed_loop import Setup
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.simulator.truth import flight_truth
from quadid_logs.tuning import recommend
from tests.control.loop_flights import Vehicle
from tests.marks import thorough
from tests.tuned_flights import RATE_HZ, SCENARIO, as_flown, flown

#: Propellers whose thrust goes with the square of the command, known exactly.
SQUARE = FlownPoint(
    law=AS_COMMANDED, command=0.5, expo=1.0, voltage_v=16.8, highest_v=16.8, lowest_v=16.0, n_cells=4
)


def law_of(autopilot: str, parameters: Mapping[str, float]) -> ThrustLaw:
    log = FlightLog(path="", format="", autopilot=autopilot, n_bytes=0, signals={}, parameters=parameters)
    return named(autopilot).thrust_law(log, parameters)


#: A firmware that undoes that square.
UNDONE = replace(SQUARE, law=law_of("px4", {"THR_MDL_FAC": 1.0}))
KIND = ConditionKind.HEAVIER


def effectiveness(point: FlownPoint, **otherwise: float) -> float:
    return float(factors(point, Condition(KIND, **otherwise), 1).effectiveness[0])


@pytest.mark.parametrize("scale", [0.5, 0.8, 1.25])
def test_a_gain_times_s_takes_20_log_s_of_the_gain_margin(scale: float) -> None:
    """By the definition of the margin."""
    plant = Plant(*(np.array([one]) for one in (250.0, -2.0, 0.03, 0.003)))
    ones = np.ones(1)
    other = changed(plant, Factors(scale * ones, ones, ones, ones))
    before, after = (scaled_loops(Vehicle().controller, one, np.inf).margins().rate for one in (plant, other))
    assert before.gain_margin_db is not None
    assert after.gain_margin_db is not None
    expected = before.gain_margin_db.value - 20.0 * math.log10(scale)
    assert after.gain_margin_db.value == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("otherwise", "power"),
    [
        ({"mass": 1.44, "inertia": 1.44}, 1.0 / 1.2),  # twice the slope of a square at twice the command
        ({"mass": 1.44}, 1.2),
        ({"density": 0.81}, 0.9),
        ({"voltage": 0.9}, 0.9),
        ({"propeller": 1.1}, 1.21),
    ],
)
def test_square_thrust_changes_as_the_textbook_says(otherwise: dict[str, float], power: float) -> None:
    """T = c (u v)^2 at the same weight: dT/du goes with the root of c times the weight, and with v."""
    assert effectiveness(SQUARE, **otherwise) == pytest.approx(power, rel=1e-6)


@pytest.mark.parametrize(
    ("otherwise", "expected"),
    [
        ({"mass": 1.44, "inertia": 1.44}, 1.0 / 1.44),
        ({"mass": 1.44}, 1.0),
        ({"density": 0.81}, 0.81),
        ({"voltage": 0.9}, 0.81),
        ({"propeller": 1.1}, 1.1**4),
    ],
)
def test_a_firmware_that_undoes_the_curve_leaves_the_scale_of_thrust(
    otherwise: dict[str, float], expected: float
) -> None:
    """Thrust is in proportion to the command: only what multiplies it, and the inertia, are left."""
    assert effectiveness(UNDONE, **otherwise) == pytest.approx(expected, rel=2e-3)


def test_a_torque_of_drag_goes_with_one_more_power_of_the_diameter() -> None:
    """Drag torque over thrust is a length: c goes with D^4, q with D^5."""
    larger = Condition(KIND, propeller=1.1)
    ratio = [factors(SQUARE, larger, 1, by_drag=one).effectiveness[0] for one in (True, False)]
    assert ratio[0] / ratio[1] == pytest.approx(1.1)


def test_a_motor_held_by_its_voltage_alone_is_late_by_the_rotor_s_inertia() -> None:
    """J / (k_t k_e / R): D^5, and half of the logarithm of that, for what a speed controller may hold."""
    lag = factors(SQUARE, Condition(KIND, propeller=1.1), 201).lag
    assert lag[0] == pytest.approx(1.1**2.5, rel=1e-6)
    assert lag.min() >= 1.0
    assert lag.max() <= 1.1**5 * (1.0 + 1e-9)


def test_a_motor_held_by_drag_alone_is_quicker_the_faster_it_turns() -> None:
    """J / (2 q x), and x goes with the root of the weight."""
    slow = replace(SQUARE, expo=0.0)
    assert factors(slow, Condition(KIND, mass=1.44), 1).lag[0] == pytest.approx(1.2**-0.5, rel=1e-5)


def test_the_lead_of_yaw_goes_with_the_inverse_of_the_rotors_speed() -> None:
    """J / (2 k q x)."""
    assert factors(SQUARE, Condition(KIND, mass=1.44), 1).lead[0] == pytest.approx(1.0 / 1.2, rel=1e-6)


def ardupilot_law(**parameters: float) -> ThrustLaw:
    return law_of("ardupilot", {"MOT_THST_EXPO": 1.0, "MOT_SPIN_MIN": 0.1, **parameters})


def test_a_battery_that_is_made_up_for_changes_nothing() -> None:
    """MOT_BAT_VOLT_MAX and _MIN: outputs are divided by the voltage that is left."""
    point = replace(SQUARE, law=ardupilot_law(MOT_BAT_VOLT_MAX=16.8, MOT_BAT_VOLT_MIN=13.2))
    assert effectiveness(point, voltage=0.85) == pytest.approx(1.0, rel=1e-3)


def test_a_battery_below_what_is_made_up_for_weakens() -> None:
    """Only from MOT_BAT_VOLT_MIN on, which is 0.9 of the full voltage here."""
    point = replace(SQUARE, law=ardupilot_law(MOT_BAT_VOLT_MAX=16.8, MOT_BAT_VOLT_MIN=15.12))
    assert effectiveness(point, voltage=0.81) == pytest.approx(0.81, rel=2e-3)


def test_air_that_is_made_up_for_changes_nothing() -> None:
    """ArduPilot divides the command by the density ratio of its barometer."""
    assert effectiveness(replace(SQUARE, law=ardupilot_law()), density=0.81) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize(("voltage_v", "factor"), [(16.2, 1.0), (16.8, 1.0), (13.5, 1.2), (10.0, 1.3)])
def test_px4_scales_by_the_charged_voltage_up_to_30_percent(voltage_v: float, factor: float) -> None:
    """4 cells of 4.05 V when charged (`Battery::computeScale`)."""
    law = law_of("px4", {"MC_BAT_SCALE_EN": 1.0, "BAT1_V_CHARGED": 4.05, "BAT1_N_CELLS": 4.0})
    assert law.before(voltage_v, 0) == pytest.approx(factor)


def test_px4_scales_nothing_by_itself() -> None:
    """MC_BAT_SCALE_EN is 0 by default."""
    assert law_of("px4", {"BAT1_N_CELLS": 4.0}).before(13.5, 4) == 1.0


def test_betaflight_s_whole_sag_compensation_holds_the_thrust() -> None:
    """From 4.2 V a cell to the warning at 3.5 V the output's range makes up for the voltage."""
    settings = {
        "vbat_sag_compensation": 100.0, "vbatcellvoltage[1]": 350.0, "vbatcellvoltage[2]": 430.0,
        "vbatref": 1680.0,
    }  # fmt: skip
    law = law_of("betaflight", settings)
    assert 16.8 * law.behind(16.8, 4) == pytest.approx(14.0 * law.behind(14.0, 4))


def test_nothing_is_off_nominal_in_ranges_of_one() -> None:
    """The battery's voltage was not logged."""
    assert not list(conditions(FlownPoint(law=AS_COMMANDED), AS_FLOWN))


def test_the_battery_is_told_from_full_to_empty() -> None:
    """4.2 and 3.5 V of each of four cells."""
    point = replace(SQUARE, voltage_v=15.2, highest_v=16.2, lowest_v=14.6)
    assert [one.voltage_v for one in conditions(point, AS_FLOWN)] == pytest.approx([16.8, 14.0])


@pytest.mark.parametrize("mass", [(1.1, 1.5), (0.5, 0.9), (0.0, 1.2), (math.nan, 1.2), (0.8, math.inf)])
def test_a_range_without_the_vehicle_that_flew_is_refused(mass: tuple[float, float]) -> None:
    """A range tells how far the vehicle may leave what it flew with."""
    with pytest.raises(SettingsError):
        checked(Ranges(mass=mass))


def test_a_vehicle_that_kept_less_is_asked_for_no_more() -> None:
    """What flew below the limits may stay there, and no change takes it further down."""
    assert Kept(1.5, 0.7).enough == Kept(1.0, 0.7)
    assert Kept(0.9, 1.4).enough == Kept(0.9, 1.0)


def test_the_part_that_is_asked_for_is_what_flew() -> None:
    """Then the flown gains keep exactly all of it."""
    plant = Plant(*(np.array([one]) for one in (250.0, -2.0, 0.03, 0.003)))
    loops, other = (scaled_loops(Vehicle().controller, one, np.inf) for one in (plant, plant.times(3.0)))
    held = HeldLoops(loops, (other,))
    assert held.kept(GOOD).otherwise < 1.0
    assert held.no_less_than_flown(GOOD).kept(GOOD).otherwise == pytest.approx(1.0)


def test_gains_that_lack_margin_in_another_condition_alone_are_not_kept() -> None:
    """As the vehicle flies they would do."""
    plant = Plant(*(np.array([one]) for one in (250.0, -2.0, 0.03, 0.003)))
    controller = Vehicle().controller
    loops, other = (scaled_loops(controller, one, np.inf) for one in (plant, plant.times(3.0)))
    enough = HeldLoops(loops, (loops,)).kept(GOOD)
    assert HeldLoops(loops, (loops,)).keep(GOOD, enough)
    assert HeldLoops(loops, (loops,)).keep_with(controller, GOOD, enough)
    assert not HeldLoops(loops, (other,)).keep(GOOD, enough)
    assert not HeldLoops(loops, (other,)).keep_with(controller, GOOD, enough)
    assert not HeldLoops(other, (loops,)).keep(GOOD, enough)


# The rest flies.


@cache
def otherwise(autopilot: str, mass: float) -> Setup:
    """The scenario's vehicle with another mass and inertia."""
    (setup,) = plan_flights(SCENARIO, seed=1, duration_s=20.0, rate_hz=RATE_HZ, autopilot=autopilot)
    frame = setup.airframe
    heavier = replace(frame, mass_kg=mass * frame.mass_kg, inertia_kg_m2=mass * frame.inertia_kg_m2)
    return replace(setup, airframe=heavier)


@cache
def true_vehicle(autopilot: str, mass: float, axis: int) -> Plant:
    """What a flight of that vehicle truly is, about its hover."""
    setup = otherwise(autopilot, mass)
    return true_plant(setup, flight_truth((fly(setup),), scenario="", boot_s=0.0), axis)


@cache
def tuned(autopilot: str) -> AxisTuning:
    return recommend(flown(autopilot), GOOD, ["roll"]).axes["roll"]


def whole(margins: LoopMargins) -> tuple[float, float, float]:
    loop = margins.full
    assert loop is not None
    assert loop.gain_margin_db is not None
    assert loop.phase_margin_deg is not None
    assert loop.disk_margin is not None
    return loop.gain_margin_db.value, loop.phase_margin_deg.value, loop.disk_margin.value


KINDS = {0.8: ConditionKind.LIGHTER, 1.2: ConditionKind.HEAVIER}


@pytest.mark.parametrize("mass", [0.8, 1.2])
@pytest.mark.parametrize("autopilot", ["ardupilot", thorough("px4")])
def test_the_true_margins_of_another_mass_lie_in_what_is_told(autopilot: str, mass: float) -> None:
    """A vehicle of another mass and inertia flies with the same gains."""
    controller = true_controller(otherwise(autopilot, 1.0), 0)
    true = whole(scaled_loops(controller, true_vehicle(autopilot, mass, 0), np.inf).margins())
    (told,) = (one.now.full for one in tuned(autopilot).off_nominal if one.condition.kind is KINDS[mass])
    assert told is not None
    for value, figure in zip(
        true, (told.gain_margin_db, told.phase_margin_deg, told.disk_margin), strict=True
    ):
        assert figure is not None
        assert figure.ci95[0] <= value <= figure.ci95[1]


@pytest.mark.parametrize("mass", [0.8, 1.2])
@pytest.mark.parametrize("autopilot", ["ardupilot", thorough("px4")])
def test_the_next_gains_keep_the_limits_in_the_true_loop_of_another_mass(autopilot: str, mass: float) -> None:
    """What is promised of the worst case is true of the vehicle."""
    found, result = tuned(autopilot), flown(autopilot)
    after = as_flown(result, **{name: one.next for name, one in found.changes.items()})
    assert after.closed_loop is not None
    controller = after.closed_loop.controllers.axes["roll"]
    assert found.changes
    assert spare(scaled_loops(controller, true_vehicle(autopilot, mass, 0), np.inf).margins(), GOOD) >= 1.0


@pytest.mark.parametrize("autopilot", ["ardupilot", thorough("px4")])
def test_the_next_gains_keep_the_limits_in_every_condition_or_what_flew_of_them(autopilot: str) -> None:
    """But for the rounding of the search."""
    found = tuned(autopilot)
    assert len(found.off_nominal) >= 6
    for one in found.off_nominal:
        assert one.next is not None
        assert spare(one.next, GOOD) >= min(1.0, spare(one.now, GOOD)) - 0.02


def test_the_condition_that_keeps_least_is_the_worst() -> None:
    """One of them, with the next gains."""
    told = tuned("ardupilot").off_nominal
    (worst,) = (one for one in told if one.worst)
    assert worst.next is not None
    assert spare(worst.next, GOOD) == min(spare(one.next, GOOD) for one in told if one.next is not None)


def test_without_ranges_the_next_gains_reject_gusts_better() -> None:
    """What the limits cost that are held beyond this flight's vehicle."""
    alone = recommend(flown("ardupilot"), GOOD, ["roll"], ranges=AS_FLOWN).axes["roll"]
    assert not alone.off_nominal
    assert alone.attitude_error < tuned("ardupilot").attitude_error


@pytest.mark.thorough
def test_gains_that_break_a_limit_off_nominal_alone_are_not_lowered() -> None:
    """Uncertainty lowers nothing, nor does a load that may never be flown; it is told."""
    result = flown("px4")
    alone = recommend(result, GOOD, ["roll"], apart=False, ranges=AS_FLOWN).axes["roll"]
    best = as_flown(result, **{name: one.target for name, one in alone.gains.items()})
    found = recommend(best, GOOD, ["roll"], apart=False).axes["roll"]
    assert found.verdict == "keep"
    assert "QL675" in [one.code for one in found.reasons]
