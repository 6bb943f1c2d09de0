"""``closed_loop`` of result.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from quadid_logs.control.command_units import in_degrees
from quadid_logs.control.filters import filter_costs, rate_crossover
from quadid_logs.data.closed_loop import AxisLoop, ClosedLoop, Estimated, Margins
from quadid_logs.data.controller import CommandUnit, Replay
from quadid_logs.data.health import Line
from quadid_logs.report.outer_view import outer_dict

#: Of `Margins`, each with its interval.
MARGIN_FIGURES: Final = (
    "crossover_hz",
    "phase_margin_deg",
    "gain_margin_db",
    "gain_margin_down_db",
    "oscillation_hz",
    "delay_margin_s",
    "disk_margin",
    "peak_sensitivity",
)


def closed_loop_dict(loop: ClosedLoop, lines: Mapping[str, Sequence[Line]]) -> dict[str, Any]:
    """Return ``closed_loop``: what is known of the controllers, and of the loop of each axis.

    Parameters
    ----------
    lines : mapping of str to sequence of Line
        Of the gyro's spectrum, by axis.

    Returns
    -------
    dict
        Values not yet `plain`.
    """
    controllers = loop.controllers
    return {
        "controller": controllers.name,
        "firmware": controllers.firmware,
        "version_read": controllers.version_read,
        "version_note": controllers.version_note,
        "remarks": [
            {"kind": remark.kind.value, "axis": remark.axis, "values": remark.values}
            for remark in controllers.remarks
        ],
        "axes": {
            axis: {
                "gains": controllers.axes[axis].gains,
                "control_gain": _control_gain(found.effectiveness, controllers.command_unit),
                "replay": None if found.replay is None else _replay(found.replay),
                "prediction": None
                if found.prediction is None
                else {
                    "rate_fit_percent": found.prediction.rate_fit_percent,
                    "torque_fit_percent": found.prediction.torque_fit_percent,
                    "attainable_percent": found.prediction.attainable_percent,
                    "held_out_s": found.prediction.held_out_s,
                    "effectiveness": _estimated(found.prediction.effectiveness),
                    "at_limits": found.prediction.at_limits,
                },
                **margins_and_step(found),
                "known_to_hz": found.known_hz,
                "contradicted": found.contradicted,
                "frame": None
                if found.frame is None
                else {
                    "seen": found.frame.seen,
                    "line_hz": found.frame.line_hz,
                    "line_height": found.frame.line_height,
                    "absent_probability": found.frame.absent,
                    "visible_hz": found.frame.visible_hz,
                },
                "filters": _filters(loop, axis, lines.get(axis, ())),
            }
            for axis, found in loop.axes.items()
        },
        "outer": outer_dict(loop.outer, margins_dict),
    }


def _filters(loop: ClosedLoop, axis: str, lines: Sequence[Line]) -> list[dict[str, Any]]:
    """Return ``filters``: the phase that each costs at the crossover, and its gain at each line."""
    return [
        {
            "name": cost.name or None,
            "place": cost.place.value,
            "centre_hz": cost.centre_hz or None,
            "phase_cost_deg": _estimated(cost.phase_deg),
            "at_lines": [
                {"frequency_hz": line.frequency_hz, "source": line.source.value, "gain_db": gain_db}
                for line, gain_db in zip(lines, cost.at_lines_db, strict=True)
            ],
        }
        for cost in filter_costs(loop.controllers.axes[axis], rate_crossover(loop.axes[axis]), lines)
    ]


def _control_gain(found: Estimated | None, unit: CommandUnit | None) -> dict[str, Any] | None:
    """Return what a command turns an axis with, in SI and as the autopilot counts: b0 of an ADRC."""
    if found is None:
        return None
    own = None if unit is None else in_degrees(found, unit)
    return {
        "rad_s2_per_command": _estimated(found),
        "deg_s2_per_own_unit": None if own is None or unit is None else {**own._asdict(), "unit": unit.name},
    }


def margins_and_step(found: AxisLoop) -> dict[str, Any]:
    """Return ``margins`` and ``step`` of an axis, None where nothing may be said.

    Values not yet `plain`.
    """
    margins, step = found.margins, found.step
    return {
        "margins": None
        if margins is None
        else {
            "rate": margins_dict(margins.rate),
            "full": None if margins.full is None else margins_dict(margins.full),
        },
        "step": None
        if step is None
        else {
            "rise_time_s": _estimated(step.rise_time_s),
            "overshoot_percent": _estimated(step.overshoot_percent),
            "settling_time_s": _estimated(step.settling_time_s),
        },
    }


def _replay(replay: Replay) -> dict[str, Any]:
    """Return ``replay``: of each term how far it is from the logged one."""
    terms = dict(replay.relative_rms)
    return {
        "relative_rms": terms.pop("output", None),
        "agrees": replay.agrees,
        "reason": None if replay.reason is None else replay.reason.value,
        "parameter": replay.parameter,
        "numbers": replay.numbers,
        "n_rows": replay.n_rows,
        "terms": terms,
        "as_logged": list(replay.as_logged),
    }


def margins_dict(margins: Margins) -> dict[str, Any]:
    """Return the margins of one loop.

    Values not yet `plain`.
    """
    return {
        "stable": margins.stable,
        "stable_fraction": margins.stable_fraction,
        "extrapolated": margins.extrapolated,
        **{name: _estimated(getattr(margins, name)) for name in MARGIN_FIGURES},
    }


def _estimated(figure: Estimated | None) -> dict[str, Any] | None:
    """Return a figure with its interval."""
    return None if figure is None else {"value": figure.value, "ci95": figure.ci95}
