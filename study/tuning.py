"""Fly, tune, fly again until nothing changes: `python study/run.py --tune`.

Vehicles drawn at random, with gains that are off by a factor drawn at random in each axis, are flown, and
tuned from their logs as any vehicle is. What is promised of a flight is held against the true loop of the
next one, and against what that flight's own log tells of it.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import multiprocessing
import sys
import tempfile
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from quadid_logs.align import cut
from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots import named
from quadid_logs.control.scaled_loop import scaled_loops
from quadid_logs.data.closed_loop import LoopMargins, Margins
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.data.tuning import AxisTuning, GainNames, Tuning
from quadid_logs.health import health_of
from quadid_logs.load import prepare, read_log
from quadid_logs.pipeline import judge
from quadid_logs.simulator import Scenario, fly, manoeuvres, plan_flights
from quadid_logs.simulator.closed_loop import Noise, Record, Setup, final_gains
from quadid_logs.simulator.closed_loop import Tuning as Gains
from quadid_logs.simulator.logger import log_flights
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.simulator.truth import flight_truth
from quadid_logs.simulator.wind import Wind
from quadid_logs.tuning import recommend
from quadid_logs.writers import write_log
from study.draw import draw_flight
from study.structural import log_uniform

#: A loop of this rate, logged at every step [Hz]; flights are as short as a pilot's patience.
_RATE_HZ: Final = 280.0
_DURATION_S: Final = 24.0
#: A Betaflight's loop is faster, and so are its filters: of D, and the least of the gyro's.
_BETAFLIGHT_HZ: Final = 500.0
_BETAFLIGHT_FILTERS_HZ: Final = (80.0, 60.0)
#: From the lowest gains to the highest targets it takes nine steps of a factor of 1.3.
_MOST_FLIGHTS: Final = 12
#: A PX4 loop that may run faster than it does by this factor waits for its gyro.
_WAITS: Final = 1.5
#: By how much the gains of each axis are off; vehicles that no pilot would take off with are drawn again.
_DETUNING: Final = (0.4, 2.5)
_LEAST_DB: Final = 2.0
_FIGURES: Final = ("gain_margin_db", "phase_margin_deg", "disk_margin")
#: Faster than any of the manoeuvres commands, twice [rad/s]: the vehicle has got away.
_RUNAWAY_RAD_S: Final = 12.0


def draw_vehicle(seed: int, number: int) -> tuple[Scenario, str, dict[str, Any]]:
    """Draw a vehicle, what is flown with it, and its autopilot.

    Parameters
    ----------
    seed, number : int
        Of the study and of the vehicle.

    Returns
    -------
    Scenario
        Without gains.
    str
        The autopilot.
    dict
        What was drawn, for sorting.
    """
    drawn = draw_flight(seed, number)
    rng = np.random.default_rng([seed, number, *b"tuning study"])
    amplitude = log_uniform(rng, 0.6, 1.2)
    rms = (0.9 * amplitude, 0.9 * amplitude, 0.35 * amplitude)
    manoeuvre = (
        partial(manoeuvres.multisine, rms_rad_s=rms)
        if rng.random() < 0.5
        else partial(manoeuvres.doublets, amplitude_rad_s=1.2 * amplitude, pulse_s=rng.uniform(0.15, 0.35))
    )
    noise = Noise(gyro_rad_s_per_rthz=1.0e-4 * log_uniform(rng, 0.3, 5.0))
    scenario = dataclasses.replace(
        drawn.scenario,
        manoeuvre=manoeuvre,
        duration_s=_DURATION_S,
        noise=noise,
        wind=Wind(speed_m_s=rng.uniform(0.0, 4.0), heading_rad=rng.uniform(-np.pi, np.pi)),
        effects=dataclasses.replace(Scenario(name="", sentence="").effects),
        logging=dataclasses.replace(
            drawn.scenario.logging, rate_hz=_RATE_HZ, jitter_s=5e-6, drop_fraction=0.0
        ),
    )
    kept = ("frame", "mass_kg", "lag_s", "delay_steps", "gyro_filter_hz", "hover_throttle")
    settings = {name: drawn.settings[name] for name in kept}
    settings |= {"autopilot": drawn.autopilot, "manoeuvre": manoeuvre.func.__name__}
    return scenario, drawn.autopilot, settings


def draw_betaflight(seed: int, number: int) -> tuple[Scenario, str, dict[str, Any]]:
    """Draw a quadrotor X with Betaflight, flown by its sticks in angle mode; as `draw_vehicle`."""
    while True:
        scenario, _, settings = draw_vehicle(seed, number)
        if settings["frame"] == "quad x":
            break
        number += 1000
    rng = np.random.default_rng([seed, number, *b"betaflight"])
    gyro_hz = max(settings["gyro_filter_hz"], _BETAFLIGHT_FILTERS_HZ[1])
    scenario = dataclasses.replace(
        scenario,
        manoeuvre=partial(
            manoeuvres.sticks,
            tilt_rad=log_uniform(rng, 0.2, 0.4),
            yaw_rate_rad_s=log_uniform(rng, 0.5, 1.0),
        ),
        gyro_filter_hz=gyro_hz,
        logging=dataclasses.replace(scenario.logging, rate_hz=_BETAFLIGHT_HZ),
    )
    changed = {"autopilot": "betaflight", "manoeuvre": "sticks", "gyro_filter_hz": gyro_hz}
    return scenario, "betaflight", settings | changed


def measure_tuning(seed: int, number: int) -> dict[str, Any]:
    """Fly and tune one vehicle until nothing changes.

    Parameters
    ----------
    seed, number : int

    Returns
    -------
    dict
        Its settings, and one entry of ``flights`` for each flight, ready for JSON.
    """
    scenario, autopilot, settings = draw_vehicle(seed, number)
    rng = np.random.default_rng([seed, number, *b"detuning"])
    factors = of_each_gain(flyable(scenario, autopilot, rng))
    flights: list[dict[str, Any]] = []
    for count in range(_MOST_FLIGHTS):
        setup = setup_of(scenario, autopilot, factors, 1000 * seed + 10 * number + count)
        record = fly(setup)
        result = analyzed(record, scenario)
        tuning = recommend(result)
        flights.append({"factors": factors.tolist(), **_described(record, result, tuning)})
        if not tuning.changes:
            break
        factors = factors * changed(tuning, result)
    return {"number": number, "seed": seed, **settings, "flights": flights}


def changed(tuning: Tuning, result: Result) -> FloatArray:
    """Return the factors that a file puts on P, I, D and the angle gain of each axis, shape (4, 3)."""
    tunable = named(result.log.autopilot).tunable(result.log.parameters)
    assert tunable is not None
    return np.column_stack([_ratios(found, tunable.axes[axis]) for axis, found in tuning.axes.items()])


def gains_of(setup: Setup) -> FloatArray:
    """Return P, I, D and the angle gain that fly, shape (4, 3)."""
    gains = final_gains(setup)
    return np.array([gains.proportional, gains.integral, gains.derivative, gains.attitude])


def with_change(scenario: Scenario, autopilot: str, factors: FloatArray, ratios: FloatArray) -> FloatArray:
    """Return factors, shape (4, 3), with which whole gains are those that are recommended."""

    def gains(factors: FloatArray) -> FloatArray:
        return gains_of(setup_of(scenario, autopilot, factors, 0))

    wanted, changed = ratios * gains(factors), factors * ratios
    # Gains that flew were rounded, too.
    for _ in range(3 * (autopilot == "betaflight")):
        flown = gains(changed)
        changed = changed * np.divide(wanted, flown, out=np.ones_like(flown), where=flown > 0.0)
    return changed


def _ratios(found: AxisTuning, names: GainNames) -> FloatArray:
    ratios = {name: one.next / one.now for name, one in found.changes.items() if one.now}
    own = (names.proportional, names.integral, names.derivative)
    # A gain that multiplies all three is none of them.
    common = next((ratio for name, ratio in ratios.items() if name in names.scaled and name not in own), 1.0)
    return np.array([*(common * ratios.get(name, 1.0) for name in own), ratios.get(names.angle, 1.0)])


def flyable(scenario: Scenario, autopilot: str, rng: np.random.Generator) -> tuple[float, ...]:
    """Return factors on P, I and D with which a pilot would take off, axis by axis."""
    found = []
    for axis in range(3):
        while True:
            factor = log_uniform(rng, *_DETUNING)
            factors = tuple(factor if one == axis else 1.0 for one in range(3))
            setup = setup_of(scenario, autopilot, of_each_gain(factors), 0)
            margins = true_margins(setup, resting_truth(setup), axis)
            gain = (margins.full or margins.rate).gain_margin_db
            if margins.rate.stable and (gain is None or gain.value >= _LEAST_DB):
                found.append(factor)
                break
    return tuple(found)


def of_each_gain(factors: tuple[float, ...]) -> FloatArray:
    """Return the factors of P, I, D and the angle gain, shape (4, 3); the angle gain is not detuned."""
    return np.vstack([np.tile(factors, (3, 1)), np.ones(3)])


def setup_of(scenario: Scenario, autopilot: str, factors: FloatArray, seed: int) -> Setup:
    """Return a flight with factors on P, I, D and the angle gain of each axis, shape (4, 3)."""
    single = tuple((roll, pitch, yaw) for roll, pitch, yaw in factors.tolist())
    gains, rate_hz = Gains(single_gain=single), _RATE_HZ
    if autopilot == "betaflight":
        gains, rate_hz = dataclasses.replace(gains, derivative_hz=_BETAFLIGHT_FILTERS_HZ[0]), _BETAFLIGHT_HZ
    tuned = dataclasses.replace(scenario, tuning=gains)
    (setup,) = plan_flights(tuned, seed=seed, duration_s=_DURATION_S, rate_hz=rate_hz, autopilot=autopilot)
    return setup


def analyzed(record: Record, scenario: Scenario, *, with_health: bool = False) -> Result:
    """Return the analysis of a flight's log; what it shows without a model where that is wanted."""
    setup, log = record.setup, log_flights((record,), scenario.logging)
    if setup.autopilot == "px4":
        # The simulator reads its gyro once in a loop, and so do loops that wait for it.
        log = dataclasses.replace(log, parameters=log.parameters | waits_for_gyro(setup.loop_hz))
    elif setup.autopilot == "betaflight":
        # Whole numbers, and gains by their names: as a reader has them of a file.
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "flight.bbl"
            write_log(log, path)
            log = read_log(path)
    prepared, settings = prepare(log), Settings()
    data = cut(prepared, settings.align)
    health = health_of(prepared, data) if with_health else None
    return judge(prepared.log, data, settings, vehicle=None, timings_s={}, health=health)


