"""Lines of the gyro's spectrum, what they are called, and what filters cost: `python study/lines.py`.

Flights with rotors that shake the gyro and a part of the frame that rings, behind the filters that the
autopilots ship with, on all three in turn: is each line within half a hertz of a true one, and rightly named?
Then flights of the study of margins: the degrees that each filter is told to cost the rate loop, against the
loop that the simulator ran. Last, logs of firmware that hold the gyro before and behind its filters.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from quadid_logs.align import cut
from quadid_logs.align.series import CleanSeries
from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots import named as autopilot_of
from quadid_logs.control.filters import filter_costs, rate_crossover
from quadid_logs.control.loop import close, gyro_filters, integrators, on_rate
from quadid_logs.control.margins import figures_of, grid_hz
from quadid_logs.data.health import Health, LineSource
from quadid_logs.data.settings import AlignSettings, Settings
from quadid_logs.health import health_of
from quadid_logs.health.records import records
from quadid_logs.load import prepare, read_log
from quadid_logs.maths.spectra import WINDOW_S, Spectra, averaged_spectra
from quadid_logs.pipeline import judge
from quadid_logs.simulator import fly, plan_flights
from quadid_logs.simulator.closed_loop import Noise, Setup
from quadid_logs.simulator.closed_loop import Record as Flown
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.scenarios import SCENARIOS
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.simulator.wind import Wind
from quadid_logs.vocabulary import AXES
from study.faults import AUTOPILOTS, CLEAN, ROUGH
from study.margins import draw_loop
from study.measure import setup_of, simulate_drawn
from study.structural import log_uniform

#: A line is found where a true one lies within this [Hz].
_NEAR_HZ: Final = 0.5
_RATE_HZ: Final = 400.0
#: A rotor's line lies where it turned for most of the flight [%].
_TURNED: Final = (5.0, 95.0)
#: A frame that rings this near to a rotor's line, as a part of it, is one line with it while that moves.
_APART: Final = 0.1
_FRAME_HZ: Final = (30.0, 170.0)
#: Predicted spectra are held against logged ones in this band [Hz], in thirds of an octave, where nine tenths
#: of both are one signal: a gyro that is logged in whole degrees per second holds little else above 40 Hz.
_BAND_HZ: Final = (5.0, 200.0)
_ONE_SIGNAL: Final = 0.9
#: Of half the log's rate, beyond which what is folded down shows.
_NOT_FOLDED: Final = 0.9
#: What a name may be: of a rotor by its speed where that is logged, by the throttle where it is not; what is
#: left unnamed is not named wrongly.
_RIGHT: Final = {
    "rotor": ("ROTOR", "FOLLOWS_THROTTLE"),
    "frame": ("FIXED", "UNKNOWN"),
}


def shaken(seed: int) -> tuple[Setup, str]:
    """Plan a flight of a vehicle that shakes."""
    rng = np.random.default_rng([seed, *b"lines"])
    name, wind = CLEAN[seed // len(AUTOPILOTS) % len(CLEAN)]
    plain = SCENARIOS[name]
    rotor_hz = _hover_hz(plain.airframe())
    frame_hz = rng.uniform(*_FRAME_HZ)
    while any(abs(frame_hz / (n * rotor_hz) - 1.0) < _APART for n in (1, 2)):
        frame_hz = rng.uniform(*_FRAME_HZ)
    noise = Noise(
        gyro_rad_s_per_rthz=1.0e-4 * log_uniform(rng, 1.0, 5.0),
        rotor_line_rad_s=log_uniform(rng, 0.02, 0.1),
        frame_line_rad_s=log_uniform(rng, 0.02, 0.1),
        frame_line_hz=frame_hz,
    )
    scenario = dataclasses.replace(
        plain,
        noise=noise,
        wind=Wind(speed_m_s=wind),
        effects=dataclasses.replace(plain.effects, disturbance_rad_s2=ROUGH),
    )
    (setup, *_) = plan_flights(
        scenario, seed=seed, duration_s=40.0, rate_hz=_RATE_HZ, autopilot=AUTOPILOTS[seed % len(AUTOPILOTS)]
    )
    return setup, name


def _hover_hz(airframe: Any) -> float:
    return float(airframe.rotor_speed_max_rad_s * np.sqrt(airframe.hover_throttle) / (2.0 * np.pi))


def measure_lines(seed: int) -> dict[str, Any]:
    """Fly once and return every line that was found, beside the true ones.

    Parameters
    ----------
    seed : int

    Returns
    -------
    dict
        Ready for JSON.
    """
    setup, name = shaken(seed)
    flown = fly(setup)
    prepared = prepare(log_flights((flown,), Logging(rate_hz=_RATE_HZ)))
    health = health_of(prepared, cut(prepared, AlignSettings()))
    speeds_hz = _speeds_hz(flown)
    return {
        "seed": seed, "autopilot": setup.autopilot, "flight": name, "frame_hz": setup.noise.frame_line_hz,
        "rotors_hz": np.percentile(speeds_hz, _TURNED, axis=0).T.tolist(), "lines": list(_lines(health)),
    }  # fmt: skip


def _lines(health: Health) -> Iterator[dict[str, Any]]:
    for axis, found in ({} if health.noise is None else health.noise.lines).items():
        for one in found:
            yield {
                "axis": axis, "hz": one.frequency_hz, "db": one.height_db, "source": one.source.name,
                "harmonic": one.harmonic,
            }  # fmt: skip


def _speeds_hz(flown: Flown) -> FloatArray:
    """Return what the rotors turned at in flight, shape (n_samples, n_rotors)."""
    speeds_hz = flown.channels["rotor_speed"] / (2.0 * np.pi)
    return np.asarray(speeds_hz[speeds_hz.min(axis=1) > 0.5 * np.median(speeds_hz)])


def judged(flight: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield of each line that was found which true one is nearest, how far off it stands, and its name.

    Parameters
    ----------
    flight : dict
        Of `measure_lines`.

    A rotor turns at many speeds, the part that rings at one: a line that stands there is its.

    Yields
    ------
    dict
        The line with ``of``, ``off_hz`` and ``named``: rightly, "not" where it is left unnamed, or wrongly.
    """
    for line in flight["lines"]:
        off_rotors = min(max(low - line["hz"], line["hz"] - high, 0.0) for low, high in flight["rotors_hz"])
        off_frame = abs(line["hz"] - flight["frame_hz"])
        of = "rotor" if off_rotors < off_frame and off_frame > _NEAR_HZ else "frame"
        right = line["source"] in _RIGHT[of] and line["harmonic"] in (0, 1)
        named = "rightly" if right else "not" if line["source"] == LineSource.UNKNOWN.name else "wrongly"
        yield {**line, "of": of, "off_hz": off_frame if of == "frame" else off_rotors, "named": named}


