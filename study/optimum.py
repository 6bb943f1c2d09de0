"""How far from the best gains a pilot ends: `python study/run.py --optimum`.

Vehicles drawn at random are flown in air of three strengths and tuned from their logs, at most three times.
The attitude error that the true gusts make around the true loop is held against that of the best gains: a
search that knows the true vehicle, sees no log, and keeps the same limits of margins, noise and ranges.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots import named
from quadid_logs.control.loop import close
from quadid_logs.control.scaled_loop import scaled_loops, spare
from quadid_logs.data.catalogue import WELL_EXCITED_DEG_S
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.off_nominal import AS_FLOWN
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD, Tuning
from quadid_logs.earlier import with_earlier
from quadid_logs.simulator import Scenario, fly, manoeuvres
from quadid_logs.simulator.closed_loop import Setup
from quadid_logs.simulator.effects import disturbance_density
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.simulator.wind import Wind
from quadid_logs.tuning import recommend
from quadid_logs.vocabulary import AXES
from study.draw import Manoeuvre
from study.tuning import (
    analyzed,
    changed,
    draw_betaflight,
    draw_vehicle,
    figures,
    flyable,
    gains_of,
    of_each_gain,
    resting_truth,
    run_study,
    setup_of,
    with_change,
)

#: Strength of the gusts [rad/s^2]: calm, light wind, and nearly what a flown indoor quadrotor leaves.
GUSTS: Final = (0.15, 0.5, 1.0)
#: So many times a pilot changes the gains of an axis, in so many flights: of some nothing comes.
N_CHANGES: Final = 3
_MOST_FLIGHTS: Final = 6
#: A pilot who is told to fly gentler manoeuvres does, or stronger ones about an axis: these findings say so
#: where it turned less than is called enough.
_GENTLER: Final = 0.6
_STRONGER: Final = ("QL403", "QL503", "QL504", "QL505")
#: A pilot who is told to fly manoeuvres that reach twice the crossover does: sums of sines from here, up to
#: here at least [Hz], of so many times the rate of doublets.
_BEGINS_HZ: Final = (0.25, 0.25, 0.15)
_REACHES_HZ: Final = (6.0, 6.0, 2.0)
_RMS: Final = (0.75, 0.75, 0.3)
#: Gusts that make an attitude error [Hz].
_GUSTS_HZ: Final = (0.05, 60.0)
_N_GUSTS: Final = 400
#: Where the attitude's bandwidth is [Hz], and the most that a disturbance's effect may be raised by (DRP of
#: ADS-33E practice, 5 dB).
_ATTITUDE_HZ: Final = (0.05, 30.0)
_MOST_PEAK_DB: Final = 5.0
#: The most that an answer to a set-point rises by: of a damping ratio of 0.35 (ADS-33E, level 1).
_MOST_RESONANCE_DB: Final = 3.67
#: Of the command's range, what gyro noise may take at most, where it is above what a pilot commands [Hz].
_MOST_NOISE: Final = 0.05
_NOISE_ABOVE_HZ: Final = 15.0
#: What an axis is to end within, of the best error: roll and pitch, and yaw.
_ROLL: Final = 1.3
_YAW: Final = 1.5
#: Values in a file are rounded.
_ROUNDING: Final = 0.02
#: The search of the best gains: vehicles by gain, generations, steps of its end.
_POPULATION: Final = 8
_GENERATIONS: Final = 40
_POLISHED: Final = 600
#: The best gains lie within these factors of the vehicle's suited ones.
_FACTORS: Final = (0.02, 50.0)
_PENALTY: Final = 30.0


#: Of the vehicles that flew, the best factors by seed, vehicle and axis.
_BEST: dict[tuple[int, int, int], FloatArray] = {}


class Judge(NamedTuple):
    """One true axis: its vehicle, its controllers, and the air that it flies in."""

    setup: Setup
    plant: Plant
    axis: int
    flown: FloatArray
    highest: FloatArray
    least_hz: float

    def controller(self, factors: FloatArray) -> AxisController:
        """Return the controller with factors on P, I, D and the angle gain, shape (4,)."""
        single = np.ones((4, 3))
        single[:, self.axis] = factors
        rows = tuple((roll, pitch, yaw) for roll, pitch, yaw in single.tolist())
        tuning = dataclasses.replace(self.setup.tuning, single_gain=rows)
        return true_controller(dataclasses.replace(self.setup, tuning=tuning), self.axis)

    def error_rad(self, controller: AxisController) -> float:
        """Return the standard deviation of the attitude [rad] that the gusts make."""
        frequency_hz = np.geomspace(*_GUSTS_HZ, _N_GUSTS)
        s = 2j * np.pi * frequency_hz
        loop = close(controller, self.plant, frequency_hz)
        whole = (loop.rate if loop.full is None else loop.full)[0]
        answer = np.abs(1.0 / (s * (s - self.plant.damping[0]) * (1.0 + whole))) ** 2
        gusts = disturbance_density(frequency_hz) * self.setup.effects.disturbance_rad_s2[self.axis] ** 2
        return float(np.sqrt(np.trapezoid(answer * gusts, frequency_hz)))

    def noise(self, controller: AxisController) -> float:
        """Return the standard deviation of the command that the gyro's noise makes, as part of its range."""
        frequency_hz = np.linspace(_NOISE_ABOVE_HZ, 0.499 / controller.period_s, _N_GUSTS)
        loop = close(controller, self.plant, frequency_hz)
        whole = (loop.rate if loop.full is None else loop.full)[0]
        vehicle = self.plant.response(frequency_hz, controller.period_s)[0]
        gain = np.abs(loop.rate[0] / vehicle / (1.0 + whole)) ** 2
        density = self.setup.noise.gyro_rad_s_per_rthz**2
        return float(np.sqrt(np.trapezoid(gain * density, frequency_hz)))

    def attitude(self, controller: AxisController) -> tuple[float, float, float]:
        """Return the attitude's bandwidth [Hz] and the peak of what it makes of disturbances [dB] (ADS-33E).

        Up to the bandwidth the attitude follows its set-point with 45 degrees to spare, and with 3 dB less.
        The third is the most that the rate or the attitude answers its set-point with [dB]. Without an angle
        loop the attitude is the pilot's.
        """
        frequency_hz = np.geomspace(*_ATTITUDE_HZ, _N_GUSTS)
        loop = close(controller, self.plant, frequency_hz)
        if loop.full is None:
            return np.inf, 0.0, 20.0 * math.log10(float(np.abs(loop.target_to_rate[0]).max()))
        follows = ((loop.full - loop.rate) / (1.0 + loop.full))[0]
        late = (np.degrees(np.unwrap(np.angle(follows))) < -135.0) | (np.abs(follows) < np.sqrt(0.5))
        bandwidth_hz = float(frequency_hz[np.argmax(late)]) if late.any() else float(_ATTITUDE_HZ[1])
        rejects = np.abs((1.0 + loop.rate) / (1.0 + loop.full))[0]
        highest = np.abs([rejects, np.maximum(np.abs(follows), np.abs(loop.target_to_rate[0]))]).max(axis=1)
        peak_db, resonance_db = (20.0 * np.log10(highest)).tolist()
        return bandwidth_hz, peak_db, resonance_db

    def spare(self, controller: AxisController) -> float:
        """Return the worst of the true margins over its limit."""
        return spare(scaled_loops(controller, self.plant, np.inf).margins(), GOOD)

    def missing(self, factors: FloatArray, most_noise: float) -> float:
        """Return what is missing of all that the best gains keep, 0 for nothing."""
        proportional, integral = factors[:2] / self.flown[:2]
        # The integral gain holds what no spectrum shows, as a load off centre: it falls with P alone.
        missing = max(min(proportional, 1.0) / integral - 1.0, 0.0)
        missing += float(np.sum(np.maximum(factors / self.highest - 1.0, 0.0)))
        controller = self.controller(factors)
        missing += max(1.0 - self.spare(controller), 0.0)
        missing += max(self.noise(controller) / most_noise - 1.0, 0.0)
        bandwidth_hz, peak_db, resonance_db = self.attitude(controller)
        slower = 1.0 - bandwidth_hz / self.least_hz if self.least_hz else 0.0
        missing += max(slower, 0.0) + max(peak_db / _MOST_PEAK_DB - 1.0, 0.0)
        return missing + max(resonance_db / _MOST_RESONANCE_DB - 1.0, 0.0)

    def cost(self, factors: FloatArray, most_noise: float) -> float:
        """Return the error as a logarithm, and what is missing of the limits."""
        error_rad = self.error_rad(self.controller(factors))
        return float(np.log(error_rad) + _PENALTY * self.missing(factors, most_noise))


