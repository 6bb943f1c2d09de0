"""What each figure shows, as data; `png` and `interactive` draw the same data twice."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

from quadid_logs.data.result import Result
from quadid_logs.data.settings import STRUCTURES
from quadid_logs.figures.spec import Figure, LeftOut
from quadid_logs.vocabulary import AXES

__all__ = ["FIGURE_KEYS", "Figure", "Figures", "LeftOut", "figures_of"]

#: Every key that a figure can have.
FIGURE_KEYS: Final = (
    *("flight", "aligned", "gyro", "airframe", "excitation", "windows", "over-time", "singular"),
    *("structures", "lag", "frequency"),
    *("summary", "held-out", "fit", "simulation", "residuals", "horizon"),
    *(f"condition-{structure}" for structure in STRUCTURES),
)
#: Figures whose panels show what an axis' model says.
_OF_THE_MODEL: Final = frozenset(
    {"over-time", "structures", "held-out", "fit", "simulation", "residuals", "frequency"}
)


class Figures(NamedTuple):
    """The figures of a result, in the order of the report, and those with nothing to show."""

    shown: tuple[Figure, ...]
    left_out: tuple[LeftOut, ...]


def figures_of(result: Result) -> Figures:
    """Compute every figure once.

    Parameters
    ----------
    result : Result

    Returns
    -------
    Figures
        Series thinned for display without losing peaks, angles in degrees.
    """
    from quadid_logs.figures.airframe import airframe_from_above
    from quadid_logs.figures.excitation import excitation_spectra
    from quadid_logs.figures.fit import fit_figures, horizon_error, lag_profile, structure_comparison
    from quadid_logs.figures.flight import aligned_series, flight_overview
    from quadid_logs.figures.frequency import frequency_response
    from quadid_logs.figures.gyro import gyro_against_attitude
    from quadid_logs.figures.windows import window_figures

    everything = [
        flight_overview(result),
        aligned_series(result),
        gyro_against_attitude(result),
        airframe_from_above(result),
        excitation_spectra(result),
        *window_figures(result),
        structure_comparison(result),
        lag_profile(result),
        *fit_figures(result),
        frequency_response(result),
        horizon_error(result),
    ]
    return Figures(
        shown=tuple(_marked(item, result) for item in everything if isinstance(item, Figure)),
        left_out=tuple(item for item in everything if isinstance(item, LeftOut)),
    )


def _marked(figure: Figure, result: Result) -> Figure:
    """Say in the panels of refused axes that they show no results."""
    found = result.diagnosis.axes
    refused = tuple(axis.capitalize() for axis in AXES if axis in found and found[axis].verdict == "refused")
    if figure.key not in _OF_THE_MODEL or not refused:
        return figure
    # Three panels beside each other leave no room for more.
    mark = "refused" if figure.columns > 2 else "refused, not to be trusted"
    panels = tuple(
        replace(panel, title=f"{panel.title} – {mark}") if panel.title.startswith(refused) else panel
        for panel in figure.panels
    )
    return replace(figure, panels=panels)
