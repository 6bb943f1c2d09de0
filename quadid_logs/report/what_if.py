"""The grid of other gains and filters as data for the page's script."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from typing import Any

import numpy as np

from quadid_logs.data.what_if import WhatIf, WhatIfLoop
from quadid_logs.report.html import csp_hash, script_json
from quadid_logs.report.numbers import number
from quadid_logs.report.tune_pictures import rise_words


def what_if_parts(grids: Mapping[str, WhatIf]) -> dict[str, Any]:
    """Return what the template needs, and for the policy that lets only this script run.

    ``grids`` as JSON, ``script`` and ``script_hash``; all empty without a grid.
    """
    if not grids:
        return {"axes": (), "grids": "", "script": "", "script_hash": ""}
    made = {}
    for axis, grid in grids.items():
        end_s = float(grid.time_s[-1])
        made[axis] = {
            "names": list(grid.values),
            "values": [[number(one) for one in each] for each in grid.values.values()],
            "end": f"{number(end_s, 2)} s",
            "loops": [None if one is None else _loop(one, end_s) for one in grid.loops],
        }
    script = resources.files("quadid_logs.report").joinpath("templates/tune.js").read_text("utf-8")
    return {
        "axes": tuple(grids),
        "grids": script_json(made),
        "script": script,
        "script_hash": csp_hash(script),
    }


def _loop(loop: WhatIfLoop, end_s: float) -> list[Any]:
    """Return the words, then the response in per cent."""
    figures = [
        f"{number(value, 2)} {unit}"
        for value, unit in ((loop.gain_margin_db, "dB"), (loop.phase_margin_deg, "degrees"))
        if value is not None
    ]
    margins = " and ".join(figures) or "nowhere near instability"
    rise = rise_words(loop.rise_time_s, loop.overshoot_percent, float(loop.response[-1]), end_s)
    response = np.round(100.0 * np.clip(np.nan_to_num(loop.response), -1.0, 3.0)).astype(int)
    return [margins, rise, response.tolist()]
