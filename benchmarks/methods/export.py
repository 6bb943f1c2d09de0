"""The data sets as files, for methods of others: a CSV of the series, a JSON of what an entry must repeat."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from benchmarks.methods.data_sets import DataSet, Source, load
from quadid_logs.output import make_folder, write_together
from quadid_logs.untrusted import portable_name

COLUMNS = ("segment", "time_s", "p_rad_s", "q_rad_s", "r_rad_s", "L", "M", "N")


def export(chosen: Iterable[Source], folder: Path) -> int:
    """Write every data set; return how many.

    Parameters
    ----------
    chosen : iterable of Source
    folder : Path
        Made if it is not there; files of the same names are replaced.

    Returns
    -------
    int

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    make_folder(folder)
    written = 0
    for source in chosen:
        data_set = load(source)
        if data_set is not None:
            name = portable_name(source.name)
            write_together(folder, {f"{name}.csv": _series(data_set), f"{name}.json": _facts(data_set)})
            written += 1
    return written


def _series(data_set: DataSet) -> bytes:
    """Return all segments as CSV."""
    segments = data_set.data.segments
    number = np.repeat(np.arange(len(segments)), [each.n_samples for each in segments])
    file = io.StringIO()
    table = np.column_stack([number, data_set.series()])
    np.savetxt(file, table, "%.9g", delimiter=",", header=",".join(COLUMNS), comments="")
    return file.getvalue().encode()


def _facts(data_set: DataSet) -> bytes:
    """Return what an entry must repeat, and what the data set is; no truth."""
    facts = {
        "data_set": data_set.source.name,
        "kind": data_set.source.kind,
        "vehicle": data_set.source.vehicle,
        "sample_period_s": data_set.data.sample_period_s,
        "n_samples": data_set.n_samples,
        "rms": list(data_set.rms),
    }
    return (json.dumps(facts, indent=1, allow_nan=False) + "\n").encode()
