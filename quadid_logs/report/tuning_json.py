"""``tune --json``: what is recommended, for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from quadid_logs.control.room import has_way_back, missed
from quadid_logs.data.autotune import AutotuneForecast, ProcedureKind
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import Tuning
from quadid_logs.report.json import log_dict
from quadid_logs.report.loop_json import loops_dict
from quadid_logs.report.off_nominal import off_nominal_dict
from quadid_logs.report.provenance import Provenance
from quadid_logs.report.strict_json import fields_of, some_fields, strict_text
from quadid_logs.untrusted import printable

#: Minor steps add keys, a major step changes or removes one.
SCHEMA_VERSION = "1.4"


def tuning_text(
    result: Result,
    tuning: Tuning,
    provenance: Provenance,
    files: Sequence[str],
    forecasts: Mapping[str, tuple[AutotuneForecast, ...]] | None = None,
    folder: str = "",
) -> str:
    """Return what is recommended as strict JSON in ASCII.

    Parameters
    ----------
    files : sequence of str
        That were written.
    forecasts : mapping of str to tuple of AutotuneForecast, optional
        By axis, where the autopilot's own procedure would end.
    folder : str
        Name of the folder that holds them, "" for none of its own.
    """
    content: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "tool": {"name": "quadid-logs", **fields_of(provenance)},
        "log": log_dict(result.log, result.data),
        "earlier": [
            {
                "log": printable(PurePath(one.path).name),
                "axes": list(one.axes),
                "differ": list(one.differ),
            }
            for one in result.earlier
        ],
        "limits": tuning.limits._asdict(),
        "ranges": {name: list(ends) for name, ends in tuning.ranges._asdict().items()},
        "axes": {
            axis: {
                "verdict": found.verdict,
                "direction": found.direction,
                "limits_missed": None if found.next is None else missed(found.next, tuning.limits),
                "way_back": has_way_back(found, tuning.limits) if found.changes else None,
                "more_flights": found.more_flights,
                "flights_to_limits": found.flights_to_limits,
                "reasons": [one.code for one in found.reasons],
                "findings": found.reasons,
                "gains": {name: change._asdict() for name, change in found.gains.items()},
                "filters": {name: change._asdict() for name, change in found.filters.items()},
                "now": loops_dict(found.now),
                "next": loops_dict(found.next),
                "off_nominal": off_nominal_dict(found),
                "attitude_error_ratio": found.attitude_error,
                "torque_noise": {"now": found.torque_noise, "next": found.torque_noise_next},
            }
            # Where the autopilot's own procedures would end, None where that is not known.
            | dict.fromkeys(kind.value for kind in ProcedureKind)
            | {
                one.kind.value: {
                    "procedure": one.title,
                    "gains": {name: list(ends) for name, ends in one.gains.items()},
                    **some_fields(one, "gain_margin_db", "phase_margin_deg"),
                    **some_fields(one, "unstable_fraction", "ended_fraction"),
                }
                for one in (forecasts or {}).get(axis, ())
            }
            for axis, found in tuning.axes.items()
        },
        "folder": folder,
        "files": list(files),
    }
    return strict_text(content)
