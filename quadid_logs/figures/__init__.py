"""What each figure shows, as data; `png` and `interactive` draw the same data twice."""

from __future__ import annotations

import importlib
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from quadid_logs.data.result import Result
from quadid_logs.data.settings import STRUCTURES
from quadid_logs.figures.spec import Figure, LeftOut

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["CHAPTERS", "FIGURE_KEYS", "Figure", "Figures", "LeftOut", "figures_of"]


class Registered(NamedTuple):
    """Figures of one chapter of the report, and the function of this package that makes them of a result.

    It returns a figure or several, or what it leaves out; a function may stand in several rows.
    """

    chapter: str
    keys: tuple[str, ...]
    maker: str


#: Every figure of a report, in its order.
REGISTERED: Final = (
    Registered("verdict", ("evidence",), "evidence:evidence_figure"),
    Registered(
        "shows",
        (
            "tracking",
            "rates",
            "attitude-tracking",
            "tilt",
            "step-response",
            "gyro-spectrum",
            "command-spectrum",
            "spectrogram",
            "motors",
            "torque",
            "throttle",
            "thrust",
            "vibration",
            "battery",
        ),
        "health:health_figures",
    ),
    Registered("model", ("response",), "bode:frequency_response"),
    Registered("loop", ("loop-tracking", "loop-step"), "closed_loop:loop_figures"),
    Registered("loop-detail", ("loop-bode", "loop-nyquist"), "closed_loop:loop_figures"),
    Registered("flight", ("flight",), "time_series:flight_overview"),
    Registered("flight", ("aligned",), "time_series:aligned_series"),
    Registered("flight", ("gyro",), "gyro_scatter:gyro_against_attitude"),
    Registered("flight", ("airframe",), "rotor_layout:airframe_from_above"),
    Registered("excitation", ("excitation",), "excitation_spectra:excitation_spectra"),
    Registered(
        "windows",
        (*(f"condition-{structure}" for structure in STRUCTURES), "over-time", "singular"),
        "window_estimates:window_figures",
    ),
    Registered("fit", ("lag",), "model_fit:lag_profile"),
    Registered("fit", ("held-out", "fit", "simulation"), "model_fit:fit_figures"),
    Registered("fit", ("horizon",), "model_fit:horizon_error"),
    Registered("fit", ("residuals",), "model_fit:fit_figures"),
    Registered("structures", ("structures",), "model_fit:structure_comparison"),
)


def _keys_of(chapter: str) -> tuple[str, ...]:
    return tuple(key for row in REGISTERED if row.chapter == chapter for key in row.keys)


#: The chapters of the report that hold figures, in its order, each with the keys of its figures.
CHAPTERS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {row.chapter: _keys_of(row.chapter) for row in REGISTERED}
)
#: Every key that a figure can have.
FIGURE_KEYS: Final = ("summary", *(key for keys in CHAPTERS.values() for key in keys))


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
    everything = [
        figure for maker in dict.fromkeys(row.maker for row in REGISTERED) for figure in _made(maker, result)
    ]
    # The panels of refused axes say that they show no results.
    refused = {axis for axis, found in result.diagnosis.axes.items() if found.verdict == "refused"}
    shown = []
    for item in everything:
        if isinstance(item, Figure):
            panels = tuple(
                replace(panel, title=f"{panel.title} – refused") if panel.model_of in refused else panel
                for panel in item.panels
            )
            shown.append(replace(item, panels=panels))
    return Figures(
        shown=tuple(shown),
        left_out=tuple(item for item in everything if isinstance(item, LeftOut)),
    )


def _made(maker: str, result: Result) -> Sequence[Figure | LeftOut]:
    """Return the figures of one function, which is imported when it is needed."""
    module, _, function = maker.partition(":")
    made = getattr(importlib.import_module(f"{__name__}.{module}"), function)(result)
    return [made] if isinstance(made, Figure | LeftOut) else made