def best_factors(judge: Judge, most_noise: float, flown: FloatArray | None = None) -> FloatArray:
    """Search P, I, D and the angle gain for the least attitude error; knows the true vehicle and no log.

    Parameters
    ----------
    judge : Judge
    most_noise : float
        Of the command.
    flown : ndarray, shape (n_flights, 4), optional
        Factors that the search begins at, instead of everywhere.

    Returns
    -------
    ndarray, shape (4,)
        Factors on the gains that suit the vehicle.
    """
    from scipy.optimize import differential_evolution

    # A gain of none stays none, and the angle gain where roll and pitch share it.
    whole = judge.setup.autopilot == "betaflight"
    varied = np.flatnonzero(_suited_gains(judge.setup)[: 3 if whole else 4, judge.axis] > 0.0)

    def cost(logs: FloatArray) -> float:
        factors = np.ones(4)
        factors[varied] = np.exp(logs)
        return judge.cost(factors, most_noise)

    from scipy.optimize import minimize

    if flown is None:
        bounds = [tuple(np.log(_FACTORS))] * varied.size
        begin = differential_evolution(
            cost, bounds, seed=1, popsize=_POPULATION, maxiter=_GENERATIONS, tol=1e-4, polish=False
        ).x
    else:
        begin = min(np.log(flown[:, varied]), key=cost)
    polished = minimize(cost, begin, method="Nelder-Mead", options={"maxiter": _POLISHED, "xatol": 1e-3})
    factors = np.ones(4)
    factors[varied] = np.exp(polished.x)
    return factors


