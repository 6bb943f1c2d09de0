"""What the report says of the loop: a sentence for each axis that a pilot understands, and a table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from quadid_logs.control.command_units import in_degrees
from quadid_logs.control.margins import MOST_UNMODELLED_DEG
from quadid_logs.control.room import outermost
from quadid_logs.data.closed_loop import AxisLoop, ClosedLoop, Estimated, Margins
from quadid_logs.data.result import Result
from quadid_logs.diagnose.advice import advice_for
from quadid_logs.report.cells import Cell, Table, estimated_cell
from quadid_logs.report.filter_table import filter_tables
from quadid_logs.report.numbers import interval, number, resolved
from quadid_logs.report.outer_view import outer_sentences, outer_tables
from quadid_logs.untrusted import printable

#: From here on a gain is told as a multiple: no battery and no load changes a vehicle by as much.
_MANY_TIMES = 2.0
_CONTRADICTED = "the measured response contradicts the model, so no margin is given."


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopView:
    """The chapter's sentences, by axis, and its tables; ``intro`` says which controller closes the loop.

    ``step_note`` says what the computed step response leaves out, "" for nothing.
    """

    intro: str
    sentences: tuple[str, ...]
    margins: Table | None
    filters: tuple[Table, ...] = ()
    outer: tuple[Table, ...] = ()
    step_note: str = ""


def loop_view(result: Result) -> LoopView:
    """Put the loop into words."""
    loop = result.closed_loop
    if loop is None:
        if result.identification.recommended is None:
            why_none = "There is no model to close a loop around."
        elif result.pooled:
            why_none = "Several logs may have been flown with several controllers."
        else:
            why_none = "The controller that flew is not known."
        return LoopView(intro=f"{why_none} The loop is not judged.", sentences=(), margins=None)
    if not loop.axes:
        text = "The log's parameters do not describe the controller, or it has parts that are not modelled."
        return LoopView(intro=f"{text} The loop is not judged.", sentences=(), margins=None)
    controllers = loop.controllers
    intro = (
        f"This chapter closes the loop of the logged gains ({controllers.name}) around the model. It shows "
        "how far the vehicle is from oscillating"
    )
    predictable = any(one.predictable for one in controllers.axes.values())
    intro += ", and whether the set-points alone predict the flight." if predictable else "."
    if controllers.version_read != "read":
        law = printable(controllers.version_note, 40)
        intro += f" The control law of version {law} was used, the nearest known one."
    rows = []
    for axis, found in loop.axes.items():
        if found.margins is not None:
            also = "contradicted" if found.contradicted else ""
            rows.append(_row(f"{axis}, rate loop", found.margins.rate, also))
            if found.margins.full is not None:
                rows.append(_row(f"{axis}, with angle loop", found.margins.full, also))
    table = None
    if rows:
        table = Table(
            caption="Margins of the loop, cut at the mixer",
            head=("loop", "phase [deg]", "gain [dB]", "crossover [Hz]", "delay [ms]", "disk", "peak of S"),
            rows=tuple(rows),
            note=(
                "Small: the 95 % interval. The interval of an extrapolated margin allows for up to "
                f"{number(MOST_UNMODELLED_DEG, 2)} degrees less phase above the measured frequencies."
            ),
        )
    return LoopView(
        intro=intro,
        sentences=(
            *(_sentence(axis, found) for axis, found in loop.axes.items()),
            *outer_sentences(loop.outer),
            *_own_units(loop),
        ),
        margins=table,
        filters=filter_tables(result),
        outer=outer_tables(loop.outer),
        step_note=advice_for(result.log.autopilot).step_note(result.log.parameters),
    )


def _own_units(loop: ClosedLoop) -> Iterator[str]:
    """Say what one of the autopilot's own units of command does, where it counts in other units."""
    unit = loop.controllers.command_unit
    if unit is None:
        return
    told = []
    for axis, found in loop.axes.items():
        if found.effectiveness is not None:
            own = in_degrees(found.effectiveness, unit)
            told.append(f"{axis} with {resolved(own.value, *own.ci95)} ({interval(*own.ci95)}) deg/s²")
    if told:
        yield f"One {unit.name} accelerates {', '.join(told)}: the b0 of an ADRC, before its own scaling."