def waits_for_gyro(loop_hz: float) -> dict[str, float]:
    """Return the parameters of a PX4 whose loop waits for its gyro.

    One at its limit has a faster gyro, which the slope of the rates is taken of before D's filter: 3
    degrees earlier at 10 Hz than in these flights.
    """
    return {"IMU_GYRO_RATEMAX": _WAITS * loop_hz}


def resting_truth(setup: Setup) -> dict[str, Any]:
    """Tell the vehicle before it has flown: at hover, with a full battery."""
    from quadid_logs.simulator.truth import actuator_truth, model_truth, torque_at_hover

    model = model_truth(setup.airframe, torque_at_hover(setup))
    return {"models": model, "actuator": actuator_truth(setup)}


def true_margins(setup: Setup, truth: dict[str, Any], axis: int) -> LoopMargins:
    """Return the margins of the loop that flew."""
    return scaled_loops(true_controller(setup, axis), true_plant(setup, truth, axis), np.inf).margins()


def _described(record: Record, result: Result, tuning: Tuning) -> dict[str, Any]:
    """Return what one flight was, what it was recommended, and what is true of it."""
    setup = record.setup
    truth = flight_truth((record,), scenario="", boot_s=0.0)
    axes = {}
    for number, (axis, found) in enumerate(tuning.axes.items()):
        axes[axis] = {
            "verdict": found.verdict,
            "reasons": [one.code for one in found.reasons],
            "codes": list(result.diagnosis.axes[axis].reasons),
            "true": figures(true_margins(setup, truth, number)),
            "now": figures(found.now),
            "next": figures(found.next) if found.verdict == "change" else None,
            "attitude_error": found.attitude_error if np.isfinite(found.attitude_error) else None,
        }
    fastest = float(np.abs(record.channels["rate"]).max())
    return {"axes": axes, "fastest_rad_s": fastest, "ran_away": fastest > _RUNAWAY_RAD_S}


