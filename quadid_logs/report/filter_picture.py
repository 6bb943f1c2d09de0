"""Settings of the filters as points, drawn as SVG: noise on the motors against phase lost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from quadid_logs.control.recommend import MOST_NOISE
from quadid_logs.data.tuning import AxisTuning, FilterTrial
from quadid_logs.report.numbers import number

WIDTH: Final = 320
HEIGHT: Final = 200
_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 12, 12, 36
#: Room beside the outermost points, as a part of the picture.
_ROOM: Final = 0.06


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterPicture:
    """One axis: points as (class, x, y, radius), ticks as (place, text), and what it shows in words."""

    axis: str
    points: tuple[tuple[str, float, float, float], ...]
    across: tuple[tuple[float, str], ...]
    up: tuple[tuple[float, str], ...]
    words: str
    width: int = WIDTH
    height: int = HEIGHT
    left: int = _LEFT
    right: int = WIDTH - _RIGHT


def filter_picture(axis: str, found: AxisTuning) -> FilterPicture | None:
    """Return the picture of one axis, None where its filters stay.

    Parameters
    ----------
    axis : str
    found : AxisTuning

    Returns
    -------
    FilterPicture or None
    """
    trials = found.filter_trials
    if not found.filters or len(trials) < 2:
        return None
    phase = np.array([one.phase_deg for one in trials])
    noise = 100.0 * MOST_NOISE * np.array([one.noise for one in trials])
    x = _places(phase, _LEFT, WIDTH - _RIGHT)
    y = _places(np.log(np.maximum(noise, 1e-4)), HEIGHT - _BOTTOM, _TOP)
    names = ["flown", *["other"] * (len(trials) - 2), "chosen"]
    sizes = {"flown": 5.0, "other": 2.0, "chosen": 5.0}
    ends_x, ends_y = ([int(np.argmin(each)), int(np.argmax(each))] for each in (phase, noise))
    return FilterPicture(
        axis=axis,
        points=tuple(
            (name, float(across), float(up), sizes[name])
            for name, across, up in zip(names, x, y, strict=True)
        ),
        across=tuple((float(x[place]), f"{number(phase[place], 2)}°") for place in ends_x),
        up=tuple((float(y[place]), f"{number(noise[place], 2)} %") for place in ends_y),
        words=_words(axis, trials[0], trials[-1]),
    )


def _places(values: np.ndarray, begin: float, end: float) -> np.ndarray:
    low, high = float(values.min()), float(values.max())
    part = (values - low) / (high - low) if high > low else np.full(values.shape, 0.5)
    return np.round(begin + (end - begin) * (_ROOM + (1.0 - 2.0 * _ROOM) * part), 1)


def _words(axis: str, flown: FilterTrial, chosen: FilterTrial) -> str:
    less = -chosen.phase_deg
    phase = f"{number(abs(less), 2)} degrees {'less' if less > 0.0 else 'more'} phase lost at the crossover"
    noise = [number(100.0 * MOST_NOISE * one.noise, 2) for one in (flown, chosen)]
    return (
        f"{axis.capitalize()}: with the filters chosen there are {phase}, and gains behind them make "
        f"{noise[1]} % "
        f"of noise on the motors; the best gains behind the flown filters would make {noise[0]} %."
    )
