"""tune.html: one file with everything in it, that asks no host for anything."""

from __future__ import annotations

from collections.abc import Mapping

from quadid_logs.data.autotune import AutotuneForecast
from quadid_logs.data.closed_loop import LoopCurve
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import Tuning
from quadid_logs.data.what_if import WhatIf
from quadid_logs.diagnose.advice import advice_for
from quadid_logs.figures.loop_comparison import next_loop_figure
from quadid_logs.report.html import charts
from quadid_logs.report.pages import environment
from quadid_logs.report.provenance import LONGEST_COMMAND, Provenance
from quadid_logs.report.sharing import without_folders
from quadid_logs.report.tune_pictures import filter_picture, step_picture
from quadid_logs.report.tune_view import tune_view
from quadid_logs.report.what_if import what_if_parts
from quadid_logs.untrusted import printable

PAGE_FILE = "tune.html"


def tune_page(
    result: Result,
    tuning: Tuning,
    provenance: Provenance,
    forecasts: Mapping[str, tuple[AutotuneForecast, ...]] | None = None,
    grids: Mapping[str, WhatIf] | None = None,
    following: Mapping[str, LoopCurve] | None = None,
) -> str:
    """Return the page.

    Parameters
    ----------
    forecasts : mapping of str to tuple of AutotuneForecast, optional
        By axis, where the autopilot's own procedure would end.
    grids : mapping of str to WhatIf, optional
        By axis, what other gains and filters would make; a script of the page looks them up.
    following : mapping of str to LoopCurve, optional
        By axis, the open loop with the next gains: of `quadid_logs.tuning.next_loops`.

    Returns
    -------
    str
        A complete HTML document; every text is escaped by the template.
    """
    result, provenance = without_folders(result, provenance)
    loops = {} if result.closed_loop is None else result.closed_loop.axes
    flown = {axis: loop.step for axis, loop in loops.items()}
    pictures = [step_picture(axis, found, flown.get(axis)) for axis, found in tuning.axes.items()]
    filters = [filter_picture(axis, found) for axis, found in tuning.axes.items()]
    shown = [axis for axis in tuning.axes if axis not in tuning.refused]
    loop = None if following is None else next_loop_figure(result, following, shown)
    figures = [] if loop is None else [loop]
    page: str = (
        environment()
        .get_template("tune.html")
        .render(
            view=tune_view(result, tuning, forecasts),
            what_if=what_if_parts(grids or {}),
            step_note=advice_for(result.log.autopilot).step_note(result.log.parameters),
            pictures=[one for one in pictures if one is not None],
            steps_measured=any(curve.name == "measured" for one in pictures if one for curve in one.curves),
            filters=[one for one in filters if one is not None],
            figures=figures,
            **charts(figures),
            provenance={
                "version": provenance.version,
                "log_sha256": provenance.log_sha256,
                "command": printable(provenance.command, LONGEST_COMMAND),
            },
        )
    )
    return page
