"""Filters and gains together, and gains alone: `python study/filters.py`.

Vehicles whose filters are bad in one of four ways (too much, too little, a notch at a wrong place, none at
all) are flown with rotors that shake the gyro and a part of the frame that rings, and tuned from their logs
at most three times, with filters changed and with filters left as they flew. What gusts make of the attitude
and noise of the command is that of the true loop. Two more are in trouble: vibration takes the motors of one
to their limits, and roll of the other is in a limit cycle.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from quadid_logs import analyze
from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.ardupilot.controller import AXIS_NAMES
from quadid_logs.control.loop import close
from quadid_logs.control.scaled_loop import ScaledLoops, scaled_loops, spare
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD
from quadid_logs.simulator import Scenario, airframes, fly, manoeuvres, plan_flights
from quadid_logs.simulator.closed_loop import Noise, Setup
from quadid_logs.simulator.closed_loop import Tuning as Gains
from quadid_logs.simulator.control import TrackingNotch
from quadid_logs.simulator.effects import Effects, disturbance_density
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.simulator.wind import Wind
from quadid_logs.tuning import recommend
from quadid_logs.vocabulary import AXES
from quadid_logs.writers import write_log
from study.draw import draw_flight
from study.filter_bound import bound
from study.structural import log_uniform
from study.tuning import fly_missing, gains_of, read, resting_truth

#: A loop of this rate, which is that of the gyro, logged at every step [Hz].
_RATE_HZ: Final = 1000.0
_DURATION_S: Final = 24.0
_N_CHANGES: Final = 3
_MOST_FLIGHTS: Final = 4
#: Factor on the gains of roll that is beyond its limit of stability.
_LIMIT_CYCLE: Final = 14.0
_GENTLER: Final = 0.6
_FULLER: Final = 2.0
#: Vehicles in trouble.
TROUBLE: Final = ("vibrating 500", "limit cycle of a 450")
#: The ways in which filters are bad.
KINDS: Final = ("too much", "too little", "wrong notch", "none")
_GUSTS_HZ: Final = (0.05, 60.0)
_N: Final = 400
#: Where gyro noise moves motors [Hz].
_NOISE_ABOVE_HZ: Final = 15.0
_GUST_RAD_S2: Final = 0.5
#: One of the thousand steps of a PWM output: less is no noise.
_LEAST_NOISE: Final = 0.001


class Flown(NamedTuple):
    """What a pilot has set: low-pass of the gyro, its notch, low-passes of D, and gains (4, 3)."""

    gyro_hz: float
    notch: TrackingNotch | None
    derivative_hz: tuple[float, float, float]
    gains: FloatArray


def draw_vehicle(seed: int, number: int) -> tuple[Scenario, Flown, str]:
    """Draw a vehicle, how it is set, and what is wrong with that."""
    drawn = draw_flight(seed, number)
    rng = np.random.default_rng([seed, number, *b"filter study"])
    kind = KINDS[number % len(KINDS)]
    amplitude = log_uniform(rng, 0.4, 0.7)
    frame_hz = rng.uniform(60.0, 110.0)
    noise = Noise(
        gyro_rad_s_per_rthz=1.0e-4 * log_uniform(rng, 1.0, 5.0),
        rotor_line_rad_s=log_uniform(rng, 0.02, 0.1),
        frame_line_rad_s=log_uniform(rng, 0.02, 0.1),
        frame_line_hz=frame_hz,
    )
    scenario = dataclasses.replace(
        drawn.scenario,
        manoeuvre=partial(
            manoeuvres.multisine, rms_rad_s=(0.9 * amplitude, 0.9 * amplitude, 0.35 * amplitude)
        ),
        duration_s=_DURATION_S,
        noise=noise,
        wind=Wind(),
        effects=dataclasses.replace(
            Scenario(name="", sentence="").effects,
            disturbance_rad_s2=(_GUST_RAD_S2, _GUST_RAD_S2, 0.5 * _GUST_RAD_S2),
        ),
        logging=dataclasses.replace(
            drawn.scenario.logging, rate_hz=_RATE_HZ, jitter_s=5e-6, drop_fraction=0.0
        ),
    )
    wrong = TrackingNotch(0.45 * frame_hz, 0.2 * frame_hz, stands=True)
    gyro_hz, derivative_hz, notch = {
        "too much": (15.0, 10.0, None),
        "too little": (80.0, 80.0, None),
        "wrong notch": (40.0, 25.0, wrong),
        "none": (180.0, 100.0, None),
    }[kind]
    # Gains that suit the vehicle behind ordinary filters, off by a factor.
    suited = _setup(scenario, Flown(30.0, None, (20.0,) * 3, np.zeros((4, 3))), 0, np.ones((4, 3)))
    factors = np.vstack([np.tile(np.exp(rng.uniform(-0.7, 0.2, 3)), (3, 1)), np.ones(3)])
    flown = Flown(gyro_hz, notch, (derivative_hz,) * 3, factors * gains_of(suited))
    while not all(_spare(_setup(scenario, flown, 0), axis) > 0.3 for axis in range(3)):
        flown = flown._replace(gains=flown.gains * np.array([[0.8], [0.8], [0.8], [0.9]]))
    return scenario, flown, kind


def _setup(scenario: Scenario, flown: Flown, seed: int, single: FloatArray | None = None) -> Setup:
    """Return a flight with these settings, whatever the simulator would take for suitable gains."""
    if single is None:
        base = gains_of(_setup(scenario, flown, seed, np.ones((4, 3))))
        single = np.divide(flown.gains, base, out=np.ones((4, 3)), where=base > 0.0)
    rows = tuple((roll, pitch, yaw) for roll, pitch, yaw in single.tolist())
    tuning = Gains(single_gain=rows, axis_derivative_hz=flown.derivative_hz, notch=flown.notch)
    tuned = dataclasses.replace(scenario, tuning=tuning, gyro_filter_hz=flown.gyro_hz)
    (setup,) = plan_flights(tuned, seed=seed, duration_s=_DURATION_S, rate_hz=_RATE_HZ, autopilot="ardupilot")
    return setup


def true_loops(setup: Setup, axis: int) -> ScaledLoops:
    """Return the loops of the true vehicle with what it is set to."""
    plant = true_plant(setup, resting_truth(setup), axis)
    return scaled_loops(true_controller(setup, axis, rotors_hz(setup)), plant, np.inf)


def _spare(setup: Setup, axis: int) -> float:
    """Return the worst of the true margins over its limit."""
    return spare(true_loops(setup, axis).margins(), GOOD)


def rotors_hz(setup: Setup) -> float:
    """Return the speed of the rotors at hover."""
    airframe = setup.airframe
    return float(airframe.rotor_speed_max_rad_s * math.sqrt(airframe.hover_throttle) / (2.0 * math.pi))


def judged(setup: Setup) -> dict[str, Any]:
    """Return of each axis what gusts make of the attitude [rad], noise of the command, margins kept."""
    found = {}
    for number, axis in enumerate(AXES):
        plant = true_plant(setup, resting_truth(setup), number)
        controller = true_controller(setup, number, rotors_hz(setup))
        frequency_hz = np.geomspace(*_GUSTS_HZ, _N)
        s = 2j * np.pi * frequency_hz
        loop = close(controller, plant, frequency_hz)
        whole = (loop.rate if loop.full is None else loop.full)[0]
        answer = np.abs(1.0 / (s * (s - plant.damping[0]) * (1.0 + whole))) ** 2
        gusts = disturbance_density(frequency_hz) * setup.effects.disturbance_rad_s2[number] ** 2
        found[axis] = {
            "gusts_rad": float(np.sqrt(np.trapezoid(answer * gusts, frequency_hz))),
            "noise": _noise(setup, controller, plant),
            "spare": _spare(setup, number),
        }
    return found


def _noise(setup: Setup, controller: Any, plant: Any) -> float:
    """Return the standard deviation of the command that white noise and both lines make."""
    nyquist_hz = 0.499 * setup.loop_hz

    def gain(frequency_hz: FloatArray) -> FloatArray:
        loop = close(controller, plant, frequency_hz)
        whole = (loop.rate if loop.full is None else loop.full)[0]
        body = plant.response(frequency_hz, controller.period_s)[0]
        return np.asarray(np.abs(loop.rate[0] / body / (1.0 + whole)) ** 2)

    band_hz = np.linspace(_NOISE_ABOVE_HZ, nyquist_hz, _N)
    power = float(np.trapezoid(gain(band_hz), band_hz)) * setup.noise.gyro_rad_s_per_rthz**2
    rotor_hz = rotors_hz(setup)
    # What the sampler folds.
    rotor_hz = abs(rotor_hz - setup.loop_hz * round(rotor_hz / setup.loop_hz))
    lines = (
        (rotor_hz, setup.noise.rotor_line_rad_s),
        (setup.noise.frame_line_hz, setup.noise.frame_line_rad_s),
    )
    power += sum(float(gain(np.array([at_hz]))[0]) * rms**2 for at_hz, rms in lines if rms > 0.0)
    return math.sqrt(power)


def measure(seed: int, number: int) -> dict[str, Any]:
    """Fly and tune one vehicle both ways.

    Parameters
    ----------
    seed, number : int

    Returns
    -------
    dict
        Ready for JSON.
    """
    scenario, begin, kind = draw_vehicle(seed, number)
    told = {"number": number, "seed": seed, "kind": kind}
    return told | _tuned(scenario, begin, 1000 * seed + 10 * number, ("gains", "filters"))


def measure_bound(seed: int, number: int) -> dict[str, Any]:
    """Search the best filters and gains of one vehicle, which does not fly.

    Parameters
    ----------
    seed, number : int

    Returns
    -------
    dict
        Ready for JSON.
    """
    scenario, begin, kind = draw_vehicle(seed, number)
    setup = _setup(scenario, begin, 0)
    return {"number": number, "seed": seed, "kind": kind, **bound(setup, rotors_hz(setup))}


def measure_trouble(seed: int, number: int) -> dict[str, Any]:
    """Fly and tune, with filters, one vehicle that is in trouble.

    Parameters
    ----------
    seed, number : int

    Returns
    -------
    dict
        Ready for JSON.
    """
    scenario, begin = vehicle_in_trouble(TROUBLE[number])
    told = {"number": number, "seed": seed, "kind": TROUBLE[number]}
    return told | _tuned(scenario, begin, 1000 * seed + 10 * number, ("filters",))


def vehicle_in_trouble(name: str) -> tuple[Scenario, Flown]:
    """Return a vehicle of `TROUBLE` and how it is set."""
    shaken = name == TROUBLE[0]
    scenario = Scenario(
        name=name,
        sentence="",
        airframe=(lambda: airframes.scaled(airframes.quad_x(), 500.0 / 450.0))
        if shaken
        else airframes.quad_x,
        manoeuvre=partial(manoeuvres.multisine, rms_rad_s=(0.5, 0.5, 0.35)),
        duration_s=_DURATION_S,
        wind=Wind(),
        noise=Noise(
            gyro_rad_s_per_rthz=3.0e-4, rotor_line_rad_s=0.4, frame_line_rad_s=0.4, frame_line_hz=70.0
        )
        if shaken
        else Noise(rotor_line_rad_s=0.02),
        effects=Effects(disturbance_rad_s2=(_GUST_RAD_S2, _GUST_RAD_S2, 0.5 * _GUST_RAD_S2)),
        logging=Logging(rate_hz=_RATE_HZ, jitter_s=5e-6, drop_fraction=0.0),
    )
    # Gains that suit the vehicle behind ordinary filters; those of roll fourteen times too high.
    flown = (
        Flown(80.0, None, (80.0,) * 3, np.zeros((4, 3)))
        if shaken
        else Flown(40.0, None, (20.0,) * 3, np.zeros((4, 3)))
    )
    behind = flown._replace(gyro_hz=30.0 if shaken else 40.0, derivative_hz=(20.0,) * 3)
    gains = gains_of(_setup(scenario, behind, 0, np.ones((4, 3))))
    if not shaken:
        gains[:3, 0] *= _LIMIT_CYCLE
    return scenario, flown._replace(gains=gains)


def _tuned(scenario: Scenario, begin: Flown, seed: int, ways: Sequence[str]) -> dict[str, Any]:
    """Fly and tune a vehicle in some ways."""
    told: dict[str, Any] = {}
    # Every way begins with the same flight.
    analyzed: dict[str, Result] = {}
    for way in ways:
        flown, steps, air = begin, [judged(_setup(scenario, begin, 0))], scenario
        reasons = []
        for count in range(_MOST_FLIGHTS):
            key = repr((count, air.manoeuvre, flown._replace(gains=flown.gains.tolist())))
            if key not in analyzed:
                analyzed[key] = _analyzed(_setup(air, flown, seed + count), scenario)
            tuning = recommend(analyzed[key], filters=way == "filters")
            codes = {axis: [one.code for one in found.reasons] for axis, found in tuning.axes.items()}
            reasons.append(codes)
            values = {name: one.next for name, one in tuning.changes.items()}
            if gentler := any({"QL617", "QL635"} & set(one) for one in codes.values()):
                # A pilot who is told that the motors were at their limits flies gentler manoeuvres.
                air = dataclasses.replace(air, manoeuvre=_scaled(air.manoeuvre, 3 * (_GENTLER,)))
            # And one who is told that the sticks moved an axis too little moves it more.
            fuller = tuple(_FULLER if "QL615" in codes[axis] else 1.0 for axis in AXES)
            again = gentler or any(one > 1.0 for one in fuller)
            air = dataclasses.replace(air, manoeuvre=_scaled(air.manoeuvre, fuller))
            if not values and not again:
                break
            if values:
                flown = loaded(flown, values)
                steps.append(judged(_setup(scenario, flown, 0)))
            if len(steps) > _N_CHANGES:
                break
        told[way] = {
            "steps": steps,
            "reasons": reasons,
            "settings": [flown.gyro_hz, flown.derivative_hz, flown.notch],
        }
    return told


def _analyzed(setup: Setup, scenario: Scenario) -> Result:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.bin"
        write_log(log_flights((fly(setup),), scenario.logging), path)
        return analyze(path)


def _scaled(manoeuvre: Any, factors: tuple[float, ...]) -> Any:
    (rms,) = manoeuvre.keywords.values()
    return partial(manoeuvre.func, rms_rad_s=tuple(f * one for f, one in zip(factors, rms, strict=True)))


def loaded(flown: Flown, values: Mapping[str, float]) -> Flown:
    """Return the settings with the values of a file."""
    gains = flown.gains.copy()
    derivative_hz = list(flown.derivative_hz)
    for axis, name in enumerate(AXIS_NAMES.values()):
        for row, parameter in enumerate(
            (*(f"ATC_RAT_{name}_{short}" for short in "PID"), f"ATC_ANG_{name}_P")
        ):
            gains[row, axis] = values.get(parameter, gains[row, axis])
        derivative_hz[axis] = values.get(f"ATC_RAT_{name}_FLTD", derivative_hz[axis])
    roll, pitch, yaw = derivative_hz
    return Flown(
        values.get("INS_GYRO_FILTER", flown.gyro_hz), _notch(flown.notch, values), (roll, pitch, yaw), gains
    )


def _notch(flown: TrackingNotch | None, values: Mapping[str, float]) -> TrackingNotch | None:
    """Return the notch with what a file changes of it."""
    on = values.get("INS_HNTCH_ENABLE", 0.0 if flown is None else 1.0)
    if not on:
        return None
    before = flown or TrackingNotch(values["INS_HNTCH_FREQ"], values["INS_HNTCH_BW"])
    harmonics = int(values.get("INS_HNTCH_HMNCS", 2**before.n_harmonics - 1))
    return TrackingNotch(
        values.get("INS_HNTCH_FREQ", before.lowest_hz),
        values.get("INS_HNTCH_BW", before.width_hz),
        values.get("INS_HNTCH_ATT", before.depth_db),
        harmonics.bit_length(),
        stands=values.get("INS_HNTCH_MODE", 0.0 if before.stands else 3.0) == 0.0,
    )


def table(vehicles: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table: at the end, filters and gains over gains alone.

    Noise as it is, and with less than a step of an output taken for one.
    """
    yield "| filters as flown | vehicles | gust error | noise | noise from 0.1 % up | margins kept |"
    yield "|---|---|---|---|---|---|"
    good = [one for one in vehicles if "error" not in one]
    for kind in (*KINDS, "all"):
        some = [one for one in good if kind in ("all", one["kind"])]
        if not some:
            continue
        pairs = [
            (one["filters"]["steps"][-1][axis], one["gains"]["steps"][-1][axis])
            for one in some
            for axis in AXES
        ]
        columns = (_spread(new[name] / old[name] for new, old in pairs) for name in ("gusts_rad", "noise"))
        noises = ([max(one["noise"], _LEAST_NOISE) for one in pair] for pair in pairs)
        at_least = _spread(new / old for new, old in noises)
        kept = np.mean([new["spare"] >= min(0.95, old["spare"]) for new, old in pairs])
        yield f"| {kind} | {len(some)} | {' | '.join(columns)} | {at_least} | {100.0 * kept:.0f} % |"