def figures(margins: LoopMargins | None) -> dict[str, Any] | None:
    """Return the figures of the whole loop, each as [value, low, high]."""
    if margins is None:
        return None
    whole: Margins = margins.full or margins.rate
    told: dict[str, Any] = {"stable": whole.stable, "extrapolated": whole.extrapolated}
    for name in _FIGURES:
        figure = getattr(whole, name)
        told[name] = None if figure is None else [figure.value, *figure.ci95]
    return told


def main(arguments: list[str] | None = None) -> int:
    """Fly what is missing of the study, then print and write its table and picture."""
    from study.run import ROOT

    parser = argparse.ArgumentParser(description="Fly, tune, fly again, on simulated vehicles.")
    parser.add_argument("--vehicles", type=int, default=100, help="how many vehicles (default 100)")
    parser.add_argument("--seed", type=int, default=1, help="another seed draws other vehicles (default 1)")
    parser.add_argument("--processes", type=int, default=1, help="vehicles at the same time (default 1)")
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "tuning", help="default build/tuning")
    parser.add_argument("--publish", action="store_true", help="write docs/tuning/ from the result")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / f"seed-{options.seed}.jsonl"
    fly_missing(path, options.seed, options.vehicles, options.processes)

    from study.tuning_page import publish, summarise

    vehicles = [one for one in read(path) if one["number"] < options.vehicles]
    text = summarise(vehicles, options.output)
    if options.publish:
        publish(text, options.output, ROOT / "docs" / "tuning")
    print(text)
    return 1 if any("error" in one for one in vehicles) else 0


