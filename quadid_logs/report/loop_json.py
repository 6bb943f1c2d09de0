"""``closed_loop`` of result.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from quadid_logs.control.command_units import in_degrees
from quadid_logs.control.filters import filter_costs, rate_crossover
from quadid_logs.data.closed_loop import AxisLoop, ClosedLoop, Estimated, LoopMargins, Margins
from quadid_logs.data.controller import CommandUnit, Replay
from quadid_logs.data.health import Line
from quadid_logs.data.outer_loops import OuterLoops
from quadid_logs.report.strict_json import some_fields

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
#: Of `Prediction`.
_PREDICTION: Final = (
    *("rate_fit_percent", "torque_fit_percent", "attainable_percent"),
    *("held_out_s", "effectiveness", "at_limits"),
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
        **some_fields(controllers, "firmware", "version_read", "version_note"),
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
                else some_fields(found.prediction, *_PREDICTION),
                **margins_and_step(found),
                "known_to_hz": found.known_hz,
                "contradicted": found.contradicted,
                "frame": None
                if found.frame is None
                else {
                    **some_fields(found.frame, "seen", "line_hz", "line_height"),
                    "absent_probability": found.frame.absent,
                    "visible_hz": found.frame.visible_hz,
                },
                "filters": _filters(loop, axis, lines.get(axis, ())),
            }
            for axis, found in loop.axes.items()
        },
        "outer": _outer(loop.outer),
    }


def _filters(loop: ClosedLoop, axis: str, lines: Sequence[Line]) -> list[dict[str, Any]]:
    """Return ``filters``: the phase that each costs at the crossover, and its gain at each line."""
    return [
        {
            "name": cost.name or None,
            "place": cost.place.value,
            "centre_hz": cost.centre_hz or None,
            "phase_cost_deg": cost.phase_deg,
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
        "rad_s2_per_command": found,
        "deg_s2_per_own_unit": None if own is None or unit is None else {**own._asdict(), "unit": unit.name},
    }


def _outer(outer: OuterLoops | None) -> dict[str, Any] | None:
    """Return ``outer``: the replays of the loops around the rate loop, and their margins."""
    if outer is None:
        return None
    # The parameters of all outer controllers.
    gains = dict(outer.controllers.attitude.gains)
    for each in (outer.controllers.horizontal, outer.controllers.vertical):
        gains |= {} if each is None else each.gains
    return {
        "gains": gains,
        "attitude": {
            axis: {
                "shown": found.shown.value,
                "relative_rms": found.relative_rms,
                "gain_over_parameter": found.gain,
                "n_rows": found.n_rows,
            }
            for axis, found in outer.attitude.items()
        },
        "shaper": {
            axis: some_fields(found, "relative_rms", "unshaped_rms", "n_rows")
            for axis, found in outer.shaper.items()
        },
        "cascades": {
            direction: {
                "shown": found.shown.value,
                "position_gain_over_parameter": found.position,
                "velocity_gain_over_parameter": found.velocity,
                "integral_gain_over_parameter": found.integral,
                "position_relative_rms": found.position_rms,
                "velocity_relative_rms": found.velocity_rms,
                **some_fields(found, "velocity_error_m_s", "velocity_moved_m_s", "position_error_m"),
                **some_fields(found, "n_rows", "row_s"),
            }
            for direction, found in outer.cascades.items()
        },
        "loops": {
            axis: {
                "attitude_hz": found.attitude_hz,
                "velocity": margins_dict(found.velocity),
                "whole": None if found.whole is None else margins_dict(found.whole),
            }
            for axis, found in outer.loops.items()
        },
    }


def margins_and_step(found: AxisLoop) -> dict[str, Any]:
    """Return ``margins`` and ``step`` of an axis, None where nothing may be said.

    Values not yet `plain`.
    """
    margins, step = found.margins, found.step
    return {
        "margins": loops_dict(margins),
        "step": None
        if step is None
        else some_fields(step, "rise_time_s", "overshoot_percent", "settling_time_s"),
    }


def _replay(replay: Replay) -> dict[str, Any]:
    """Return ``replay``: of each term how far it is from the logged one."""
    terms = dict(replay.relative_rms)
    return {
        "relative_rms": terms.pop("output", None),
        "agrees": replay.agrees,
        "reason": None if replay.reason is None else replay.reason.value,
        **some_fields(replay, "parameter", "numbers", "n_rows"),
        "terms": terms,
        "as_logged": list(replay.as_logged),
    }


def loops_dict(margins: LoopMargins | None) -> dict[str, Any] | None:
    """Return the margins of the rate loop, and with the angle loop; None where nothing may be said."""
    if margins is None:
        return None
    full = None if margins.full is None else margins_dict(margins.full)
    return {"rate": margins_dict(margins.rate), "full": full}


def margins_dict(margins: Margins) -> dict[str, Any]:
    """Return the margins of one loop.

    Values not yet `plain`.
    """
    return some_fields(margins, "stable", "stable_fraction", "extrapolated", *MARGIN_FIGURES)