def bound_table(vehicles: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table: the best filters and gains over the best gains behind the flown ones."""
    yield "| filters as flown | vehicles | gust error | noise | the larger of both |"
    yield "|---|---|---|---|---|"
    good = [one for one in vehicles if "error" not in one]
    for kind in (*KINDS, "all"):
        some = [one for one in good if kind in ("all", one["kind"])]
        if not some:
            continue
        pairs = [(one["best"]["axes"][axis], one["alone"]["axes"][axis]) for one in some for axis in AXES]
        ratios = np.array([[new[name] / old[name] for new, old in pairs] for name in ("gusts_rad", "noise")])
        columns = " | ".join(_spread(each) for each in (*ratios, ratios.max(axis=0)))
        yield f"| {kind} | {len(some)} | {columns} |"


def trouble_table(vehicles: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table of the vehicles in trouble, before and after each change."""
    yield "| vehicle | changes | gust error [deg] | noise [% of the command] | least margin over its limit |"
    yield "|---|---|---|---|---|"
    columns = (("gusts_rad", math.degrees(1.0)), ("noise", 100.0), ("spare", 1.0))
    for one in vehicles:
        for count, step in enumerate(one.get("filters", {}).get("steps", ())):
            # What gusts and noise make of a loop that is unstable is no number.
            cells = (
                ", ".join(
                    f"{factor * step[axis][name]:.2g}" if step[axis]["spare"] else "unstable" for axis in AXES
                )
                for name, factor in columns
            )
            yield f"| {one['kind']} | {count} | {' | '.join(cells)} |"


def _spread(ratios: Iterable[float]) -> str:
    """Return the median of ratios, and the ends of their range."""
    each = list(ratios)
    return f"{np.median(each):.2f} ({min(each):.2f} to {max(each):.2f})"


def main() -> int:
    """Fly what is missing, then print the table."""
    from study.run import ROOT

    parser = argparse.ArgumentParser(description="Filters and gains together, against gains alone.")
    parser.add_argument("--vehicles", type=int, default=4, help="how many vehicles (default 4)")
    parser.add_argument("--seed", type=int, default=1, help="another seed draws other vehicles (default 1)")
    parser.add_argument(
        "--output", type=Path, default=ROOT / "build" / "filters", help="default build/filters"
    )
    parser.add_argument(
        "--publish", action="store_true", help="write the tables of docs/tuning from the result"
    )
    parser.add_argument(
        "--bound", action="store_true", help="what the true vehicles could reach, without any flight"
    )
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / f"{'bound' if options.bound else 'seed'}-{options.seed}.jsonl"
    measured = measure_bound if options.bound else measure
    fly_missing(path, options.seed, options.vehicles, 1, measured)
    vehicles = [one for one in read(path) if one["number"] < options.vehicles]
    troubled: list[dict[str, Any]] = []
    if options.bound:
        pages = {"filter_bound": bound_table(vehicles)}
    else:
        other = options.output / f"trouble-{options.seed}.jsonl"
        fly_missing(other, options.seed, len(TROUBLE), 1, measure_trouble)
        troubled = sorted(read(other), key=lambda one: int(one["number"]))
        pages = {"filters": table(vehicles), "trouble": trouble_table(troubled)}
    for name, lines in pages.items():
        text = "\n".join(lines) + "\n"
        print(text)
        if options.publish:
            (ROOT / "docs" / "tuning" / f"{name}.md").write_text(text, encoding="utf-8")
    return 1 if any("error" in one for one in (*vehicles, *troubled)) else 0


if __name__ == "__main__":
    raise SystemExit(main())