def read(path: Path) -> list[dict[str, Any]]:
    """Return what was measured, in the order of the vehicles.

    Parameters
    ----------
    path : Path
        Lines of JSON; the last may be cut off.

    Returns
    -------
    list of dict
    """
    if not path.exists():
        return []
    text = path.read_text(encoding="utf-8")
    lines = text[: text.rfind("\n") + 1].splitlines()
    return sorted((json.loads(line) for line in lines), key=lambda one: int(one["number"]))


def run_study(
    arguments: list[str] | None,
    description: str,
    sizes: tuple[int, int],
    name: str,
    steps: tuple[Callable[[int, int], dict[str, Any]], Callable[[list[dict[str, Any]]], str]],
) -> int:
    """Fly what is missing of a study of gains, then print and write its tables.

    Parameters
    ----------
    arguments : list of str, optional
        Of the command line.
    description : str
    sizes : tuple of int
        How many vehicles unless told otherwise, and flights or roads of each.
    name : str
        Of the folder in build, and of the page in docs/tuning.
    steps : tuple of callable
        Measures one of seed and number; makes the page of all that were measured, of all seeds.

    Returns
    -------
    int
        0.
    """
    from study.run import ROOT

    (n_vehicles, n_each), (measured, summarise) = sizes, steps
    folder = ROOT / "build" / name
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(
        "--vehicles", type=int, default=n_vehicles, help=f"how many vehicles (default {n_vehicles})"
    )
    parser.add_argument("--seed", type=int, default=1, help="another seed draws other vehicles (default 1)")
    parser.add_argument("--processes", type=int, default=1, help="how many at the same time (default 1)")
    parser.add_argument("--output", type=Path, default=folder, help=f"default build/{name}")
    parser.add_argument("--publish", action="store_true", help=f"write docs/tuning/{name}.md from all seeds")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / f"seed-{options.seed}.jsonl"
    fly_missing(path, options.seed, n_each * options.vehicles, options.processes, measured)
    text = summarise([one for each in sorted(options.output.glob("seed-*.jsonl")) for one in read(each)])
    if options.publish:
        (ROOT / "docs" / "tuning" / f"{name}.md").write_text(text, encoding="utf-8")
    print(text)
    return 0


def fly_missing(
    path: Path,
    seed: int,
    n_vehicles: int,
    n_processes: int,
    measured: Callable[[int, int], dict[str, Any]] = measure_tuning,
) -> None:
    """Append one line per vehicle that is not in the file yet.

    Parameters
    ----------
    path : Path
    seed, n_vehicles, n_processes : int
    measured : callable
        Of seed and number.
    """
    known = read(path)
    done = {one["number"] for one in known}
    missing = [(seed, number) for number in range(n_vehicles) if number not in done]
    path.write_text("".join(f"{json.dumps(one)}\n" for one in known), encoding="utf-8")
    context = multiprocessing.get_context("spawn")
    with context.Pool(n_processes) as pool, path.open("a", encoding="utf-8") as file:
        for count, vehicle in enumerate(
            pool.imap_unordered(partial(_measure_one, measured), missing), start=1
        ):
            file.write(json.dumps(vehicle) + "\n")
            file.flush()
            print(f"{count} of {len(missing)} vehicles", file=sys.stderr, flush=True)


def _measure_one(measured: Callable[[int, int], dict[str, Any]], task: tuple[int, int]) -> dict[str, Any]:
    """Measure one vehicle; whatever goes wrong is its result, for the others must go on."""
    seed, number = task
    try:
        return measured(seed, number)
    except Exception:  # noqa: BLE001 - the study reports it and fails at its end
        return {"number": number, "seed": seed, "error": traceback.format_exc()}