def _suited_gains(setup: Setup) -> FloatArray:
    """Return P, I, D and the angle gain that suit the vehicle, shape (4, 3)."""
    plain = dataclasses.replace(
        setup, tuning=dataclasses.replace(setup.tuning, single_gain=((1.0,) * 3,) * 4)
    )
    return gains_of(plain)


def measure_road(seed: int, number: int) -> dict[str, Any]:
    """Fly and tune one vehicle in air of one strength, and hold every flight's gains against the best.

    Parameters
    ----------
    seed, number : int
        The air goes with the number: vehicle ``number // 3`` flies in all three.

    Returns
    -------
    dict
        Its settings, and one entry of ``flights`` for each flight, ready for JSON.
    """
    vehicle, air = divmod(number, len(GUSTS))
    gusts = GUSTS[air]
    scenario, autopilot, settings, factors = draw_in_gusts(seed, vehicle, gusts)
    manoeuvre, strength = scenario.manoeuvre, np.ones(3)
    judges: list[Judge] = []
    most: list[float] = []
    flights: list[dict[str, Any]] = []
    alone: list[Result] = []
    differed = False
    n_changes = np.zeros(3, dtype=np.int64)
    for count in range(_MOST_FLIGHTS + 1):
        setup = setup_of(scenario, autopilot, factors, 1000 * seed + 10 * number + count)
        if count < _MOST_FLIGHTS and (n_changes < N_CHANGES).any():
            alone.append(analyzed(fly(setup), scenario))
            result = with_earlier(alone[-1], alone[:-1])
        if not judges:
            judges = [judge_of(setup, result.log.parameters, axis) for axis in range(3)]
            most = [max(_MOST_NOISE, one.noise(one.controller(factors[:, one.axis]))) for one in judges]
        told: dict[str, Any] = {"factors": factors.tolist()}
        told["axes"] = {
            axis: _true(judges[place], factors[:, place], most[place]) for place, axis in enumerate(AXES)
        }
        flights.append(told)
        may = n_changes < N_CHANGES
        if count == _MOST_FLIGHTS or not may.any():
            break
        # The best gains keep their limits for the vehicle as it flies: so do these.
        every = recommend(result, ranges=AS_FLOWN)
        tuning = dataclasses.replace(
            every, axes={axis: every.axes[axis] for axis, one in zip(AXES, may, strict=True) if one}
        )
        _recommended(told["axes"], result, tuning)
        # Nothing changed: the odd flight is left out, or those before it once the next agrees with it.
        differs = any(one.code == "QL626" for each in every.axes.values() for one in each.reasons)
        alone = alone if not differs else alone[-1:] if differed else alone[:-1]
        differed = differs
        gentler = any(one.code in {"QL617", "QL635"} for each in tuning.axes.values() for one in each.reasons)
        # Kept for what this flight does not show: the next one, with the same gains, shows more.
        again = any(one.code in {"QL646", "QL647"} for each in tuning.axes.values() for one in each.reasons)
        weak = np.array([axis in tuning.axes and _is_weak(result, tuning, axis) for axis in AXES])
        if not (tuning.changes or gentler or again or differs or weak.any()):
            break
        if gentler:
            strength *= _GENTLER
        else:
            strength[weak] /= _GENTLER
            if any(one.code == "QL647" for each in tuning.axes.values() for one in each.reasons):
                manoeuvre = _wider(manoeuvre, result)
        scenario = dataclasses.replace(
            scenario, manoeuvre=partial(_flown, manoeuvre=manoeuvre, strength=strength.copy())
        )
        factors = with_change(scenario, autopilot, factors, np.where(may, changed(every, result), 1.0))
        n_changes += [axis in tuning.axes and bool(tuning.axes[axis].changes) for axis in AXES]
    best = [_best(one, noise, (seed, vehicle), flights) for one, noise in zip(judges, most, strict=True)]
    for flight in flights:
        for axis, one in zip(AXES, best, strict=True):
            flight["axes"][axis]["over_best"] = flight["axes"][axis]["error_rad"] / one["error_rad"]
    return {"number": number, "seed": seed, "gusts": gusts, **settings, "best": best, "flights": flights}


