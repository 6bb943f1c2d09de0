"""What each figure shows, as data; `png` and `interactive` draw the same data twice."""

from __future__ import annotations

from typing import NamedTuple

from quadid_logs.data.result import Result
from quadid_logs.figures.spec import Figure, LeftOut

__all__ = ["Figure", "Figures", "LeftOut", "figures_of"]


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
    from quadid_logs.figures.windows import window_figures

    everything = [
        flight_overview(result),
        aligned_series(result),
        airframe_from_above(result),
        excitation_spectra(result),
        *window_figures(result),
        structure_comparison(result),
        lag_profile(result),
        *fit_figures(result),
        horizon_error(result),
    ]
    return Figures(
        shown=tuple(item for item in everything if isinstance(item, Figure)),
        left_out=tuple(item for item in everything if isinstance(item, LeftOut)),
    )
