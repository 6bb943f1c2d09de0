"""Predicted body rates in words and as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from quadid_logs.identify.horizons import HorizonPrediction, RatePredictor
from quadid_logs.report.strict_json import strict_text
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES, RATE_SYMBOLS

#: Of the tables' columns.
_HEAD = ("steps", "horizon", "error", "constant rates", "coverage: roll", "pitch", "yaw")


def prediction_lines(path: str, found: Sequence[HorizonPrediction]) -> tuple[str, ...]:
    """Return what was predicted of one flight as lines for people.

    Lines without control characters, whatever the log holds.
    """
    rows = [
        (
            str(each.n_steps),
            f"{each.horizon_s:.3g} s",
            f"{each.error_rad_s:.4f} rad/s",
            f"{each.kept_error_rad_s:.4f} rad/s",
            *(f"{100.0 * share:.1f} %" for share in each.coverage),
        )
        for each in found
    ]
    widths = [max(map(len, column)) for column in zip(_HEAD, *rows, strict=True)]
    table = [
        "  " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        for row in (_HEAD, *rows)
    ]
    return (f"{printable(PurePath(path).name, 80)}: {len(found[0].start_s)} starts", *table)


def predictions_text(ahead: RatePredictor, found: Mapping[str, Sequence[HorizonPrediction]]) -> str:
    """Return the predictor and its scores as strict JSON in ASCII.

    Parameters
    ----------
    found : mapping of str to sequence of HorizonPrediction
        By the log's path.
    """
    content: dict[str, Any] = {
        "schema_version": "1.0",
        "sample_period_s": ahead.sample_period_s,
        "torque_unit": ahead.torque_unit,
        "regressors": list(ahead.groups),
        "horizons": [
            {"n_steps": each.n_steps, "penalties": each.penalties, "unexplained_left_out": each.unexplained}
            for each in ahead.horizons
        ],
        "flights": [
            {"log": path, "horizons": [_scores(each) for each in predictions]}
            for path, predictions in found.items()
        ],
    }
    return strict_text(content)


def _scores(found: HorizonPrediction) -> dict[str, Any]:
    error = found.measured - found.predicted
    return {
        "n_steps": found.n_steps,
        "horizon_s": found.horizon_s,
        "n_starts": len(found.start_s),
        "error_rad_s": found.error_rad_s,
        "constant_rates_error_rad_s": found.kept_error_rad_s,
        "axes": {
            axis: {
                "rate": symbol,
                "rmse_rad_s": float((error[:, number] ** 2).mean() ** 0.5),
                "half_width_rad_s": float(found.half_width[:, number].mean()),
                "coverage": float(found.coverage[number]),
            }
            for number, (axis, symbol) in enumerate(zip(AXES, RATE_SYMBOLS, strict=True))
        },
    }
