"""What a program that asks gets to know: the verdict first, every refusal with its code and what to do."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, Final

from quadid_logs.errors import QuadidError, SettingsError
from quadid_logs.untrusted import printable

#: Rows of an answer of a store; more are counted and left out.
_MOST_ROWS: Final = 200
_LONGEST_NAME: Final = 400

Answer = dict[str, Any]


class Folders:
    """The folders that may be read.

    Raises
    ------
    SettingsError
        If there is none, or one is no folder.
    """

    def __init__(self, allowed: Sequence[Path]) -> None:
        if not allowed:
            raise SettingsError(
                "No folder may be read.", hint="Start the server with --allow FOLDER, once for each folder."
            )
        for folder in allowed:
            if not folder.is_dir():
                raise SettingsError(
                    f"{printable(folder, _LONGEST_NAME)} is not a folder.", hint="Give a folder."
                )
        self._allowed = tuple(folder.resolve(strict=True) for folder in allowed)

    def path_of(self, asked: str) -> Path:
        """Return a path, links resolved, that lies in one of the folders; relative to the first of them.

        Raises
        ------
        SettingsError
            If there is nothing, or it lies elsewhere: both are told alike.
        """
        try:
            found = (self._allowed[0] / asked).resolve(strict=True)
        except (OSError, ValueError, RuntimeError):
            found = None
        if found is None or not any(found.is_relative_to(one) for one in self._allowed):
            folders = ", ".join(printable(one, _LONGEST_NAME) for one in self._allowed)
            raise SettingsError(
                f"{printable(asked, _LONGEST_NAME)} is not in a folder that may be read.",
                hint=f"These are {folders}.",
            )
        return found


def told(answer: Callable[[], Answer]) -> Answer:
    """Return an answer; a failure of ours becomes one that says what to do."""
    try:
        return answer()
    except QuadidError as error:
        said = str(error)
        return {
            "verdict": "error",
            "exit_code": 2,
            "error": type(error).__name__,
            "message": said.removesuffix(error.hint).strip(),
            "what_to_do": error.hint,
        }
    except OSError as error:
        return {
            "verdict": "error",
            "exit_code": 2,
            "error": "OSError",
            "message": error.strerror or "The file could not be read.",
            "what_to_do": "Check that the file is there and can be read.",
        }


def info(log: Path) -> Answer:
    """Return what is in a log, as ``quadid-log info --json``, and what it shows without a model."""
    from quadid_logs.align import cut
    from quadid_logs.data.settings import Settings
    from quadid_logs.health import health_of
    from quadid_logs.load import load
    from quadid_logs.report.inventory import inventory_text

    prepared = load(log)
    data = cut(prepared, Settings().align)
    return {"exit_code": 0, **json.loads(inventory_text(prepared.log, data, health_of(prepared, data)))}


def analyze(log: Path, vehicle: Path | None = None) -> Answer:
    """Return verdict, findings, the recommended model with its intervals, and margins of each axis."""
    from quadid_logs.pipeline import analyze as analyzed
    from quadid_logs.report.json import result_dict
    from quadid_logs.vehicle_file import read_vehicle

    result = analyzed(log, vehicle=None if vehicle is None else read_vehicle(vehicle))
    content = json.loads(json.dumps(result_dict(result), default=str))
    model = result.identification.recommended
    recommended: Answer = next((one for one in content["models"] if one.get("recommended")), {})
    # Margins and replay of each axis, without curves.
    closed_loop = content["closed_loop"]
    if closed_loop is None:
        loop = None
    else:
        kept = ("margins", "replay", "prediction", "known_hz", "contradicted")
        loop = {
            axis: {name: one[name] for name in kept if name in one}
            for axis, one in closed_loop["axes"].items()
            if one is not None
        }
    return {
        "verdict": {axis: one.verdict for axis, one in result.diagnosis.axes.items()},
        "exit_code": 0 if result.diagnosis.usable else 1,
        "axes": content["axes"],
        "findings": content["findings"],
        "model": None if model is None else {"structure": model.structure, **_model(recommended)},
        "closed_loop": loop,
        "health": content["health"],
        "log": content["log"],
    }


def _model(recommended: Mapping[str, Any]) -> Answer:
    return {
        name: recommended[name] for name in ("actuator", "parameters", "validation") if name in recommended
    }


def compare(before: Path, after: Path) -> Answer:
    """Return whether the vehicle changed, as ``quadid-log compare --json``."""
    from quadid_logs.comparison import EXIT_CODES
    from quadid_logs.comparison import compare as compared
    from quadid_logs.pipeline import analyze as analyzed
    from quadid_logs.report.comparison import comparison_text

    first, second = analyzed(before), analyzed(after)
    comparison = compared(first, second)
    return {
        "verdict": comparison.verdict,
        "exit_code": EXIT_CODES[comparison.verdict],
        **json.loads(comparison_text(first, second, comparison)),
    }


def explain(code: str) -> Answer:
    """Return what a finding means and what to fly or set next."""
    from quadid_logs.data.catalogue import CATALOGUE

    asked = code.strip().upper()
    entry = CATALOGUE.get(asked) or CATALOGUE.get(f"QL{asked}")
    if entry is None:
        raise SettingsError(
            f"There is no finding {printable(code, 40)}.",
            hint="A code is QL and three digits, such as QL303.",
        )
    return {"code": entry.code, "title": entry.title, "meaning": entry.meaning, "what_to_do": entry.advice}


def tune(log: Path) -> Answer:
    """Return the next gains with the margins that they promise, or why there are none; no file is written."""
    from quadid_logs.pipeline import analyze as analyzed
    from quadid_logs.report.provenance import provenance_of
    from quadid_logs.report.tuning_json import tuning_text
    from quadid_logs.tuning import tuning_of

    result = analyzed(log)
    tuning = tuning_of(result)
    content = json.loads(tuning_text(result, tuning, provenance_of(log), ()))
    verdict = {axis: found.verdict for axis, found in tuning.axes.items()}
    return {"verdict": verdict, "exit_code": 1 if tuning.refused else 0, **content}


def plan(autopilot: str, axes: Sequence[str]) -> Answer:
    """Return what to set and fly, and the intervals that a simulated flight of it gives."""
    from quadid_logs.planning import make_plan, predict
    from quadid_logs.report.plan import plan_text

    planned = make_plan(autopilot.lower(), tuple(axes), None)
    return {"exit_code": 0, **json.loads(plan_text(planned, predict(planned, None)))}


def query(store: Path, sql: str) -> Answer:
    """Return the rows of an SQL statement over the store of a fleet, whose table is ``fleet``."""
    from quadid_logs.fleets.sql import ask

    answer = ask(store, sql)
    rows = [list(row) for row in islice(answer.rows, _MOST_ROWS + 1)]
    return {
        "exit_code": 0,
        "columns": list(answer.columns),
        "rows": json.loads(json.dumps(rows[:_MOST_ROWS], default=str)),
        "more": len(rows) > _MOST_ROWS,
        "set_aside": len(answer.set_aside),
    }
