"""What each figure shows, as data; `png` and `interactive` draw the same data twice."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from quadid_logs.data.result import Result
from quadid_logs.data.settings import STRUCTURES
from quadid_logs.figures.spec import Figure, LeftOut

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["CHAPTERS", "FIGURE_KEYS", "FIRST_CHAPTER", "Figure", "Figures", "LeftOut", "figures_of"]

#: Of what any log shows, in the order of the page.
HEALTH_KEYS: Final = (
    "tracking",
    "attitude-tracking",
    "step-response",
    "gyro-spectrum",
    "spectrogram",
    "motors",
    "vibration",
    "battery",
)
#: The chapters of the report that hold figures, in its order, each with the keys of its figures.
CHAPTERS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "verdict": ("evidence",),
        "shows": HEALTH_KEYS,
        "model": ("response",),
        "loop": ("loop-tracking", "loop-step"),
        "loop-detail": ("loop-bode", "loop-nyquist"),
        "flight": ("flight", "aligned", "gyro", "airframe"),
        "excitation": ("excitation",),
        "windows": (*(f"condition-{structure}" for structure in STRUCTURES), "over-time", "singular"),
        "fit": ("lag", "held-out", "fit", "simulation", "horizon", "residuals"),
        "structures": ("structures",),
    }
)
#: The keys of the figures that a report is drawn with unless every one is wanted.
FIRST_CHAPTER: Final = CHAPTERS["flight"]
#: Every key that a figure can have.
FIGURE_KEYS: Final = ("summary", *(key for keys in CHAPTERS.values() for key in keys))


class Figures(NamedTuple):
    """The figures of a result, in the order of the report, the loop last; those with nothing to show."""

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
    from quadid_logs.figures.bode import frequency_response
    from quadid_logs.figures.closed_loop import loop_figures
    from quadid_logs.figures.evidence import evidence_figure
    from quadid_logs.figures.excitation_spectra import excitation_spectra
    from quadid_logs.figures.gyro_scatter import gyro_against_attitude
    from quadid_logs.figures.health import health_figures
    from quadid_logs.figures.model_fit import fit_figures, horizon_error, lag_profile, structure_comparison
    from quadid_logs.figures.rotor_layout import airframe_from_above
    from quadid_logs.figures.time_series import aligned_series, flight_overview
    from quadid_logs.figures.window_estimates import window_figures

    everything = [
        evidence_figure(result),
        *health_figures(result),
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
        *loop_figures(result),
    ]
    return Figures(
        shown=tuple(_marked(item, result) for item in everything if isinstance(item, Figure)),
        left_out=tuple(item for item in everything if isinstance(item, LeftOut)),
    )


def _marked(figure: Figure, result: Result) -> Figure:
    """Say in the panels of refused axes that they show no results."""
    found = result.diagnosis.axes
    refused = {axis for axis in found if found[axis].verdict == "refused"}
    # Three panels beside each other leave no room for more.
    mark = "refused" if figure.columns > 2 else "refused, not to be trusted"
    panels = tuple(
        replace(panel, title=f"{panel.title} – {mark}") if panel.model_of in refused else panel
        for panel in figure.panels
    )
    return replace(figure, panels=panels)
