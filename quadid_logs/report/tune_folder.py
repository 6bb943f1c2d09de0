"""The folder of one tuning: each log has its own, and what leads back to the flown values stays for ever."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path, PurePath

from quadid_logs.data.result import Result
from quadid_logs.data.tuning import Tuning
from quadid_logs.diagnose.advice import plannable
from quadid_logs.errors import OutputError
from quadid_logs.output import check_folder_free, new_folder, write_together
from quadid_logs.promise import promise_of
from quadid_logs.report.folder import folder_names
from quadid_logs.report.gain_files import file_names, gain_files, tunable_autopilots
from quadid_logs.report.plan import CARD_FILE, plan_file_names
from quadid_logs.report.promise_file import PROMISE_FILE, promise_text
from quadid_logs.report.provenance import Provenance
from quadid_logs.report.tune_card import flight_files
from quadid_logs.report.tune_page import PAGE_FILE, tune_page
from quadid_logs.report.tuning_json import tuning_text
from quadid_logs.tuning import autotune_forecasts, next_loops, what_if_grids
from quadid_logs.untrusted import printable

JSON_FILE = "tune.json"


def tuning_files(
    result: Result,
    tuning: Tuning,
    provenance: Provenance,
    *,
    page: str = PAGE_FILE,
    folder: str = "",
) -> dict[str, str]:
    """Return the text of each file of a tuning by its name: gains, card, promise, page, and JSON at last.

    Parameters
    ----------
    page : str
        Name of the page.
    folder : str
        Name of the folder, for the JSON.
    """
    files = {**gain_files(result, tuning), **flight_files(result, tuning)}
    promised = promise_of(result, tuning, provenance.log_sha256)
    if promised is not None:
        files[PROMISE_FILE] = promise_text(promised, provenance)
    forecasts, grids = autotune_forecasts(result, tuning), what_if_grids(result, tuning)
    files[page] = tune_page(result, tuning, provenance, forecasts, grids, next_loops(result, tuning))
    names = tuple(sorted((*files, JSON_FILE)))
    return files | {JSON_FILE: tuning_text(result, tuning, provenance, names, forecasts, folder)}


def tune_folder(parent: Path, log: PurePath, log_sha256: str, number: int = 0) -> Path:
    """Return the folder of a log's tuning: its own, whatever other logs of the same name were tuned.

    Parameters
    ----------
    log_sha256 : str
        Tells it from others of its name; "" is like none.
    number : int
        Which log of a file with several, from 1; 0 for the only one.

    Returns
    -------
    Path
        The first of `folder_names` in which no other log was tuned.
    """
    folders = (parent / name for name in folder_names(log, number))
    return next(folder for folder in folders if _is_of(folder, log_sha256))


def _is_of(folder: Path, log_sha256: str) -> bool:
    """Return whether nothing was tuned there, or this very log."""
    if not any((folder / name).exists() for name in _possible_files()):
        return True
    try:
        told = json.loads((folder / JSON_FILE).read_bytes())
        return bool(log_sha256) and bool(told["tool"]["log_sha256"] == log_sha256)
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return False


def check_tune_folder(folder: Path, *, force: bool) -> None:
    """Refuse before the work what `write_tuning` would refuse after it.

    Parameters
    ----------
    force : bool
        Whether the files of an earlier run may be replaced, but for those that lead back.

    Raises
    ------
    OutputError
    """
    check_folder_free(folder.parent, (), force=force)
    check_folder_free(folder, _possible_files(), force=force)


def write_tuning(folder: Path, files: Mapping[str, str]) -> tuple[str, ...]:
    """Write the files of a tuning, all of them or none.

    Parameters
    ----------
    folder : Path
        Of `tune_folder`.
    files : mapping of str to str
        Of `tuning_files`.

    Returns
    -------
    tuple of str
        Files of an earlier run that were removed: gains beside a page that does not recommend them.

    Raises
    ------
    OutputError
        If a file that leads back to flown values would be replaced by one with other values.
    """
    contents = {name: text.encode() for name, text in files.items()}
    backs = _back_files()
    there = {name for name in backs if (folder / name).exists()}
    for name in sorted(there & files.keys()):
        if (folder / name).read_bytes() != contents[name]:
            raise OutputError(
                f"{printable(folder / name)} holds the way back to other values, so it is not replaced.",
                hint="Choose another -o.",
            )
    stale = sorted(name for name in _possible_files() - files.keys() - backs if (folder / name).exists())
    with new_folder(folder):
        write_together(folder, {name: contents[name] for name in files.keys() - there})
        for name in stale:
            (folder / name).unlink(missing_ok=True)
    return tuple(stale)


def _possible_files() -> set[str]:
    """Return the names of all files that may be written."""
    names = {PAGE_FILE, JSON_FILE, CARD_FILE, PROMISE_FILE, *_back_files()}
    names |= {file_names(autopilot)[0] for autopilot in tunable_autopilots()}
    for autopilot in plannable():
        planned = plan_file_names(autopilot)
        names |= {planned.logging, planned.sweep_off, *planned.sweeps.values()}
    return names


def _back_files() -> set[str]:
    """Return the names of the files that lead back to what flew: never replaced, never removed."""
    return {
        *(file_names(autopilot)[1] for autopilot in tunable_autopilots()),
        *(plan_file_names(autopilot).logging_back for autopilot in plannable()),
    }
