"""What the report and result.json say of the loops around the rate loop."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from quadid_logs.control.outer_findings import outermost
from quadid_logs.data.outer_loops import OuterLoop, OuterLoops, Shown
from quadid_logs.report.cells import Cell, Table, estimated_cell
from quadid_logs.report.numbers import number

_SHOWN: Final = {
    Shown.AGREES: "reproduces the log",
    Shown.DIFFERS: "does not reproduce the log",
    Shown.NOT_SHOWN: "not shown by the log",
}
_ALONG: Final = {"pitch": "forward", "roll": "sideways"}


def outer_sentences(outer: OuterLoops | None) -> Iterator[str]:
    """Say how far the velocity loops are from instability."""
    if outer is None:
        return
    for axis, found in outer.loops.items():
        margins = outermost(found)
        if not margins.stable:
            distance = "the model with these controllers is unstable."
        else:
            phase, gain, delay = margins.phase_margin_deg, margins.gain_margin_db, margins.delay_margin_s
            far = [f"{number(phase.value, 2)} degrees" if phase is not None else ""]
            far.append(f"{number(gain.value, 2)} dB" if gain is not None else "")
            text = f"{' and '.join(filter(None, far)) or 'far'} from instability"
            distance = (
                text
                if delay is None
                else f"{text}. The loop tolerates a further delay of {number(delay.value, 2)} s."
            )
        yield f"Velocity {_ALONG[axis]}, by {axis}: {distance}"


def outer_tables(outer: OuterLoops | None) -> tuple[Table, ...]:
    """Return the tables of margins and replays.

    Without those that would be empty.
    """
    if outer is None:
        return ()
    rows = [row for axis, found in outer.loops.items() for row in _margin_rows(axis, found)]
    margins = None
    if rows:
        margins = Table(
            caption="Margins of velocity and position loops, cut at the acceleration set-point",
            head=("loop", "phase [deg]", "gain [dB]", "crossover [Hz]", "delay [s]", "attitude [Hz]"),
            rows=tuple(rows),
            note=(
                "Small: the 95 % interval from the model's uncertainty. It leaves out wind, air drag and "
                "the estimator's delay. Compare that delay with the delay that the loop tolerates."
            ),
        )
    cascades = None
    if outer.cascades:
        cascades = Table(
            caption="Position and velocity controllers, replayed",
            head=("direction", "controllers", "position", "velocity P", "velocity I", "velocity error [m/s]"),
            rows=tuple(
                (
                    Cell(text=direction),
                    Cell(text=_SHOWN[one.shown]),
                    estimated_cell(one.position),
                    estimated_cell(one.velocity),
                    estimated_cell(one.integral),
                    Cell(text=number(one.velocity_error_m_s, 2)),
                )
                for direction, one in outer.cascades.items()
            ),
            note=(
                "Gains divided by those of the parameters, with 95 % intervals. Error: rms of target minus "
                "velocity."
            ),
        )
    found = (margins, _attitude_table(outer), cascades)
    return tuple(table for table in found if table is not None)


def _margin_rows(axis: str, found: OuterLoop) -> Iterator[tuple[Cell, ...]]:
    named = (("velocity", found.velocity), ("velocity and position", found.whole))
    for name, margins in named:
        if margins is None:
            continue
        shown = Cell(text=f"{name}, {_ALONG[axis]}")
        if not margins.stable:
            yield (shown, Cell(text="unstable"), *[Cell(text="–")] * 3, estimated_cell(found.attitude_hz))
            continue
        figures = (
            margins.phase_margin_deg,
            margins.gain_margin_db,
            margins.crossover_hz,
            margins.delay_margin_s,
            found.attitude_hz,
        )
        yield (shown, *(estimated_cell(each) for each in figures))


def _attitude_table(outer: OuterLoops) -> Table | None:
    """Return how well attitude controller and input shaper replay."""
    axes = [axis for axis in ("roll", "pitch", "yaw") if axis in outer.attitude or axis in outer.shaper]
    if not axes:
        return None
    rows = []
    for axis in axes:
        attitude, shaper = outer.attitude.get(axis), outer.shaper.get(axis)
        rows.append(
            (
                Cell(text=axis),
                Cell(text="–" if attitude is None else _SHOWN[attitude.shown]),
                Cell(text="–" if attitude is None else _percent(attitude.relative_rms)),
                estimated_cell(None if attitude is None else attitude.gain),
                Cell(text="–" if shaper is None else _percent(shaper.relative_rms)),
                Cell(text="–" if shaper is None else _percent(shaper.unshaped_rms)),
            )
        )
    return Table(
        caption="Attitude controller, replayed",
        head=("axis", "controller", "off by", "gain / parameter", "shaped target off by", "unshaped"),
        rows=tuple(rows),
        note=(
            "Off by: rms of the difference, divided by the rms of the logged signal. The input shaper is "
            "replayed only while position control commands the angle."
        ),
    )


def _percent(value: float) -> str:
    return f"{number(100.0 * value, 2)} %"