def told_of_lines(flights: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table of lines."""
    each = [list(judged(one)) for one in flights]
    yield "| lines of | flights with one | lines | within 0.5 Hz | named rightly | not named | wrongly |"
    yield "|---|---|---|---|---|---|---|"
    for of in _RIGHT:
        some = [line for lines in each for line in lines if line["of"] == of]
        found = sum(any(line["of"] == of for line in lines) for lines in each)
        near = sum(line["off_hz"] <= _NEAR_HZ for line in some)
        counts = (sum(line["named"] == how for line in some) for how in ("rightly", "not", "wrongly"))
        told = " | ".join(f"{count}" for count in counts)
        yield f"| {of} | {found} of {len(flights)} | {len(some)} | {near} | {told} |"
    near = sum(all(line["off_hz"] <= _NEAR_HZ for line in lines) for lines in each)
    right = sum(all(line["named"] == "rightly" for line in lines) for lines in each)
    wrong = sum(any(line["named"] == "wrongly" for line in lines) for lines in each)
    yield ""
    yield (
        f"Of {len(flights)} flights {near} have all lines within 0.5 Hz, {right} have all named rightly, "
        f"{wrong} have one that is named wrongly."
    )


def measure_costs(seed: int, number: int) -> list[dict[str, Any]]:
    """Return of one flight what each filter is told to cost each rate loop, beside the true cost [deg].

    Parameters
    ----------
    seed, number : int
        Of the study of margins.

    Returns
    -------
    list of dict
        Ready for JSON.
    """
    drawn = draw_loop(seed, number)
    log, truth = simulate_drawn(drawn)
    setup, prepared, settings = setup_of(drawn), prepare(log), Settings()
    result = judge(prepared.log, cut(prepared, settings.align), settings, vehicle=None, timings_s={})
    if result.closed_loop is None:
        return []
    rows = []
    for place, axis in enumerate(AXES):
        found, told = result.closed_loop.axes.get(axis), result.closed_loop.controllers.axes.get(axis)
        crossover = None if found is None else rate_crossover(found)
        if told is None or crossover is None:
            continue
        true_hz = _true_crossover_hz(setup, truth, place)
        for cost in filter_costs(told, crossover):
            true = _true_cost_deg(setup, place, cost.name, true_hz)
            if cost.phase_deg is not None and true is not None:
                low, high = cost.phase_deg.ci95
                rows.append(
                    {
                        "seed": seed, "number": number, "axis": axis, "filter": cost.name, "truth": true,
                        "value": cost.phase_deg.value, "low": low, "high": high,
                    }
                )  # fmt: skip
    return rows


def _true_crossover_hz(setup: Setup, truth: dict[str, Any], axis: int) -> float:
    """Return where the rate loop that the simulator ran crosses over."""
    controller, frequency_hz = true_controller(setup, axis), grid_hz(1.0 / setup.loop_hz)
    loop = close(controller, true_plant(setup, truth, axis), frequency_hz)
    figures = figures_of(frequency_hz, loop.rate, integrators(controller), np.array([False]))
    return float(figures.crossover_hz[0])


def _true_cost_deg(setup: Setup, axis: int, name: str, at_hz: float) -> float | None:
    """Return the phase that the loop gains without a filter; None of one that the simulator does not have."""
    with_it = true_controller(setup, axis)
    if name in ("INS_GYRO_FILTER", "IMU_GYRO_CUTOFF"):
        without = dataclasses.replace(with_it, gyro=())
    elif name.endswith("_FLTD") or name == "IMU_DGYRO_CUTOFF":
        tuning = dataclasses.replace(setup.tuning, derivative_hz=0.0, axis_derivative_hz=None)
        without = true_controller(dataclasses.replace(setup, tuning=tuning), axis)
    elif name.endswith("_FLTE") and setup.tuning.error_hz:
        tuning = dataclasses.replace(setup.tuning, error_hz=0.0)
        without = true_controller(dataclasses.replace(setup, tuning=tuning), axis)
    else:
        return None
    at = np.array([at_hz])
    both = on_rate(with_it, at)[0] / on_rate(without, at)[0]
    return -float(np.degrees(np.angle(both)))


def told_of_costs(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table of costs."""
    yield "| filter | axes | error, median | 95 % | largest | within 1 degree | inside the interval |"
    yield "|---|---|---|---|---|---|---|"
    for kind, ends in {"gyro": ("FILTER", "GYRO_CUTOFF"), "D": ("FLTD",), "error": ("FLTE",)}.items():
        mine = [one for one in rows if one["filter"].endswith(ends)]
        off = np.array([abs(one["value"] - one["truth"]) for one in mine])
        if not mine:
            continue
        inside = sum(one["low"] - 0.05 <= one["truth"] <= one["high"] + 0.05 for one in mine)
        errors = f"{np.median(off):.2f} | {np.quantile(off, 0.95):.2f} | {off.max():.2f}"
        yield f"| {kind} | {len(mine)} | {errors} | {np.count_nonzero(off <= 1.0)} | {inside} |"


def measure_filtered(path: Path) -> list[dict[str, Any]]:
    """Hold the gyro behind the filters of a firmware log against what its filters make of that before them.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of dict
        Of each axis and third of an octave from 5 to 200 Hz in which both are of one signal.
    """
    log = read_log(path)
    prepared = prepare(log)
    flights = cut(prepared, AlignSettings()).flights
    sources = [one for one in prepared.candidates.get("body_rate", ()) if one.n_samples >= 2]
    raw, filtered = (
        max((one for one in sources if one.raw is is_raw), key=lambda one: one.rate_hz, default=None)
        for is_raw in (True, False)
    )
    controllers = autopilot_of(log.autopilot).controllers(log, log.parameters)
    if raw is None or filtered is None or controllers is None:
        return []
    both, period_s = records([raw, filtered], flights)
    rows = []
    for place, axis in enumerate(AXES):
        controller = controllers.axes.get(axis)
        if controller is None:
            continue
        spectra = averaged_spectra(
            [(one.values[:, place], one.values[:, len(AXES) + place]) for one in both],
            period_s=period_s,
            n_per_segment=round(WINDOW_S / period_s),
        )
        averaged = _averaged(raw, spectra.frequency_hz)
        made_of_it = np.abs(gyro_filters(controller, spectra.frequency_hz)) / averaged
        rows += [{"log": path.name, "axis": axis, **one} for one in _thirds(spectra, made_of_it)]
    return rows


def _averaged(raw: CleanSeries, frequency_hz: FloatArray) -> FloatArray:
    """Return what the unfiltered gyro of a log has lost to averaging before it was logged.

    PX4's sensor_combined integrates by trapezoids (vehicle_imu/Integrator.hpp): the mean of two samples. What
    ArduPilot's SIDD holds is the angle that was gained in a loop, over its time (mode_systemid.cpp).
    """
    turned = frequency_hz * raw.period_s
    if raw.source.startswith("sensor_combined"):
        return np.asarray(np.abs(np.cos(np.pi * turned)))
    if raw.source.startswith("SIDD"):
        return np.asarray(np.abs(np.sinc(turned)))
    return np.ones(frequency_hz.shape)


def _thirds(spectra: Spectra, gain: FloatArray) -> Iterator[dict[str, Any]]:
    """Yield by how much the predicted spectrum is off in thirds of an octave that hold one signal [dB]."""
    made, there, explained = gain**2 * spectra.input_psd, spectra.output_psd, spectra.coherence
    edges = np.geomspace(*_BAND_HZ, 17)
    for low_hz, high_hz in itertools.pairwise(edges):
        here = (spectra.frequency_hz >= low_hz) & (spectra.frequency_hz < high_hz)
        here &= spectra.frequency_hz < _NOT_FOLDED * spectra.frequency_hz[-1]
        if here.any() and explained[here].mean() >= _ONE_SIGNAL:
            off_db = 10.0 * np.log10(made[here].sum() / there[here].sum())
            yield {"low_hz": float(low_hz), "high_hz": float(high_hz), "off_db": float(off_db)}


def told_of_filtered(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table of predicted spectra."""
    yield "| log | axis | bands of one signal | up to [Hz] | largest error [dB] | within 1 dB |"
    yield "|---|---|---|---|---|---|"
    for log, axis in sorted({(one["log"], one["axis"]) for one in rows}):
        mine = [one for one in rows if (one["log"], one["axis"]) == (log, axis)]
        off = np.abs([one["off_db"] for one in mine])
        highest_hz = max(one["high_hz"] for one in mine)
        near = np.count_nonzero(off <= 1.0)
        yield f"| {log} | {axis} | {len(mine)} | {highest_hz:.0f} | {off.max():.2f} | {near} |"


def main() -> None:
    """Fly what is not flown yet, and tell."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, required=True, help="a folder")
    parser.add_argument("--flights", type=int, default=20, help="whose lines are looked for (default 20)")
    parser.add_argument("--costs", type=int, default=8, help="flights whose filters are told (default 8)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--logs", type=Path, nargs="*", default=(), help="of firmware, with both gyros")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    numbers = [(options.seed, number) for number in range(options.costs)]
    flights = _kept(
        options.output / "lines.jsonl",
        [(options.seed + number,) for number in range(options.flights)],
        lambda seed: [measure_lines(seed)],
    )
    print("\n".join(told_of_lines(flights)), "\n")
    print("\n".join(told_of_costs(_kept(options.output / "costs.jsonl", numbers, measure_costs))), "\n")
    print("\n".join(told_of_filtered([row for path in options.logs for row in measure_filtered(path)])))


def _kept(
    path: Path, wanted: list[tuple[int, ...]], measured: Callable[..., list[dict[str, Any]]]
) -> list[dict[str, Any]]:
    """Return the rows of all flights; a run that was stopped goes on where its file ends."""
    known = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {tuple(one["flight"]) for one in known}
    with path.open("a", encoding="utf-8") as file:
        for flight in wanted:
            if flight not in done:
                known.append({"flight": flight, "rows": measured(*flight)})
                file.write(json.dumps(known[-1]) + "\n")
                file.flush()
    return [row for one in known if tuple(one["flight"]) in wanted for row in one["rows"]]


if __name__ == "__main__":
    main()
