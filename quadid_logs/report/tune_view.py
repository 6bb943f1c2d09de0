"""What a pilot reads of a recommendation: what changes, what it promises, what to do if it is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Final

import numpy as np

from quadid_logs.autopilots import named
from quadid_logs.control.room import has_way_back, missed, whole
from quadid_logs.counting import counted
from quadid_logs.data.autotune import AutotuneForecast
from quadid_logs.data.catalogue import MOST_NOISE
from quadid_logs.data.closed_loop import Estimated, Margins
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.off_nominal import OFF_NOMINAL
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD, AxisTuning, Direction, Limits, Tuning
from quadid_logs.diagnose.advice import is_to_set, to_a_usable_axis
from quadid_logs.diagnose.advice import next_steps as ordered_steps
from quadid_logs.report.cells import Cell, Table, estimated_cell
from quadid_logs.report.commands import filled, on_next_log
from quadid_logs.report.gain_files import exact, file_names
from quadid_logs.report.numbers import estimate, number, percent, resolved
from quadid_logs.report.off_nominal import condition_words, off_nominal_note, off_nominal_tables
from quadid_logs.report.words import evidence_phrase
from quadid_logs.sentences import listed
from quadid_logs.untrusted import printable

_WORDS: Final = {"change": "change", "keep": "keep", "refused": "no advice"}
#: Of the style of verdicts in every page.
_STYLES: Final = {"change": "caution", "keep": "usable", "refused": "refused"}


@dataclass(frozen=True, slots=True, kw_only=True)
class GainView:
    """A parameter: now to four digits, next as in the file, where it leads to ("" where that is the same)."""

    name: str
    now: str
    next: str
    target: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReasonView:
    """A reason with what it means, what to do, and its evidence."""

    code: str
    title: str
    advice: str
    evidence: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneAxisView:
    """One axis in the order in which a pilot asks.

    ``direction`` and ``way_back`` (whether the flown gains are one) are what all its sentences say.
    """

    axis: str
    verdict: str
    style: str
    direction: Direction
    way_back: bool
    sentence: str
    gains: tuple[GainView, ...]
    promise: str
    effect: str
    warning: str
    reasons: tuple[ReasonView, ...]
    filter_note: str = ""
    autotune: str = ""
    off_nominal: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneView:
    """The whole page."""

    name: str
    subtitle: str
    headline: str
    style: str
    axes: tuple[TuneAxisView, ...]
    steps: tuple[str, ...]
    margins: Table | None
    limits: str
    off_nominal: tuple[Table, ...] = ()
    off_nominal_note: str = ""


def tune_view(
    result: Result, tuning: Tuning, forecasts: Mapping[str, tuple[AutotuneForecast, ...]] | None = None
) -> TuneView:
    """Put a recommendation into words.

    Parameters
    ----------
    forecasts : mapping of str to tuple of AutotuneForecast, optional
        By axis, where the autopilot's own procedure would end.
    """
    verdicts = [found.verdict for found in tuning.axes.values()]
    style = "refused" if set(verdicts) == {"refused"} else "caution" if tuning.changes else "usable"
    back = way_back(result.log.autopilot, tuning)
    firmware = printable(result.log.firmware or named(result.log.autopilot).title, 80)
    steps = []
    changing = [axis for axis, found in tuning.axes.items() if found.verdict == "change"]
    if changing:
        forth, _ = file_names(result.log.autopilot)
        steps.append(f"{named(result.log.autopilot).advice.gain_loading.format(forth)}.")
        steps.append(
            "Take off in calm air and hover at 3 m for 20 s with small stick inputs. Land at once if the "
            "vehicle shakes or the motors buzz."
        )
        steps.append(way_back(result.log.autopilot, tuning).sentence)
        steps.append(
            "If all was well, fly the confirming flight: plan.md in the same folder says what to set and do."
        )
        steps.append(
            f"Take the log of that flight and run `{tune_again(result, tuning)}`. Repeat until it says keep."
        )
    steps += _steps_to_advice(result, tuning)
    rows = []
    for axis, found in tuning.axes.items():
        for when, margins in (("now", found.now), ("next", found.next)):
            if margins is None or (when == "next" and found.verdict != "change"):
                continue
            rows.append(_row(f"{axis}, {when}", "rate loop", margins.rate))
            if margins.full is not None:
                rows.append(_row(f"{axis}, {when}", "with angle loop", margins.full))
    table = None
    if rows:
        table = Table(
            caption="Margins, as flown and as promised",
            head=("loop", "gain [dB]", "phase [deg]", "disk", "crossover [Hz]", "would oscillate at [Hz]"),
            rows=tuple(rows),
            note="Small: the 95 % interval. The promise is computed from the values in the file.",
        )
    return TuneView(
        name=printable(PurePath(result.log.path).name),
        subtitle=firmware,
        headline=headline(tuning),
        style=style,
        axes=tuple(
            _axis(result, axis, found, tuning.limits, back, (forecasts or {}).get(axis, ()))
            for axis, found in tuning.axes.items()
        ),
        steps=tuple(filled(step, result) for step in steps),
        margins=table,
        limits=(
            f"Limits: {number(tuning.limits.gain_db, 3)} dB, {number(tuning.limits.phase_deg, 3)} degrees "
            f"and a disk margin of {number(tuning.limits.disk, 3)}, each met with 97.5 % confidence."
        ),
        off_nominal=tuple(off_nominal_tables(tuning)),
        off_nominal_note=off_nominal_note(tuning),
    )


def headline(tuning: Tuning) -> str:
    """Say in one line what to do with each axis."""
    groups: dict[str, list[str]] = {}
    for axis, found in tuning.axes.items():
        groups.setdefault(_act(found), []).append(axis)
    text = "; ".join(f"{listed(axes)}: {act}" for act, axes in groups.items())
    return f"{text[:1].upper()}{text[1:]}"


def _act(found: AxisTuning) -> str:
    match found.direction:
        case "refuse":
            return "no advice"
        case "keep":
            return "keep the gains"
        case "raise" | "lower" as way:
            if found.reasons[0].code == "QL641":
                return f"{way} {counted(len(found.changes), 'gain')}"
            # By what the common gain changes.
            change = next(one for one in found.changed_gains.values() if one.now)
            ratio = change.next / change.now
            return f"{way} the gains to {number(100.0 * ratio, 2 if ratio < 1.0 else 3)} %"
        case "reshape":
            gains = counted(len(found.changed_gains), "gain")
            if found.filters:
                return f"change {counted(len(found.filters), 'setting')} of the filters and {gains}"
            return f"change {gains}"


@dataclass(frozen=True, slots=True, kw_only=True)
class WayBack:
    """The axes that the flown gains are a way back for, and those that they are none for."""

    file: str
    axes: tuple[str, ...]
    no_axes: tuple[str, ...]

    def loaded(self, axis: str) -> str:
        """Say how to go back with an axis, and with no other that must not."""
        alone = f"the gains of {axis} alone, as in {self.file}"
        return f"set back {alone}" if self.no_axes else f"load {self.file}"

    @property
    def sentence(self) -> str:
        """Say what to do with the file if anything is wrong."""
        if not self.no_axes:
            return f"If anything was wrong, load {self.file}."
        refrain = f"do not load the flown gains of {listed(self.no_axes)}: they have less margin"
        if not self.axes:
            return f"If anything was wrong, {refrain}."
        alone = f"set back the gains of {listed(self.axes)} alone, as in {self.file}"
        return f"If anything was wrong, {alone}; {refrain}."


def way_back(autopilot: str, tuning: Tuning) -> WayBack:
    """Return which axes the flown gains are a way back for.

    Parameters
    ----------
    autopilot : str
        As in `FlightLog.autopilot`.
    """
    changing = {axis: found for axis, found in tuning.axes.items() if found.verdict == "change"}
    safe = {axis: has_way_back(found, tuning.limits) for axis, found in changing.items()}
    return WayBack(
        file=file_names(autopilot)[1],
        axes=tuple(axis for axis, back in safe.items() if back),
        no_axes=tuple(axis for axis, back in safe.items() if not back),
    )


def _axis(
    result: Result,
    axis: str,
    found: AxisTuning,
    limits: Limits,
    back: WayBack,
    forecasts: tuple[AutotuneForecast, ...],
) -> TuneAxisView:
    # Say why: the decisive reason or every one of a refusal, and whether the next gains are there yet.
    decisive = found.reasons if found.verdict == "refused" else found.reasons[:1]
    told = " ".join(f"{one.title}." for one in decisive)
    # What it costs or brings: gusts, and noise on the motors.
    effect = warning = ""
    if found.verdict == "change":
        words = []
        if np.isfinite(found.attitude_error):
            more = 100.0 * (found.attitude_error - 1.0)
            move = "turn" if axis == "yaw" else "tilt"
            words.append(
                f"gusts will {move} the vehicle {number(abs(more), 2)} % {'more' if more > 0.0 else 'less'}"
            )
        if np.isfinite(found.torque_noise_next):
            words.append(
                f"gyro noise on the command changes from {number(100.0 * found.torque_noise, 2)} % to "
                f"{number(100.0 * found.torque_noise_next, 2)} % of its range ({percent(MOST_NOISE)} is "
                "accepted)"
            )
        text = "; ".join(words)
        effect = f"{text[:1].upper()}{text[1:]}." if text else ""
    # What to look and listen for, and then whether the flown gains are a way back.
    if found.verdict == "change" and found.now is not None and found.next is not None:
        at = whole(found.next).oscillation_hz
        # A frequency as a range that a pilot can tell.
        near = "" if at is None else f" (near {_range(at.ci95)} Hz)"
        sign = f"Watch {axis} and listen to the motors. Land if {axis} shakes or the motors buzz{near}."
        if axis in back.axes:
            warning = f"{sign} After that, {back.loaded(axis)}."
        else:
            flown = _margin_words(whole(found.now), lambda one: resolved(one.value, *one.ci95))
            warning = (
                f"{sign} Do not load the flown gains of {axis} after that: they have less margin ({flown}). "
                "Tune from the log of that flight."
            )
    return TuneAxisView(
        axis=axis,
        verdict=_WORDS[found.verdict],
        style=_STYLES[found.verdict],
        direction=found.direction,
        way_back=axis in back.axes,
        sentence=f"{told} {_progress(found, limits)}".strip() if found.verdict == "change" else told,
        gains=tuple(
            GainView(
                name=name,
                now=number(one.now) if np.isfinite(one.now) else "–",
                next=exact(one.next),
                target="" if one.target == one.next else exact(one.target),
            )
            for name, one in found.changes.items()
        ),
        promise=_promise(found),
        effect=effect,
        warning=warning,
        reasons=tuple(_reason(result, one) for one in found.reasons),
        filter_note=next((f"{one.title}." for one in found.reasons if one.code == "QL636"), ""),
        autotune=" ".join(autotune_words(one) for one in forecasts),
        off_nominal=_worst_case(found),
    )


def _progress(found: AxisTuning, limits: Limits) -> str:
    """Say whether the promised margins are those to be kept, and how many flights are still to come."""
    units = {"gain_db": "{} dB", "phase_deg": "{} degrees", "disk": "a disk margin of {}"}
    fields = limits._fields if found.next is None else missed(found.next, limits)
    short = listed([units[name].format(number(getattr(limits, name), 3)) for name in fields])
    if found.by_rule:
        return "No margin is promised. Hover low for a short time, and run tune on that log."
    if not short:
        return (
            f"This is one step of several: expect {_more(found.more_flights)}." if found.more_flights else ""
        )
    if any(one.code == "QL638" for one in found.reasons):
        after = f", even after {_more(found.more_flights)}" if found.more_flights else ""
        return f"The gains come closer to {short}, but do not reach it{after}."
    if found.flights_to_limits:
        return f"Not there yet for {short}: expect {_more(found.flights_to_limits)}."
    return f"The next gains miss {short} by less than a flight can measure."


def _more(n_flights: int) -> str:
    return f"about {counted(n_flights, 'more flight')}"


def autotune_words(forecast: AutotuneForecast) -> str:
    """Say where the autopilot's own procedure would end."""
    gains = ", ".join(f"{name} {_range(ends)}" for name, ends in forecast.gains.items())
    figures = [
        f"{_range(ends)} {unit}"
        for ends, unit in ((forecast.gain_margin_db, "dB"), (forecast.phase_margin_deg, "degrees"))
        if ends is not None
    ]
    promised = f" with {' and '.join(figures)}" if figures else ""
    text = f"{forecast.title} would end at {gains}{promised}."
    if forecast.ended_fraction < 1.0:
        text += (
            f" In {percent(1.0 - forecast.ended_fraction)} of the plant samples it would end without gains."
        )
    if forecast.unstable_fraction > 0.0:
        text += f" In {percent(forecast.unstable_fraction)} of them the loop would be unstable."
    return text


