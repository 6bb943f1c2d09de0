"""report.html: one file with everything in it, that asks no host for anything."""

from __future__ import annotations

import base64
import gzip
import hashlib
import importlib.util
import json
from collections.abc import Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from quadid_logs.errors import OutputError
from quadid_logs.figures import CHAPTERS, Figure, Figures
from quadid_logs.figures.interactive import interactive
from quadid_logs.figures.palette import DARK, LIGHT
from quadid_logs.report.pages import environment
from quadid_logs.report.view import View

#: Fewer values than this take no bytes that matter.
_FEWEST_IN_STEPS = 200


def render_html(view: View, figures: Figures) -> str:
    """Return the page.

    Every text is escaped by the template; a content security policy lets only
    the two scripts of this package run and forbids every connection.

    Parameters
    ----------
    view : View
    figures : Figures

    Returns
    -------
    str
        A complete HTML document.

    Raises
    ------
    OutputError
        If the installed plotly package does not hold its script.
    """
    by_key = {figure.key: figure for figure in figures.shown}
    page: str = (
        environment()
        .get_template("report.html")
        .render(
            view=view,
            chapters={
                chapter: [by_key[key] for key in keys if key in by_key] for chapter, keys in CHAPTERS.items()
            },
            left_out=figures.left_out,
            **charts(figures.shown),
        )
    )
    return page


def charts(figures: Sequence[Figure]) -> dict[str, Any]:
    """Return what a template needs to draw figures, and for the policy that lets only that be run.

    Parameters
    ----------
    figures : sequence of Figure

    Returns
    -------
    dict
        ``figure_json`` by key, ``palettes``, ``script``, ``plotly`` (compressed, base64; empty where nothing
        is drawn) and ``script_hashes``.
    """
    # As it is: what a content security policy lets run is known by its hash.
    script = resources.files("quadid_logs.report").joinpath("templates/report.js").read_text("utf-8")
    plotly = _plotly_script() if figures else ""
    return {
        "figure_json": {figure.key: script_json(packed(interactive(figure))) for figure in figures},
        "palettes": script_json({"light": dict(LIGHT), "dark": dict(DARK)}),
        "script": script,
        "plotly": _compressed(plotly) if plotly else "",
        "script_hashes": " ".join(csp_hash(text) for text in (plotly, script)),
    }


def packed(figure: dict[str, Any]) -> dict[str, Any]:
    """Return a figure in a third of the bytes; the page's script makes it whole again.

    Arrays that are the same stand once. Along linear axes a value is one of 65 535 steps of the range: at a
    zoom of thirty, that is a pixel.

    Parameters
    ----------
    figure : dict
        Of `interactive`.

    Returns
    -------
    dict
        With ``arrays``, of which x and y of each trace give the place.

    Examples
    --------
    >>> line = {"x": {"dtype": "f4", "bdata": "AACAPw=="}, "y": {"dtype": "f4", "bdata": "AAAAQA=="}}
    >>> twice = packed({"data": [line, line], "layouts": {"wide": {}}})
    >>> len(twice["arrays"]), twice["data"][1]
    (2, {'x': {'array': 0}, 'y': {'array': 1}})
    """
    places: dict[str, int] = {}
    arrays: list[Any] = []
    layout = figure["layouts"]["wide"]

    def place(trace: dict[str, Any], name: str) -> Any:
        value = trace[name]
        if not isinstance(value, dict):
            return value
        axis = layout.get(trace.get(f"{name}axis", name).replace(name, f"{name}axis"), {})
        known = places.setdefault(value["dtype"] + value["bdata"], len(arrays))
        if known == len(arrays):
            arrays.append(value if axis.get("type") == "log" else _in_steps(value))
        return {"array": known}

    data = [{**trace, "x": place(trace, "x"), "y": place(trace, "y")} for trace in figure["data"]]
    return {**figure, "data": data, "arrays": arrays}


def _in_steps(value: dict[str, str]) -> dict[str, Any]:
    """Return an array as whole steps of its range, -32768 where it is NaN; a short one stays as it is."""
    values = np.frombuffer(base64.b64decode(value["bdata"]), dtype=f"<{value['dtype']}").astype(np.float64)
    known = np.isfinite(values)
    if values.size < _FEWEST_IN_STEPS or not known.any():
        return value
    low, high = float(values[known].min()), float(values[known].max())
    step = (high - low) / 65_534.0 or 1.0
    steps = np.where(known, np.round((values - low) / step) - 32_767.0, -32_768.0).astype("<i2")
    encoded = base64.b64encode(steps.tobytes()).decode("ascii")
    return {"dtype": "i2", "bdata": encoded, "low": low, "step": step}


def script_json(value: Any) -> str:
    r"""Return JSON that may stand inside a script element.

    Parameters
    ----------
    value : object
        Of strings, numbers, lists and dictionaries; no NaN.

    Returns
    -------
    str

    Examples
    --------
    >>> script_json({"a": "</script>"})
    '{"a":"\\u003c/script\\u003e"}'
    """
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for letter in "<>&\u2028\u2029":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return text


@cache
def _compressed(script: str) -> str:
    """Return a script as gzip in base64: two fifths of its bytes. The page's own script runs it."""
    # Of the same bytes for the same script: no time in the header. The best compression saves 1 % more, in
    # twice the time.
    return base64.b64encode(gzip.compress(script.encode("utf-8"), compresslevel=5, mtime=0)).decode("ascii")


@cache
def _plotly_script() -> str:
    """Return plotly.min.js of our wheel; in a checkout, of the plotly package, without importing it."""
    path = Path(__file__).parent / "vendored" / "plotly.min.js"
    if not path.is_file():
        found = importlib.util.find_spec("plotly")
        if found is None or found.origin is None:
            raise OutputError("The plotly package is not installed.", hint="Install it: pip install plotly.")
        path = Path(found.origin).parent / "package_data" / "plotly.min.js"
    try:
        # The CSP hash is of what the browser sees, and it turns CRLF into LF.
        return path.read_text(encoding="utf-8").replace("\r\n", "\n")
    except OSError as error:
        raise OutputError(
            f"The plotly package has no script ({error}).",
            hint="Reinstall it: pip install --force-reinstall plotly.",
        ) from error


def csp_hash(script: str) -> str:
    """Return what a content security policy needs to let exactly this script run.

    Parameters
    ----------
    script : str

    Returns
    -------
    str
    """
    digest = hashlib.sha256(script.encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"
