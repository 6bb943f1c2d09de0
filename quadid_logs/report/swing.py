"""A measured moment of inertia in words and as JSON."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any

import numpy as np

from quadid_logs.bifilar import Bifilar, Swing
from quadid_logs.counting import counted
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.report.numbers import estimate, number, plus_minus
from quadid_logs.report.strict_json import fields_of, strict_text
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES

_SYMBOLS = ("Ixx", "Iyy", "Izz")


def swing_lines(path: str, found: Swing, vehicle: Vehicle | None = None) -> tuple[str, ...]:
    """Return a measurement as lines for people, the last one for the vehicle file.

    Parameters
    ----------
    vehicle : Vehicle, optional
        For the moments about the other axes.

    Returns
    -------
    tuple of str
        Lines without control characters, whatever the log holds.
    """
    symbol = _SYMBOLS[AXES.index(found.axis)]
    moment = estimate(found.moment_kg_m2, *found.ci95)
    lines = [f"{printable(PurePath(path).name, 80)}: {found.axis} {symbol} = {moment} kg m²"]
    for run in found.runs:
        period = plus_minus(run.period_s, run.period_half_width_s)
        lines.append(
            f"  {run.start_s:.1f} to {run.end_s:.1f} s: period {period} s, amplitude at the start "
            f"{run.amplitude_deg:.1f} deg; damping {number(run.linear_1_s, 2)} 1/s plus "
            f"{number(run.quadratic, 2)} 1/rad times the rate"
        )
    lines.append(
        f"  {counted(len(found.runs), 'swing')} of {printable(found.source, 80)} at {found.rate_hz:.0f} Hz. "
        "Mass and strings decide most of the interval"
    )
    if found.air_kg_m2:
        lines.append(
            f"  air that swings along: at most {number(found.air_kg_m2, 2)} kg m², which the lower end of "
            "the interval includes"
        )
    moments = np.full(3, np.nan)
    if vehicle is not None and vehicle.inertia_kg_m2 is not None:
        moments = np.diagonal(vehicle.inertia_kg_m2).copy()
    moments[AXES.index(found.axis)] = found.moment_kg_m2
    vehicle_moments = f"[{', '.join(f'{each:.4g}' for each in moments)}]"
    return (*lines, f"  vehicle file: inertia_kg_m2 = {vehicle_moments}")


def swing_text(path: str, hung: Bifilar, found: Swing) -> str:
    """Return a measurement as strict JSON in ASCII."""
    content: dict[str, Any] = {
        "schema_version": "1.0",
        "log": path,
        "axis": found.axis,
        "inertia_kg_m2": {"value": found.moment_kg_m2, "ci95": found.ci95},
        "air_kg_m2": found.air_kg_m2,
        "source": found.source,
        "rate_hz": found.rate_hz,
        "hung": fields_of(hung),
        "swings": [fields_of(run) for run in found.runs],
    }
    return strict_text(content)