def _range(ends: tuple[float, float]) -> str:
    low, high = (number(end, 2) for end in ends)
    return low if low == high else f"{low} to {high}"


def _promise(found: AxisTuning) -> str:
    """Say what margins the next flight will have, and what this one had."""
    if found.now is None:
        return ""
    now = _margin_words(whole(found.now), _with_interval)
    if found.verdict != "change" or found.next is None:
        return f"Margins as flown: {now}."
    flown = _margin_words(whole(found.now), lambda one: resolved(one.value, *one.ci95))
    return f"Promised margins: {_margin_words(whole(found.next), _with_interval)}; as flown {flown}."


def _worst_case(found: AxisTuning) -> str:
    """Say in which condition the axis keeps least, and which margins it has there."""
    worst = next((one for one in found.off_nominal if one.worst), None)
    if worst is None:
        return ""
    told = f"Off-nominal worst case ({condition_words(worst.condition)})"
    if found.verdict != "change" or worst.next is None:
        return f"{told}: {_margin_words(whole(worst.now), _with_interval)}."
    flown = _margin_words(whole(worst.now), lambda one: resolved(one.value, *one.ci95))
    return f"{told}: {_margin_words(whole(worst.next), _with_interval)}; with the flown gains {flown}."


def _margin_words(margins: Margins, told: Callable[[Estimated], str]) -> str:
    if not margins.stable:
        return "unstable"
    gain, phase = margins.gain_margin_db, margins.phase_margin_deg
    words = []
    if gain is not None:
        words.append(f"{told(gain)} dB")
    if phase is not None:
        words.append(f"{told(phase)} degrees")
    return " and ".join(words) or "nowhere near instability"