def draw_in_gusts(
    seed: int, vehicle: int, gusts_rad_s2: float
) -> tuple[Scenario, str, dict[str, Any], FloatArray]:
    """Draw a vehicle in such air: scenario, autopilot, what was drawn, and factors on its gains."""
    # Every third has Betaflight.
    draw = draw_betaflight if vehicle % 3 == 2 else draw_vehicle
    drawn, autopilot, settings = draw(seed, vehicle)
    disturbance = (gusts_rad_s2, gusts_rad_s2, 0.5 * gusts_rad_s2)
    effects = dataclasses.replace(drawn.effects, disturbance_rad_s2=disturbance)
    scenario = dataclasses.replace(drawn, wind=Wind(), effects=effects)
    rng = np.random.default_rng([seed, vehicle, *b"detuning"])
    return scenario, autopilot, settings, of_each_gain(flyable(scenario, autopilot, rng))


def _flown(
    time_s: FloatArray, rng: np.random.Generator, *, manoeuvre: Manoeuvre, strength: FloatArray
) -> manoeuvres.Reference:
    """Fly a manoeuvre with so many times its rates or angles about each axis, shape (3,)."""
    reference = manoeuvre(time_s, rng)
    return dataclasses.replace(
        reference,
        rate_rad_s=strength * reference.rate_rad_s,
        tilt_rad=strength[:2] * reference.tilt_rad,
        yaw_rate_rad_s=strength[2] * reference.yaw_rate_rad_s,
    )


def _is_weak(result: Result, tuning: Tuning, axis: str) -> bool:
    """Tell whether the pilot is told to fly stronger manoeuvres about an axis that is refused."""
    codes = {one.code for one in tuning.axes[axis].reasons}
    if "QL618" in codes or "QL615" not in codes:
        return "QL618" in codes
    rates = (
        one.evidence.get("rate_rms_deg_s")
        for one in result.diagnosis.findings
        if axis in one.axes and one.code in _STRONGER
    )
    return any(isinstance(one, float | int) and one < WELL_EXCITED_DEG_S for one in rates)


