"""A result as a page may show it that goes to others: no absolute path says where its owner keeps files."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import PurePosixPath, PureWindowsPath

from quadid_logs.commands import quoted
from quadid_logs.data.result import Result
from quadid_logs.report.provenance import Provenance


def without_folders(result: Result, provenance: Provenance) -> tuple[Result, Provenance]:
    """Return both with the last part of each absolute path; relative ones stay as they were given.

    Returns
    -------
    result : Result
        Shares what is recommended from the given one.
    provenance : Provenance
    """
    vehicle = result.vehicle
    shown = replace(
        result,
        log=replace(result.log, path=without_folder(result.log.path)),
        vehicle=None if vehicle is None else replace(vehicle, path=without_folder(vehicle.path)),
        pooled=tuple(
            replace(one, path=without_folder(one.path), same_as=without_folder(one.same_as))
            for one in result.pooled
        ),
    )
    # Imported here: an analysis without a report has no gains to hand on.
    from quadid_logs.tuning import tuning_of

    tuning_of.hand_on(result, shown)
    return shown, replace(provenance, command=_shortened(provenance.command))


def without_folder(path: str) -> str:
    r"""Return the last part of an absolute path of any system, anything else as it is.

    Examples
    --------
    >>> without_folder("/home/jo/flights/a.bin"), without_folder("flights/a.bin")
    ('a.bin', 'flights/a.bin')
    >>> without_folder(r"C:\\flights\\a.bin")
    'a.bin'
    """
    for kind in (PurePosixPath, PureWindowsPath):
        if kind(path).is_absolute():
            return kind(path).name
    return path


def _shortened(command: str) -> str:
    """Return a command line with the last part of each absolute path; "" where it cannot be taken apart."""
    try:
        words = shlex.split(command)
    except ValueError:
        return ""
    parts = ([without_folder(part) for part in word.split("=", 1)] for word in words)
    return " ".join(quoted("=".join(part)) for part in parts)
