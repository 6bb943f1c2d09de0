"""Simulation of a nonlinear multirotor in closed loop, logged like a real vehicle, with known truth."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from quadid_logs.data.log import FlightLog
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.errors import SimulationError
from quadid_logs.simulator.airframes import adapted
from quadid_logs.simulator.closed_loop import Record, Schedule, Setup, fly
from quadid_logs.simulator.damage import Damage, damage_bytes
from quadid_logs.simulator.logger import log_flights
from quadid_logs.simulator.scenarios import SCENARIOS, Scenario
from quadid_logs.simulator.truth import flight_truth
from quadid_logs.simulator.vendors import motor_order, vendor

__all__ = [
    "SCENARIOS",
    "Damage",
    "Record",
    "Scenario",
    "Setup",
    "Simulation",
    "damage_bytes",
    "find_scenario",
    "fly",
    "plan_flights",
    "simulate",
]

_MIN_FLIGHT_S = 15.0
_MAX_DURATION_S = 7200.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Simulation:
    """A simulated flight.

    Attributes
    ----------
    log : FlightLog
        The log that the autopilot would have written.
    truth : dict
        True values of the simulated vehicle, ready for JSON.
    damage : tuple of Damage
        Damage of the file after writing (`damage_bytes`).
    """

    log: FlightLog
    truth: dict[str, Any]
    damage: tuple[Damage, ...] = ()

    def __repr__(self) -> str:
        told = f"{self.log.format} of {self.log.autopilot}, with its truth"
        return f"<{type(self).__name__} of {self.truth.get('scenario', 'a flight')!r}: {told}>"


def simulate(
    scenario: str,
    *,
    seed: int = 0,
    duration_s: float | None = None,
    rate_hz: float | None = None,
    vehicle: Vehicle | None = None,
    autopilot: str = "ardupilot",
) -> Simulation:
    """Fly a named scenario and log it.

    Parameters
    ----------
    scenario : str
        A key of `SCENARIOS`.
    seed : int
        Seed of the random numbers. The same seed gives the same flight, bit for bit.
    duration_s : float, optional
        Length of the log [s]; the default is that of the scenario.
    rate_hz : float, optional
        Rate of the main messages [Hz]; the default is that of the scenario.
    vehicle : Vehicle, optional
        Given properties replace those of the scenario's vehicle.
    autopilot : str
        "ardupilot", "px4", "betaflight" or "crazyflie": the autopilot of mixer and log messages.

    Returns
    -------
    Simulation
        The log and the true values.

    Raises
    ------
    SimulationError
        If the scenario is unknown, or cannot be simulated with these values.

    Examples
    --------
    >>> import quadid_logs
    >>> quadid_logs.simulate("sysid-quad-x", duration_s=15.0, rate_hz=10.0).log.format
    'dataflash'
    """
    found, kind = find_scenario(scenario), vendor(autopilot)
    logging = found.logging
    if rate_hz is None and logging.rate_hz == 10.0 and scenario == "default-logging":
        rate_hz = kind.default_rate_hz
    if rate_hz is not None:
        logging = dataclasses.replace(logging, rate_hz=rate_hz)
    setups = plan_flights(
        found,
        seed=seed,
        duration_s=found.duration_s if duration_s is None else duration_s,
        rate_hz=logging.rate_hz,
        vehicle=vehicle,
        autopilot=autopilot,
    )
    if autopilot == "betaflight":
        # Refuse a vehicle without an order of motors in the log.
        motor_order(setups[0])
    records = tuple(fly(setup) for setup in setups)
    truth = flight_truth(records, scenario=scenario, boot_s=logging.boot_s)
    # The faults of the log, and the findings that `analyze` may give.
    truth |= {
        "logging": dataclasses.asdict(logging),
        "damage": [dataclasses.asdict(damage) for damage in found.damage],
        "expected_verdicts": {axis: list(allowed) for axis, allowed in found.verdicts.items()},
    }
    return Simulation(log=log_flights(records, logging), truth=truth, damage=found.damage)


def find_scenario(name: str) -> Scenario:
    """Return a scenario by its name.

    Parameters
    ----------
    name : str
        A key of `SCENARIOS`.

    Raises
    ------
    SimulationError
        If the scenario is unknown; the hint lists similar names.
    """
    if name in SCENARIOS:
        return SCENARIOS[name]
    from difflib import get_close_matches

    near = get_close_matches(name, SCENARIOS) or sorted(SCENARIOS)
    raise SimulationError(f"There is no scenario {name!r}.", hint=f"Did you mean {', '.join(near)}?")


def plan_flights(
    scenario: Scenario,
    *,
    seed: int,
    duration_s: float,
    rate_hz: float,
    vehicle: Vehicle | None = None,
    autopilot: str = "ardupilot",
) -> tuple[Setup, ...]:
    """Prepare the scenario's flights; `fly` flies each.

    Parameters
    ----------
    scenario : Scenario
    seed : int
        Seed of manoeuvre, noise and wind.
    duration_s : float
        Total length of all flights [s].
    rate_hz : float
        Rate of the main messages [Hz]; the control rate is a multiple of it.
    vehicle : Vehicle, optional
        Given properties replace those of the scenario's vehicle.
    autopilot : str
        "ardupilot", "px4" or "betaflight".

    Returns
    -------
    tuple of Setup
        One setup for each flight of the scenario.

    Raises
    ------
    SimulationError
        If the scenario cannot be simulated with this duration, rate or vehicle.
    """
    # Length of each flight of a scenario [s].
    each_s = duration_s / scenario.n_flights
    if not (each_s >= _MIN_FLIGHT_S and duration_s <= _MAX_DURATION_S):
        raise SimulationError(
            f"A duration of {duration_s:g} s cannot be flown.",
            hint=f"Give {_MIN_FLIGHT_S * scenario.n_flights:g} to {_MAX_DURATION_S:g} s.",
        )
    airframe = scenario.airframe() if vehicle is None else adapted(scenario.airframe(), vehicle)
    # Control rate: a whole multiple of the logging rate, about 400 Hz.
    if not 1.0 <= rate_hz <= 2000.0:
        raise SimulationError(f"A rate of {rate_hz:g} Hz cannot be logged.", hint="Give 1 to 2000 Hz.")
    # Phases of one flight, which are shortened for a short flight.
    pace = min(1.0, each_s / 30.0)
    loop_hz, schedule = (
        (rate_hz * max(round(400.0 / rate_hz), 1)),
        Schedule(
            arm_s=0.5,
            take_off_s=1.5,
            manoeuvre_s=1.5 + 4.0 * pace,
            land_s=each_s - 1.5 - 5.0 * pace,
            touch_down_s=each_s - 1.5 - 1.0 * pace,
            disarm_s=each_s - 0.8,
            end_s=each_s,
            height_m=1.0 + 4.0 * pace,
        ),
    )
    length = round(schedule.land_s * loop_hz) - round(schedule.manoeuvre_s * loop_hz)
    setups = []
    for flight in range(scenario.n_flights):
        rng = np.random.default_rng([seed, flight, *b"manoeuvre"])
        setups.append(
            Setup(
                airframe=airframe,
                reference=scenario.manoeuvre(np.arange(length) / loop_hz, rng),
                schedule=schedule,
                autopilot=autopilot,
                loop_hz=loop_hz,
                gyro_filter_hz=scenario.gyro_filter_hz,
                delay_steps=scenario.delay_steps,
                noise=scenario.noise,
                wind=scenario.wind,
                effects=scenario.effects,
                tuning=scenario.tuning,
                seed=seed + 1_000_003 * flight,
            )
        )
    return tuple(setups)