def _wider(manoeuvre: Any, result: Result) -> Any:
    """Return sums of sines that reach twice the crossover that is told, about as strong as what was flown.

    Sticks move as fast as a pilot's already.
    """
    assert isinstance(manoeuvre, partial)
    if manoeuvre.func is manoeuvres.sticks:
        return manoeuvre
    told = manoeuvre.keywords
    rms = told.get("rms_rad_s") or tuple(part * told["amplitude_rad_s"] for part in _RMS)
    highest_hz = []
    for axis, least_hz in zip(AXES, _REACHES_HZ, strict=True):
        loop = None if result.closed_loop is None else result.closed_loop.axes.get(axis)
        margins = None if loop is None else loop.margins
        crossover = None if margins is None else margins.rate.crossover_hz
        highest_hz.append(least_hz if crossover is None else max(2.0 * crossover.value, least_hz))
    bands = tuple((low, high) for low, high in zip(_BEGINS_HZ, highest_hz, strict=True))
    return partial(manoeuvres.multisine, rms_rad_s=rms, band_hz=bands)


def judge_of(setup: Setup, parameters: Mapping[str, float], axis: int) -> Judge:
    """Return what is true of one axis; the documented ranges of its gains as factors on the suited ones."""
    tunable = named(setup.autopilot).tunable(parameters)
    assert tunable is not None
    names = tunable.axes[AXES[axis]]
    flown = np.array(setup.tuning.single_gain)[:, axis]
    own = (names.proportional, names.integral, names.derivative)

    def most(name: str) -> float:
        return names.factors(name, parameters[name])[1] if parameters.get(name) else np.inf

    # A gain that multiplies all three takes each of them beyond its own range.
    common = math.prod(map(most, names.common))
    ranges = np.array([*(common * most(name) for name in own), most(names.angle)])
    judge = Judge(setup, true_plant(setup, resting_truth(setup), axis), axis, flown, flown * ranges, np.nan)
    # Gusts alone would have the attitude follow its pilot slowly: not slower than with gains that suit it.
    # An angle gain that roll and pitch share sets that by itself.
    return judge._replace(least_hz=judge.attitude(judge.controller(np.ones(4)))[0] if names.angle else 0.0)


