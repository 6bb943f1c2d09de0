"""Colours by role, on paper and on a dark screen.

The hues are those of M. Okabe and K. Ito, "Color Universal Design", 2008,
which people with any colour vision can tell apart; on dark the lighter ones
of the same set are taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

LIGHT: Final[Mapping[str, str]] = MappingProxyType(
    {
        "roll": "#0072B2",
        "pitch": "#D55E00",
        "yaw": "#009E73",
        "throttle": "#B5649A",
        "measured": "#5b6470",
        "modelled": "#D55E00",
        "estimate": "#0072B2",
        "unused": "#b9bec6",
        "analyzed": "#009E73",
        "saturated": "#AA1155",
        "series-1": "#0072B2",
        "series-2": "#D55E00",
        "series-3": "#009E73",
        "series-4": "#B5649A",
        "ink": "#1b1f24",
        "muted": "#5b6470",
        "grid": "#dfe3e8",
        "paper": "#ffffff",
        "held-out": "#56B4E9",
        "interval": "#E69F00",
        "noise": "#CC79A7",
        "mode-1": "#8a929c",
        "mode-2": "#56B4E9",
        "mode-3": "#E69F00",
        "mode-4": "#CC79A7",
        "mode-5": "#009E73",
        "mode-6": "#F0E442",
    }
)

DARK: Final[Mapping[str, str]] = MappingProxyType(
    {
        **LIGHT,
        "roll": "#56B4E9",
        "pitch": "#E69F00",
        "yaw": "#2cc79b",
        "throttle": "#e3a3c8",
        "measured": "#a9b1bb",
        "modelled": "#E69F00",
        "estimate": "#56B4E9",
        "unused": "#59616b",
        "analyzed": "#2cc79b",
        "saturated": "#ff6fa8",
        "held-out": "#b39dff",
        "series-1": "#56B4E9",
        "series-2": "#E69F00",
        "series-3": "#2cc79b",
        "series-4": "#e3a3c8",
        "ink": "#e8eaed",
        "muted": "#a9b1bb",
        "grid": "#343a42",
        "paper": "#171a1f",
    }
)

#: A wide line is pale: what lies on it must be seen.
WIDE_OPACITY: Final = 0.45

#: Of maps: dark to light, which people with any colour vision can read (J. Nunez et al., 2018).
HEAT_COLOURS: Final = "Cividis"
#: What lies beyond takes the end's colour: a few cells must not take the colours of all others.
HEAT_PERCENTILES: Final = (2.0, 99.8)

#: How strongly a band of a role covers the paper; others take the first.
BAND_OPACITY: Final[Mapping[str, float]] = MappingProxyType({"": 0.12, "held-out": 0.18, "interval": 0.28})


def band_opacity(role: str) -> float:
    """Return the opacity of a band, between 0 and 1."""
    return BAND_OPACITY.get(role, BAND_OPACITY[""])