def _sentence(axis: str, found: AxisLoop) -> str:
    """Say in one breath how far an axis is from instability, and what the prediction is worth."""
    margins, name = outermost(found), axis.capitalize()
    if margins is None:
        reason = None if found.replay is None or found.replay.agrees else found.replay.reason
        # Without rows to replay nothing is known against the controller: then it is the model that lacks.
        if reason is not None and not reason.tells_nothing:
            return f"{name}: the logged parameters do not reproduce the logged output ({reason.value})."
        return f"{name}: the model of this axis is not good enough to close the loop."
    # No distance is told of a loop that the log contradicts.
    parts = [f"{name}: {_CONTRADICTED if found.contradicted else _distance(margins)}"]
    prediction = found.prediction
    if prediction is not None:
        parts.append(
            "From the set-points alone, model and controller predict "
            f"{number(prediction.rate_fit_percent, 3)} % of the rate and "
            f"{number(prediction.torque_fit_percent, 3)} % of the torque on validation data. The best "
            f"linear system could reach {number(prediction.attainable_percent, 3)} % of the torque."
        )
    return " ".join(parts)


def _distance(margins: Margins) -> str:
    """Say how far a loop is from instability."""
    if not margins.stable:
        return (
            "the model with this controller is unstable although the vehicle flew. One of the two is wrong."
        )
    phase, gain, at = margins.phase_margin_deg, margins.gain_margin_db, margins.oscillation_hz
    far = [f"{number(phase.value, 2)} degrees" if phase is not None else ""]
    far.append(f"{number(gain.value, 2)} dB" if gain is not None else "")
    text = f"{' and '.join(filter(None, far)) or 'far'} from instability"
    if gain is not None and at is not None:
        # Say by how much the gain may grow, and what makes it grow by so little.
        factor = 10.0 ** (gain.value / 20.0)
        if factor >= _MANY_TIMES:
            more = f"{number(factor, 2)} times the gain"
        else:
            more = f"a {number(100.0 * (factor - 1.0), 2)} % higher gain (lighter vehicle, fuller battery)"
        text += f"; with {more} it would oscillate at about {number(at.value, 2)} Hz"
    return f"{text}{_at_least(margins) if margins.extrapolated else ''}."


def _at_least(margins: Margins) -> str:
    """Say which of the two margins may be less, for no frequency was measured where they are read off."""
    pairs = ((margins.phase_margin_deg, "degrees"), (margins.gain_margin_db, "dB"))
    told = ((number(each.value, 2), number(max(each.ci95[0], 0.0), 2), unit) for each, unit in pairs if each)
    less = [f"{low} {unit}" for value, low, unit in told if low != value]
    return (
        f" (extrapolated: the margins may be as small as {' and '.join(less)})" if less else " (extrapolated)"
    )


def _row(name: str, margins: Margins, also: str) -> tuple[Cell, ...]:
    if not margins.stable:
        return (Cell(text=name, detail=also), Cell(text="unstable"), *[Cell(text="–")] * 5)
    delay = margins.delay_margin_s
    figures = (
        margins.phase_margin_deg,
        margins.gain_margin_db,
        margins.crossover_hz,
        None if delay is None else Estimated(1e3 * delay.value, (1e3 * delay.ci95[0], 1e3 * delay.ci95[1])),
        margins.disk_margin,
        margins.peak_sensitivity,
    )
    name_cell = Cell(text=name, detail=also or ("extrapolated" if margins.extrapolated else ""))
    return (name_cell, *(estimated_cell(each) for each in figures))