def _best(
    judge: Judge, most_noise: float, vehicle: tuple[int, int], flights: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return the best factors and their error; noise may be what it is allowed to be, or what it was.

    Gusts are alike but for their strength, so the best gains of a vehicle are those in any air.
    """
    key = (*vehicle, judge.axis)
    if key not in _BEST:
        _BEST[key] = best_factors(judge, most_noise)
    # A search may end beside the best: gains that flew are where it begins again.
    flown = np.array([flight["axes"][AXES[judge.axis]]["factors"] for flight in flights])
    again = best_factors(judge, most_noise, np.unique(flown, axis=0))
    factors = _BEST[key] = min(_BEST[key], again, key=lambda one: judge.cost(one, most_noise))
    return _true(judge, factors, most_noise)


def _true(judge: Judge, factors: FloatArray, most_noise: float) -> dict[str, Any]:
    """Return what is true of an axis with some gains."""
    controller = judge.controller(factors)
    return {
        "error_rad": judge.error_rad(controller),
        "spare": judge.spare(controller),
        "noise": judge.noise(controller),
        "missing": judge.missing(factors, most_noise),
        "factors": factors.tolist(),
    }


def _recommended(axes: dict[str, dict[str, Any]], result: Result, tuning: Tuning) -> None:
    """Add what was recommended of each axis."""
    for axis, found in tuning.axes.items():
        axes[axis] |= {
            "verdict": found.verdict,
            "reasons": [one.code for one in found.reasons],
            "codes": list(result.diagnosis.axes[axis].reasons),
            "now": figures(found.now),
            "next": figures(found.next),
        }


def summarise(roads: list[dict[str, Any]]) -> str:
    """Return the tables of the study.

    Parameters
    ----------
    roads : list of dict
        As of `measure_road`.

    Returns
    -------
    str
        Markdown.
    """
    failed = [one for one in roads if "error" in one]
    flown = [one for one in roads if "error" not in one]
    vehicles = {(one["seed"], one["number"] // len(GUSTS)) for one in flown}
    lines = [
        f"{len(vehicles)} vehicles in gusts of {', '.join(f'{one:g}' for one in GUSTS)} rad/s², "
        f"{len(flown)} series of at most {_MOST_FLIGHTS} flights with at most {N_CHANGES} changes of each "
        f"axis, {len(failed)} failed.",
        "",
        "| axis, gusts | series | error over that of the best gains: flown | after the last change, median "
        "(90 % quantile) | within 1.3 | within 1.5 |",
        "|---|---|---|---|---|---|",
    ]
    for axis in AXES:
        for gusts in (*GUSTS, None):
            some = [_ends(one, axis) for one in flown if gusts in {None, one["gusts"]}]
            if not some:
                continue
            first, last = (np.array([one[place] for one in some]) for place in (0, 1))
            name = "all" if gusts is None else f"{gusts:g}"
            lines.append(
                f"| {axis}, {name} | {len(some)} | {np.median(first):.2f} | {np.median(last):.2f} "
                f"({np.quantile(last, 0.9):.2f}) | {_percent(last <= _ROLL)} | {_percent(last <= _YAW)} |"
            )
    ends = [one["flights"][-1]["axes"][axis] for one in flown for axis in AXES]
    every = [one["over_best"] for one in ends]
    below = [one["missing"] > 0.0 for one in ends if one["over_best"] < 1.0]
    pairs = [pair for one in flown for axis in AXES for pair in _changes(one, axis)]
    kept = [after >= min(1.0, before) - _ROUNDING for before, after in pairs]
    least = min((after for _, after in pairs if after), default=float("nan"))
    lines += [
        "",
        f"- Changes of gains: {len(pairs)}. After {_percent(np.array(kept))} of them, true margins met the "
        f"limits or were no further below them; unstable loops: {sum(after <= 0.0 for _, after in pairs)}; "
        f"smallest margin over its limit: {least:.2f}.",
        f"- Final gains with a smaller error than the best gains: {len(below)}. Of these, "
        f"{sum(map(bool, below))} miss another requirement (attitude bandwidth, integral gain, noise). "
        f"Smallest ratio of errors: {min(every, default=float('nan')):.2f}.",
    ]
    codes = Counter(
        " ".join([code, *(["(" + " ".join(told["codes"]) + ")"] if code == "QL615" else [])])
        for one in flown
        for flight in one["flights"]
        for told in flight["axes"].values()
        if told.get("verdict") == "refused"
        for code in told["reasons"]
    )
    judged = sum(
        "verdict" in flight["axes"][axis] for one in flown for axis in AXES for flight in one["flights"]
    )
    named_codes = ", ".join(f"{code} {count}" for code, count in codes.most_common(12))
    lines.append(f"- Refused in {sum(codes.values())} of {judged} verdicts: {named_codes}.")
    return "\n".join(lines) + "\n"


def _ends(road: dict[str, Any], axis: str) -> tuple[float, float]:
    """Return the error over the best one in the first and in the last flight."""
    each = [flight["axes"][axis]["over_best"] for flight in road["flights"]]
    return each[0], each[-1]


def _changes(road: dict[str, Any], axis: str) -> Iterator[tuple[float, float]]:
    """Yield what is kept of the limits before and after each change of gains."""
    told = [flight["axes"][axis] for flight in road["flights"]]
    for before, after in itertools.pairwise(told):
        if before.get("verdict") == "change":
            yield before["spare"], after["spare"]


def _percent(which: FloatArray) -> str:
    return f"{100.0 * float(np.mean(which)):.0f} %"


def main(arguments: list[str] | None = None) -> int:
    """Fly what is missing of the study, then print and write its tables."""
    return run_study(
        arguments,
        "Fly, tune, fly again, and hold the gains against the best; each vehicle in three airs.",
        (14, len(GUSTS)),
        "optimum",
        (measure_road, summarise),
    )
