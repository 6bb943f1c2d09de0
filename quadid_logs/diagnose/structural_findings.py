"""Caveats about what the model does not know of: effects that a log can hold and no rigid body has."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from quadid_logs.data.diagnosis import Finding, Level
from quadid_logs.data.flight import FlightData
from quadid_logs.data.health import Rotors
from quadid_logs.data.model import (
    Effect,
    EffectCheck,
    Excitation,
    Identification,
    Model,
    SpectralFit,
    StructuralCheck,
)
from quadid_logs.diagnose.findings import finding, rounded
from quadid_logs.identify.excitation import LEAST_BANDWIDTH, MOST_IN_ONE_LINE, holds_one_frequency
from quadid_logs.identify.parameters import is_explained
from quadid_logs.identify.spectral_effects import AVERAGED
from quadid_logs.identify.structural import (
    LARGE_SHIFT,
    LARGEST_SHIFT,
    evidence_needed,
    is_late,
    possible_losses,
    seen_effects,
)
from quadid_logs.identify.two_vehicles import of_all_axes
from quadid_logs.maths.random_effect import random_effect
from quadid_logs.maths.rotations import tilt_from_rates
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, ON_AXIS, RATE_SYMBOLS

#: Gyros of flight controllers end at 2000 deg/s, a few at 4000 [rad/s].
_FASTEST_RAD_S = np.radians(4000.0)
#: A few samples may be damaged.
_MOST_TOO_FAST = 0.01
#: A flip takes a third of a second: one every three seconds throughout is no flight without attitude.
_MOST_UPSIDE_DOWN = 0.1
#: Nor does one turn at so many rad/s rms; a manoeuvre of as many deg/s is hardly one [rad/s].
_ACROBATICS_RAD_S = 5.0
#: Gyros and calibrations leave two per cent: less is no matter. In the fitted band a torque is half of what
#: it is as a whole, or more, and a step twice as much of it.
_COARSE = 0.01
#: Of torques that act through rotors, one in a thousand looks as if nothing lay between by chance.
_BY_CHANCE = 1e-3
#: What was computed from the rates is most of them, beside the rounding of what was logged.
_MOST = 0.5
#: Axes that the rotors' thrust turns, without a reaction.
_TILTING = 2
#: Damping of multirotors is published at up to some 5 1/s, rate loops close at 5 to 30 rad/s, in yaw at 2.
_MOST_DAMPING_1_S = 5.0
_LEAST_LOOP_1_S = 2.0
#: Behind a rate loop a constant command is a rate: effectiveness over damping is about one.
_COMMAND_IS_RATE = (0.5, 2.0)
#: Of a normal distribution: one axis in thirty thousand by chance, and one flight in five thousand.
_PERSISTS, _ALL_PERSIST = 4.0, 3.5
#: Effectiveness is not known better than to some per cent in practice: less is no matter.
_VARIES = 0.05
#: Flights of one vehicle differ by battery and air density.
_FLIGHTS_DIFFER = 0.03
#: Probability by chance at which flights are not of one effectiveness.
_FLIGHTS_SEEN = 1e-4

#: That rotors do not respond with one lag.
_LAG: Final = "QL527"
_CODES: Final[dict[Effect, str]] = {
    "threshold": "QL523",
    "rotor threshold": "QL523",
    "limit": "QL524",
    "mode": "QL525",
    "tilt": "QL526",
    "swing": "QL526",
    "second lag": _LAG,
    "asymmetry": _LAG,
    "varying gain": "QL528",
}
#: What acts below the loop's frequencies and in proportion: a response to commands that knows its lag and
#: damping at all of them, each weighted, is none the worse for it.
_LINEAR: Final[frozenset[Effect]] = frozenset({"tilt", "swing"})
#: What a loss of torque would be, after "if".
_IF: Final[dict[Effect, str]] = {
    "threshold": "small torques had less effect",
    "rotor threshold": "small changes of a rotor's command had less effect",
    "limit": "large torques had less effect",
}
#: What it is that they are looked for at, where that is not a torque.
_PLACES: Final[dict[Effect, str]] = {
    "mode": "frequency_hz",
    "swing": "frequency_hz",
    "rotor threshold": "rotor_command",
}


def find_in_structure(data: FlightData, identification: Identification) -> Iterator[Finding]:
    """Yield the findings about rates, set-points, excitation and effects that the model does not have.

    Parameters
    ----------
    data : FlightData
    identification : Identification

    Yields
    ------
    Finding
    """
    yield from _rates(data)
    model = identification.recommended
    if model is None:
        return
    explained = [
        number
        for number, excitation in enumerate(identification.excitation)
        if is_explained(model, excitation.signal_to_noise, number)
    ]
    # What the motors gave is a torque: per newton metre, a rate near one is a coincidence of units.
    given = data.input is not None and data.input.achieved
    yield from _commanded_rates(model, explained, may_be_rate=not given)
    yield from _coarse_steps(data, explained, identification.spectral)
    computed = _computed_from_rates(identification.excitation)
    rotors_told = bool(data.segments) and all(one.rotor_thrust is not None for one in data.segments)
    for number in explained:
        if computed:
            yield _computed(identification.excitation[number], AXES[number])
        else:
            yield from _axis(identification, model, number, rotors_told=rotors_told)
    yield from _by_spectra(identification.spectral, rotors_told=rotors_told)
    if model.structural is not None and not computed:
        yield from _whole_model(model.structural, data.sample_period_s)
    if any(segment.reference is None for segment in data.segments):
        yield finding("QL321", "info", _feedback(model))


def find_in_rotors(identification: Identification, rotors: Rotors | None) -> Iterator[Finding]:
    """Yield the finding that a rotor lost thrust, so that one model is of two vehicles.

    Parameters
    ----------
    identification : Identification
    rotors : Rotors or None

    Yields
    ------
    Finding
        A warning where the balance of yaw moved, too, a note where a load explains it as well.
    """
    if identification.recommended is None or rotors is None or not rotors.axes_change:
        return
    lost = next((one for one in rotors.faults if one.code == "QL431"), None)
    ratio = [rounded(one.value, 3) for one in rotors.axes_change]
    evidence: dict[str, object] = dict(zip(AXES, ratio, strict=True))
    if lost is None:
        yield finding("QL536", "info", evidence)
        return
    evidence |= {"rotor": lost.rotor + 1, "time_s": rounded(lost.time_s, 3)}
    yield finding(
        "QL536",
        "warning",
        evidence,
        title="A motor lost thrust in flight, which lowered the effectiveness",
    )


def _coarse_steps(data: FlightData, numbers: Sequence[int], fits: Sequence[SpectralFit]) -> Iterator[Finding]:
    """Say by how much the effectiveness is too high if the torque was cut to whole steps, not rounded.

    Where commands show that it was, what is missing has been put back: no more than other effects.
    """
    if data.input is None or not data.segments:
        return
    torque = np.concatenate([segment.torque for segment in data.segments])
    for number in numbers:
        step = data.input.grid[number]
        size = np.abs(torque[:, number])
        power = float(np.mean(size**2))
        # Cut toward zero, what was logged is less than the torque by half a step on the mean.
        too_high = 0.5 * step * float(np.mean(size)) / power if step else 0.0
        if too_high > _COARSE:
            evidence: dict[str, object] = {
                "step": rounded(step, 3),
                "torque_rms": rounded(float(np.sqrt(power)), 3),
                "too_high_if_cut_by_at_least": rounded(too_high, 2),
            }
            told = number < len(fits) and fits[number].is_told and "cut steps" in fits[number].effects
            level: Level = "info" if told and abs(fits[number].shift) <= LARGE_SHIFT else "warning"
            yield finding("QL534", level, evidence, axes=(AXES[number],))


def _rates(data: FlightData) -> Iterator[Finding]:
    """Say that no vehicle turns like that; where attitude is logged, it is the better judge."""
    if not data.segments:
        return
    rates = np.concatenate([segment.body_rate_rad_s for segment in data.segments])
    too_fast = float(np.mean(np.abs(rates).max(axis=1) > _FASTEST_RAD_S))
    tilt = [tilt_from_rates(segment.body_rate_rad_s, data.sample_period_s) for segment in data.segments]
    upside_down = float(np.mean(np.abs(np.concatenate(tilt)[:, 0]) > 0.5 * np.pi))
    rms = np.std(rates, axis=0)
    judged = data.gyro_check is None and upside_down > _MOST_UPSIDE_DOWN
    if (judged and rms.max() > _ACROBATICS_RAD_S) or too_fast > _MOST_TOO_FAST:
        evidence: dict[str, object] = {
            "fraction_upside_down": rounded(upside_down, 2),
            "fraction_above_4000_deg_s": rounded(too_fast, 2),
            "rate_rms_deg_s": [rounded(value, 3) for value in np.degrees(rms)],
        }
        yield finding("QL320", "error", evidence)


def _feedback(model: Model) -> dict[str, object]:
    """Return by how much feedback may have lowered the effectiveness of each axis."""
    check = model.structural
    if check is None:
        return {}
    return {f"{axis}_higher_by": rounded(each, 2) for axis, each in zip(AXES, check.feedback, strict=True)}


def _axis(
    identification: Identification, model: Model, number: int, *, rotors_told: bool
) -> Iterator[Finding]:
    """Judge one axis: what makes its number worthless is enough, then what would change it."""
    told = any(fit.is_told for fit in identification.spectral[number : number + 1])
    if holds_one_frequency(identification.excitation, number):
        excitation = identification.excitation[number]
        axis = AXES[number]
        evidence: dict[str, object] = {
            "relative_bandwidth": rounded(excitation.bandwidth, 2),
            "needed": LEAST_BANDWIDTH,
            "strongest_line_hz": rounded(excitation.line_hz, 3),
            "fraction_of_power_in_it": rounded(excitation.line_fraction, 2),
            "allowed": MOST_IN_ONE_LINE,
        }
        title = f"The {axis} torque holds little more than one frequency"
        yield finding("QL420", "warning" if told else "error", evidence, axes=(axis,), title=title)
    elif model.structural is not None:
        yield from _effects(model.structural, number, averaged=told, rotors_told=rotors_told)


def _computed_from_rates(excitation: Sequence[Excitation]) -> bool:
    """Say whether the torque was computed from the rates, which roll or pitch tells of all axes.

    Yaw leads where rotors react, by as much as they lag: it tells nothing.
    """
    paths = [each.path for each in excitation[:_TILTING] if each.path is not None]
    return any(path.p_value < _BY_CHANCE and path.explained > _MOST for path in paths)


def _computed(excitation: Excitation, axis: str) -> Finding:
    path, evidence = excitation.path, {}
    if path is not None:
        evidence = {
            "lag_ms": rounded(1e3 * path.lag_s, 2),
            "lag_standard_error_ms": rounded(1e3 * path.lag_error_s, 2),
            "explained": rounded(path.explained, 3),
            "p_value": rounded(path.p_value, 2),
        }
    return finding("QL520", "error", evidence, axes=(axis,))


def _commanded_rates(model: Model, numbers: Sequence[int], *, may_be_rate: bool) -> Iterator[Finding]:
    """Say that what should be torque leads to rates, not to accelerations.

    Where it is a commanded rate about one axis, it is none of the torques.
    """
    evidence, is_rate = {}, False
    for number in numbers:
        axis = AXES[number]
        damping = model.entries.get((ACCELERATION_SYMBOLS[number], RATE_SYMBOLS[number]))
        if damping is None or damping.ci95[1] >= -_LEAST_LOOP_1_S:
            continue
        rate = model.entries[ON_AXIS[axis]].value / -damping.value
        commanded = may_be_rate and _COMMAND_IS_RATE[0] < rate < _COMMAND_IS_RATE[1]
        if commanded or damping.ci95[1] < -_MOST_DAMPING_1_S:
            is_rate = is_rate or commanded
            evidence[axis] = {
                "damping_1_s": rounded(damping.value),
                "ci95": [rounded(value) for value in damping.ci95],
                "rate_per_unit_of_torque": rounded(rate),
            }
    if is_rate:
        yield finding("QL521", "error", evidence, title="The signal logged as torque is the commanded rate")
    elif evidence:
        yield finding("QL521", "error", evidence, axes=tuple(evidence))


def _by_spectra(fits: Sequence[SpectralFit], *, rotors_told: bool = False) -> Iterator[Finding]:
    """Name the effects of which an effectiveness that comes from answers to commands knows."""
    for axis, fit in zip(AXES, fits, strict=False):
        for effect in fit.effects if fit.is_told else ():
            if effect == "cut steps":
                # The finding about the steps is there already.
                continue
            # The interval covers what the form of one leaves open; of two, one may pass for the other.
            large = abs(fit.shift) > LARGE_SHIFT and effect not in _LINEAR
            together = sum(each not in _LINEAR for each in fit.effects) > 1
            level: Level = "warning" if large and together else "info"
            evidence: dict[str, object] = {
                "effect": effect,
                "effectiveness_with_it": rounded(1.0 + fit.shift, 3),
            }
            if effect == "varying gain":
                evidence["rms_deviation"] = rounded(fit.variation, 2)
            yield _named(effect, level, evidence, axis, rotors_told=rotors_told)


def _effects(check: StructuralCheck, number: int, *, averaged: bool, rotors_told: bool) -> Iterator[Finding]:
    """Name the effect that explains most of what the model leaves, and an effectiveness that varies.

    ``averaged``: the effectiveness is that of `identify.spectral_effects`, which judge those that they know.
    """
    axis = AXES[number]
    seen = [each for each in seen_effects(check, number) if not (averaged and each.effect in AVERAGED)]
    if seen:
        # A mode looks like a second lag, a tilt like a mode: the best explanation is enough.
        effect = max(seen, key=lambda each: each.explained)
        level: Level = "error" if abs(effect.shift) > LARGEST_SHIFT else "warning"
        if averaged and effect.effect in _LINEAR:
            level = "info"
        yield _named(effect.effect, level, _evidence(check, effect), axis, rotors_told=rotors_told)
        return
    possible = max(possible_losses(check, number), key=lambda each: abs(each.shift), default=None)
    if possible is not None and abs(possible.shift) > LARGE_SHIFT and not averaged:
        change = f"{100.0 * abs(possible.shift):.0f} % {'higher' if possible.shift > 0.0 else 'lower'}"
        yield finding(
            "QL533",
            "warning",
            _evidence(check, possible),
            axes=(axis,),
            title=f"The {axis} effectiveness would be {change} if {_IF[possible.effect]}: the flight does "
            "not rule that out",
        )
    known = check.persistence[np.isfinite(check.persistence)]
    of_all = float(np.sum(known) / np.sqrt(max(known.size, 1)))
    persists = check.persistence[number] > _PERSISTS or of_all > _ALL_PERSIST
    if persists and check.spread[number] > _VARIES:
        evidence: dict[str, object] = {
            "rms_deviation": rounded(float(check.spread[number]), 2),
            "persistence": rounded(float(check.persistence[number]), 3),
            "needed": _PERSISTS,
            "persistence_of_all_axes": rounded(of_all, 3),
            "needed_of_all_axes": _ALL_PERSIST,
        }
        yield finding("QL528", "warning", evidence, axes=(axis,))


def _named(
    effect: Effect, level: Level, evidence: Mapping[str, object], axis: str, *, rotors_told: bool
) -> Finding:
    """Return the finding of an effect; ``rotors_told``: the log tells what each rotor was sent."""
    named = finding(_CODES[effect], level, evidence, axes=(axis,))
    # Of a lag, nothing else is to be logged then.
    nothing_missing = rotors_told and named.code == _LAG and level != "error"
    return replace(named, advice="") if nothing_missing else named


def _evidence(check: StructuralCheck, effect: EffectCheck) -> dict[str, object]:
    """Return the numbers that speak for an effect, and what it takes for it to be seen."""
    needed_statistic, needed = evidence_needed(check, effect)
    evidence: dict[str, object] = {
        "effect": effect.effect,
        "explains_of_residual": rounded(effect.explained, 2),
        "needed": needed,
        "statistic": rounded(effect.statistic, 3),
        "needed_statistic": needed_statistic,
        "effectiveness_with_it": rounded(1.0 + effect.shift, 3),
    }
    if np.isfinite(effect.place):
        evidence[_PLACES.get(effect.effect, "torque")] = rounded(effect.place, 3)
    return evidence


def _whole_model(check: StructuralCheck, period_s: float) -> Iterator[Finding]:
    """Judge what all axes have in common: the clock, and the flights."""
    timing = check.timing
    if timing is not None:
        evidence: dict[str, object] = {
            "delay_ms": rounded(1e3 * timing.delay_s, 3),
            "ci95_half_width_ms": rounded(1e3 * timing.half_width_s, 2),
            "effectiveness_with_it": [rounded(1.0 + each, 3) for each in timing.shift],
        }
        if is_late(check, period_s):
            yield finding("QL522", "warning", evidence)
        else:
            yield finding(
                "QL507",
                "info",
                evidence,
                title="The delay came out as zero, the lower end of the searched range",
            )
    gain, half_width = check.flight_gain, check.flight_half_width
    if not len(gain):
        return
    # Battery, load and air change the effectiveness about all axes alike.
    common = _flights(*of_all_axes(gain, half_width))
    for number, axis in enumerate(AXES):
        differing = _flights(gain[:, number], half_width[:, number]) or common
        if differing is not None:
            yield finding("QL529", "warning", differing, axes=(axis,))


def _flights(gain: np.ndarray, half_width: np.ndarray) -> dict[str, object] | None:
    """Return the evidence that two flights have not the same effectiveness, None where they may have."""
    if not np.isfinite(gain).any():
        return None
    found = random_effect(gain, half_width)
    if found.p_value > _FLIGHTS_SEEN or float(np.nanmax(gain) - np.nanmin(gain)) <= _FLIGHTS_DIFFER:
        return None
    return {
        "flights": found.n,
        "chi_square": rounded(found.chi_square, 3),
        "p_value": rounded(found.p_value, 2),
        "sd_between_flights": rounded(found.sd, 2),
        "effectiveness_over_that_of_all": [rounded(float(each), 3) for each in gain],
        "ci95_half_width": [rounded(float(each), 2) for each in half_width],
    }
