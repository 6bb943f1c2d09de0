"""What a pilot reads of a recommendation: what changes, what it promises, what to do if it is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Final

import numpy as np

from quadid_logs.autopilots import named
from quadid_logs.control.recommend import MOST_DOWN, MOST_NOISE, MOST_UP
from quadid_logs.data.autotune import AutotuneForecast
from quadid_logs.data.closed_loop import Estimated, LoopMargins, Margins
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import AxisTuning, Limits, Tuning
from quadid_logs.report.cells import Cell, Table
from quadid_logs.report.gain_files import exact, file_names
from quadid_logs.report.numbers import estimate, interval, number, percent, resolved
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
    """One axis in the order in which a pilot asks."""

    axis: str
    verdict: str
    style: str
    sentence: str
    gains: tuple[GainView, ...]
    promise: str
    effect: str
    warning: str
    reasons: tuple[ReasonView, ...]
    filter_note: str = ""
    autotune: str = ""


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


def tune_view(
    result: Result, tuning: Tuning, forecasts: Mapping[str, AutotuneForecast] | None = None
) -> TuneView:
    """Put a recommendation into words.

    Parameters
    ----------
    result : Result
    tuning : Tuning
    forecasts : mapping of str to AutotuneForecast, optional
        By axis, where the autopilot's own procedure would end.

    Returns
    -------
    TuneView
    """
    verdicts = [found.verdict for found in tuning.axes.values()]
    style = "refused" if set(verdicts) == {"refused"} else "caution" if tuning.changes else "usable"
    firmware = printable(result.log.firmware or named(result.log.autopilot).title, 80)
    return TuneView(
        name=printable(PurePath(result.log.path).name),
        subtitle=firmware,
        headline=headline(tuning),
        style=style,
        axes=tuple(_axis(axis, found, (forecasts or {}).get(axis)) for axis, found in tuning.axes.items()),
        steps=tuple(_steps(result, tuning)),
        margins=_table(tuning),
        limits=_limits(tuning.limits),
    )


def headline(tuning: Tuning) -> str:
    """Say in one line what to do with each axis.

    Parameters
    ----------
    tuning : Tuning

    Returns
    -------
    str
    """
    groups: dict[str, list[str]] = {}
    for axis, found in tuning.axes.items():
        groups.setdefault(_act(found), []).append(axis)
    text = "; ".join(f"{listed(axes)}: {act}" for act, axes in groups.items())
    return f"{text[:1].upper()}{text[1:]}"


def _act(found: AxisTuning) -> str:
    if found.verdict == "refused":
        return "no advice"
    if found.verdict == "keep":
        return "keep the gains"
    if found.reasons[0].code == "QL641":
        return f"change {len(found.changes)} gains, each by itself"
    ratio = _ratio(found)
    way = "lower" if ratio < 1.0 else "raise"
    return f"{way} the gains to {number(100.0 * ratio, 2 if ratio < 1.0 else 3)} %"


def _ratio(found: AxisTuning) -> float:
    """Return by what the common gain changes."""
    change = next(one for one in found.changes.values() if one.now)
    return change.next / change.now


def _axis(axis: str, found: AxisTuning, forecast: AutotuneForecast | None) -> TuneAxisView:
    return TuneAxisView(
        axis=axis,
        verdict=_WORDS[found.verdict],
        style=_STYLES[found.verdict],
        sentence=_sentence(found),
        gains=tuple(
            GainView(
                name=name,
                now=number(one.now),
                next=exact(one.next),
                target="" if one.target == one.next else exact(one.target),
            )
            for name, one in found.changes.items()
        ),
        promise=_promise(found),
        effect=_effect(axis, found),
        warning=_warning(axis, found),
        reasons=tuple(_reason(one) for one in found.reasons),
        filter_note=next((f"{one.title}." for one in found.reasons if one.code == "QL636"), ""),
        autotune="" if forecast is None else autotune_words(forecast),
    )


def _sentence(found: AxisTuning) -> str:
    """Say the decisive reason, and where it is one step of several that the limits come later."""
    told = f"{found.reasons[0].title}." if found.reasons else ""
    if any(one.next != one.target for one in found.changes.values()):
        most, least = percent(MOST_UP), percent(MOST_DOWN)
        told += f" This is one step of several: a flight takes a gain to {most} or {least} at most."
    return told


def autotune_words(forecast: AutotuneForecast) -> str:
    """Say where the autopilot's own procedure would end.

    Parameters
    ----------
    forecast : AutotuneForecast

    Returns
    -------
    str
    """
    gains = ", ".join(f"{name} {_range(ends)}" for name, ends in forecast.gains.items())
    figures = [
        f"{_range(ends)} {unit}"
        for ends, unit in ((forecast.gain_margin_db, "dB"), (forecast.phase_margin_deg, "degrees"))
        if ends is not None
    ]
    promised = f" with {' and '.join(figures)}" if figures else ""
    text = f"{forecast.title} would end at {gains}{promised}."
    if forecast.ended_fraction < 1.0:
        text += f" In {percent(1.0 - forecast.ended_fraction)} of the vehicles it would end without gains."
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
    now = _margin_words(_outer(found.now), _with_interval)
    if found.verdict != "change" or found.next is None:
        return f"Margins as flown: {now}."
    flown = _margin_words(_outer(found.now), lambda one: resolved(one.value, *one.ci95))
    return f"Promised margins: {_margin_words(_outer(found.next), _with_interval)}; as flown {flown}."


def _outer(margins: LoopMargins) -> Margins:
    return margins.full or margins.rate


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


def _effect(axis: str, found: AxisTuning) -> str:
    """Say what it costs or brings: gusts, and noise on the motors."""
    if found.verdict != "change":
        return ""
    words = []
    if np.isfinite(found.attitude_error):
        more = 100.0 * (found.attitude_error - 1.0)
        move = "turn" if axis == "yaw" else "tilt"
        words.append(f"gusts will {move} it {number(abs(more), 2)} % {'more' if more > 0.0 else 'less'}")
    if np.isfinite(found.torque_noise_next):
        words.append(
            f"gyro noise on the command {number(100.0 * found.torque_noise, 2)} % → "
            f"{number(100.0 * found.torque_noise_next, 2)} % of its range ({percent(MOST_NOISE)} is accepted)"
        )
    text = "; ".join(words)
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _warning(axis: str, found: AxisTuning) -> str:
    """Say by which sign to land, and at what frequency it would show."""
    if found.verdict != "change" or found.next is None:
        return ""
    at = _outer(found.next).oscillation_hz
    near = "" if at is None else f" near {_around(at)} Hz"
    return f"Land if {axis} oscillates{near}, and load the flown gains again."


def _around(at: Estimated) -> str:
    """Return a frequency as a range that a pilot can tell."""
    return _range(at.ci95)


def _reason(one: Finding) -> ReasonView:
    told = [evidence_phrase(name, value) for name, value in one.evidence.items() if value != ""]
    return ReasonView(code=one.code, title=one.title, advice=one.advice, evidence=printable("; ".join(told)))


def _steps(result: Result, tuning: Tuning) -> Iterator[str]:
    """Yield what to do next, in order."""
    changing = [axis for axis, found in tuning.axes.items() if found.verdict == "change"]
    if changing:
        forth, back = file_names(result.log.autopilot)
        load = named(result.log.autopilot).advice.gain_loading.format(forth)
        yield f"{load}, and keep {back} at hand: it restores the flown gains."
        yield (
            "Take off in calm air and hover at 3 m for 20 s with small stick inputs. Land at once if the "
            "vehicle oscillates or sounds different."
        )
        yield "Then fly the confirming flight: plan.md beside this page says what to set and to do."
        yield "Take the log and run quadid-log tune on it, until it says keep."
    for axis in tuning.refused:
        for one in tuning.axes[axis].reasons[:1]:
            yield f"For advice on {axis}: {one.advice}"


def _table(tuning: Tuning) -> Table | None:
    """Return the margins now and next, of both loops."""
    rows = []
    for axis, found in tuning.axes.items():
        for when, margins in (("now", found.now), ("next", found.next)):
            if margins is None or (when == "next" and found.verdict != "change"):
                continue
            rows.append(_row(f"{axis}, {when}", "rate loop", margins.rate))
            if margins.full is not None:
                rows.append(_row(f"{axis}, {when}", "with angle loop", margins.full))
    if not rows:
        return None
    return Table(
        caption="Margins, as flown and as promised",
        head=("loop", "gain [dB]", "phase [deg]", "disk", "crossover [Hz]", "would oscillate at [Hz]"),
        rows=tuple(rows),
        note="Small: the 95 % interval over the vehicles that the flight allows. The promise is "
        "computed from the values in the file.",
    )


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
    return (head, *(_cell(one) for one in figures))


def _cell(figure: Estimated | None) -> Cell:
    if figure is None:
        return Cell(text="–")
    return Cell(text=resolved(figure.value, *figure.ci95), detail=interval(*figure.ci95))


def _limits(limits: Limits) -> str:
    return (
        f"To be kept in 97.5 % of the vehicles that the flight allows: {number(limits.gain_db, 3)} dB, "
        f"{number(limits.phase_deg, 3)} degrees, a disk margin of {number(limits.disk, 3)}."
    )