def _with_interval(figure: Estimated) -> str:
    return estimate(figure.value, *figure.ci95)


def _reason(result: Result, one: Finding) -> ReasonView:
    told = [evidence_phrase(name, value) for name, value in one.evidence.items() if value != ""]
    advice = filled(one.advice, result)
    return ReasonView(code=one.code, title=one.title, advice=advice, evidence=printable("; ".join(told)))


def tune_again(result: Result, tuning: Tuning) -> str:
    """Return the command that tunes the log of the next flight with the same limits."""
    limits = tuning.limits
    wanted = (
        ("--gain-margin-db", limits.gain_db, GOOD.gain_db),
        ("--phase-margin-deg", limits.phase_deg, GOOD.phase_deg),
    )
    words = [(name, f"{value:g}") for name, value, default in wanted if value != default]
    words += [
        (f"--{name}-range", " ".join(f"{end:g}" for end in ends))
        for name, ends in tuning.ranges._asdict().items()
        if ends != getattr(OFF_NOMINAL, name)
    ]
    filters = ["--filters"] if any(found.filters for found in tuning.axes.values()) else []
    return on_next_log(result, "tune", *filters, *(word for pair in words for word in pair))


def _steps_to_advice(result: Result, tuning: Tuning) -> Iterator[str]:
    """Yield what gives advice on the axes without, each step once: what to set, what to fly, and the rest."""
    reasons = [(axis, one) for axis in tuning.refused for one in tuning.axes[axis].reasons]
    not_usable = [axis for axis, one in reasons if one.code == "QL615"]
    decided = {axis: to_a_usable_axis(result.diagnosis, axis) for axis in not_usable}
    mine = [one for one in result.diagnosis.findings if any(one in some for some in decided.values())]
    # Who logs in another way flies again.
    again = [axis for axis, one in reasons if is_to_set(one)]
    again += [axis for axis, some in decided.items() if any(is_to_set(one) for one in some)]
    of_model = ordered_steps(((result.log, one) for one in mine), ((result.log, axis) for axis in again))
    own: dict[str, list[str]] = {}
    said = {"", *of_model}
    advice, version = named(result.log.autopilot).advice, result.log.version
    if advice.logging_needs_update(version) and any(is_to_set(one) for one in mine):
        said.add(advice.controller_note(version))
    for axis, one in reasons:
        if one.code != "QL615" and one.advice not in said:
            own.setdefault(one.advice, []).append(axis)
    to_set = {one.advice for _, one in reasons if is_to_set(one)}
    yield from (step for step in own if step in to_set)
    yield from of_model
    for step, axes in own.items():
        if step not in to_set:
            yield step if len(axes) == len(tuning.axes) else f"{listed(axes).capitalize()}: {step}"


def _row(name: str, loop: str, margins: Margins) -> tuple[Cell, ...]:
    extrapolated = ", extrapolated" if margins.extrapolated else ""
    head = Cell(text=name, detail=loop + extrapolated)
    if not margins.stable:
        return (head, Cell(text="unstable"), *[Cell(text="–")] * 4)
    figures = (
        margins.gain_margin_db,
        margins.phase_margin_deg,
        margins.disk_margin,
        margins.crossover_hz,
        margins.oscillation_hz,
    )
    return (head, *(estimated_cell(one) for one in figures))
