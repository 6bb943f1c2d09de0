"""A simulated fleet: vehicles that differ a little, days that differ too, and some propellers that wear."""

from __future__ import annotations

import dataclasses
import datetime
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from quadid_logs.data.log import FlightLog, LogText
from quadid_logs.simulator import find_scenario, fly, plan_flights
from quadid_logs.simulator.airframes import SimulatedAirframe
from quadid_logs.simulator.closed_loop import Setup
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.wind import Wind
from quadid_logs.writers import write_log

#: Flown in turn: what a flight identifies must not depend on its manoeuvre.
SCENARIOS = ("sysid-quad-x", "doublets", "steps-3211")
_FIRST_DAY = datetime.datetime(2026, 3, 2, 9, 0, tzinfo=datetime.UTC)


@dataclass(frozen=True, slots=True, kw_only=True)
class Worn:
    """From this flight on, one propeller gives a fraction of its thrust only."""

    flight: int
    rotor: int = 0
    fraction: float = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """One of the fleet; `number` makes it what it is."""

    number: int
    worn: Worn | None = None

    @property
    def hardware_id(self) -> str:
        """As ArduPilot writes it."""
        return f"CubeOrange 003A0027 3130510A {0x34383700 + self.number:08X}"


def vehicles(n_vehicles: int, worn: dict[int, Worn]) -> tuple[Vehicle, ...]:
    """Return a fleet; `worn` is by the vehicle's number."""
    return tuple(Vehicle(number=number, worn=worn.get(number)) for number in range(n_vehicles))


def write_flight(
    vehicle: Vehicle, flight: int, folder: Path, *, duration_s: float = 30.0, rate_hz: float = 200.0
) -> Path:
    """Fly once and write the log; the same vehicle and flight give the same bytes."""
    setup = _setup(vehicle, flight, duration_s, rate_hz)
    logging = Logging(rate_hz=rate_hz)
    log = _signed(log_flights((fly(setup),), logging), vehicle)
    when = _FIRST_DAY + datetime.timedelta(days=flight, minutes=20 * vehicle.number)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{when:%Y-%m-%d %H-%M-%S} {vehicle.number:03d}.bin"
    write_log(log, path)
    return path


def write_fleet(fleet: Sequence[Vehicle], n_flights: int, folder: Path, *, processes: int) -> None:
    """Write all flights of all vehicles, and the truth beside."""
    from concurrent.futures import ProcessPoolExecutor

    wanted = [(vehicle, flight) for flight in range(n_flights) for vehicle in fleet]
    truth = {v.hardware_id: dataclasses.asdict(v.worn) if v.worn else None for v in fleet}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))
    with ProcessPoolExecutor(processes) as pool:
        futures = [pool.submit(write_flight, vehicle, flight, folder) for vehicle, flight in wanted]
        for future in futures:
            future.result()


def spoil(paths: Sequence[Path], every: int) -> Iterator[tuple[Path, str]]:
    """Turn every n-th log into what cards and people make of them: no log, cut, empty, overwritten.

    No two are alike: files with the same content count once.
    """
    rng = np.random.default_rng(7)
    for number, path in enumerate(paths[::every]):
        content = path.read_bytes()
        kind, damaged = (
            ("noise", rng.bytes(20_000)),
            ("text", b"altitude,speed\nnone,none\n" * (number + 1)),
            ("nearly empty", b"\n" * number),
            ("zeros", bytes(len(content) + number)),
            ("cut in the header", content[: 60 + number]),
        )[number % 5]
        path.write_bytes(damaged)
        yield path, kind


def _setup(vehicle: Vehicle, flight: int, duration_s: float, rate_hz: float) -> Setup:
    """Plan a flight: the vehicle as it was built, the day's air, load and wind."""
    scenario = find_scenario(SCENARIOS[flight % len(SCENARIOS)])
    seed = 1000 * vehicle.number + flight
    setup = plan_flights(scenario, seed=seed, duration_s=duration_s, rate_hz=rate_hz)[0]
    rng = np.random.default_rng([seed, *b"day"])
    return dataclasses.replace(
        setup,
        airframe=_flown(_built(setup.airframe, vehicle.number), vehicle, flight, rng),
        wind=Wind(speed_m_s=float(rng.uniform(0.0, 4.0))),
    )


def _built(airframe: SimulatedAirframe, number: int) -> SimulatedAirframe:
    """Build one vehicle: 3 % of scatter in inertia, 2 % in mass and thrust, between vehicles of one model."""
    rng = np.random.default_rng([number, *b"built"])
    spread = 1.0 + 0.03 * rng.standard_normal(3)
    return dataclasses.replace(
        airframe,
        mass_kg=airframe.mass_kg * (1.0 + 0.02 * rng.standard_normal()),
        max_thrust_n=airframe.max_thrust_n * (1.0 + 0.02 * rng.standard_normal()),
        inertia_kg_m2=airframe.inertia_kg_m2 * np.diag(spread),
    )


def _flown(
    airframe: SimulatedAirframe, vehicle: Vehicle, flight: int, rng: np.random.Generator
) -> SimulatedAirframe:
    """One day's vehicle: air of 0 to 20 degrees (3 % of thrust), load within 1 %, propellers as they are."""
    fractions = [1.0] * airframe.n_rotors
    if vehicle.worn is not None and flight >= vehicle.worn.flight:
        fractions[vehicle.worn.rotor] = vehicle.worn.fraction
    density = 1.0 + 0.035 * math.sin(2.0 * math.pi * flight / 40.0) + 0.01 * rng.standard_normal()
    return dataclasses.replace(
        airframe,
        mass_kg=airframe.mass_kg * (1.0 + 0.01 * rng.standard_normal()),
        max_thrust_n=airframe.max_thrust_n * density,
        propellers=tuple(fractions),
    )


def _signed(log: FlightLog, vehicle: Vehicle) -> FlightLog:
    """Let the log say which hardware it was."""
    first = log.texts[0]
    text = LogText(time_s=first.time_s, position=first.position, text=vehicle.hardware_id)
    return dataclasses.replace(log, texts=(*log.texts, text))
