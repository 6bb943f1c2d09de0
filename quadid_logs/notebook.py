"""Results in a notebook: `show` displays a result; its figures are available for matplotlib and Plotly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from quadid_logs.data.result import Result
from quadid_logs.extra import load
from quadid_logs.figures import figures_of
from quadid_logs.report.pages import environment
from quadid_logs.report.provenance import provenance_of
from quadid_logs.report.view import view_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shown:
    """A result for display: as HTML in a notebook (Jupyter), as text elsewhere."""

    result: Result

    def _repr_html_(self) -> str:
        """Return verdicts and matrices as HTML without scripts; every text is escaped."""
        view = view_of(self.result, provenance_of(self.result.log.path))
        page: str = environment().get_template("notebook.html").render(view=view)
        return page

    def __repr__(self) -> str:
        from quadid_logs.report.text import result_lines

        return "\n".join(result_lines(self.result))


def show(result: Result) -> Shown:
    """Return a result as an object that a notebook displays as verdicts and tables.

    Parameters
    ----------
    result : Result
        The result of `quadid_logs.analyze`.

    Returns
    -------
    Shown

    Examples
    --------
    >>> from quadid_logs import analyze, show
    >>> print(str(show(analyze("sample_logs/default-logging.bin"))).splitlines()[0])
    default-logging.bin: structure damped, 33.5 s of 39.7 s analyzed
    """
    return Shown(result=result)


def matplotlib_figures(result: Result) -> dict[str, Canvas]:
    """Return every figure of the report by its key, as ordinary matplotlib figures.

    Parameters
    ----------
    result : Result

    Returns
    -------
    dict of str to matplotlib.figure.Figure
        Figures by key. They are not registered with pyplot and need not be closed.

    Examples
    --------
    >>> from quadid_logs import analyze, matplotlib_figures
    >>> figures = matplotlib_figures(analyze("sample_logs/default-logging.bin"))
    >>> figures["flight"].axes[0].get_ylabel()
    'body rate [deg/s]'
    """
    from quadid_logs.figures.png import draw

    return {figure.key: draw(figure) for figure in figures_of(result).shown}


def plotly_figures(result: Result) -> dict[str, Any]:
    """Return every figure of the report by its key, as ordinary Plotly figures.

    Parameters
    ----------
    result : Result

    Returns
    -------
    dict of str to plotly.graph_objects.Figure

    Raises
    ------
    SettingsError
        If plotly is not installed.

    Examples
    --------
    >>> from quadid_logs import analyze, plotly_figures
    >>> figures = plotly_figures(analyze("sample_logs/default-logging.bin"))
    >>> figures["flight"].data[0].name
    'p'
    """
    from quadid_logs.figures.interactive import interactive

    go = load("plotly.graph_objects", "python")
    made = {}
    for figure in figures_of(result).shown:
        content = _coloured(interactive(figure))
        made[figure.key] = go.Figure(data=content["data"], layout=content["layouts"]["wide"])
    return made


def _coloured(value: Any) -> Any:
    """Replace "@role" by the colour of that role on a white background."""
    from quadid_logs.figures.palette import LIGHT

    if isinstance(value, str) and value.startswith("@"):
        return LIGHT.get(value[1:], value)
    if isinstance(value, dict):
        return {key: _coloured(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_coloured(item) for item in value]
    return value
