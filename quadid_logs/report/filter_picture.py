"""Settings of the filters as points, drawn as SVG: noise on the motors against phase lost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from quadid_logs.data.catalogue import MOST_NOISE
from quadid_logs.data.tuning import AxisTuning
from quadid_logs.report.numbers import number
from quadid_logs.report.picture import WIDTH, Picture, Scale

_HEIGHT: Final = 200
_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 12, 12, 36
#: Room beside the outermost points, as a part of the picture.
_ROOM: Final = 0.06


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterPicture(Picture):
    """Settings as points: (class, x, y, radius)."""

    points: tuple[tuple[str, float, float, float], ...]


def filter_picture(axis: str, found: AxisTuning) -> FilterPicture | None:
    """Return the picture of one axis, None where its filters stay."""
    trials = found.filter_trials
    if not found.filters or len(trials) < 2:
        return None
    phase = [one.phase_deg for one in trials]
    noise = [100.0 * MOST_NOISE * one.noise for one in trials]
    x = _scale(phase, _LEFT, WIDTH - _RIGHT)
    y = _scale([_log(one) for one in noise], _HEIGHT - _BOTTOM, _TOP)
    names = ["flown", *["other"] * (len(trials) - 2), "chosen"]
    sizes = {"flown": 5.0, "other": 2.0, "chosen": 5.0}
    chosen = trials[-1]
    less = -chosen.phase_deg
    phase_words = (
        f"{number(abs(less), 2)} degrees {'less' if less > 0.0 else 'more'} phase lost at the crossover"
    )
    percent = [number(100.0 * MOST_NOISE * one.noise, 2) for one in (trials[0], chosen)]
    return FilterPicture(
        axis=axis,
        points=tuple(
            (name, x.at(lost), y.at(_log(loud)), sizes[name])
            for name, lost, loud in zip(names, phase, noise, strict=True)
        ),
        across=tuple((x.at(end), f"{number(end, 2)}°") for end in (min(phase), max(phase))),
        up=tuple((y.at(_log(end)), f"{number(end, 2)} %") for end in (min(noise), max(noise))),
        words=(
            f"{axis.capitalize()}: the chosen filters have {phase_words}. With their gains, the noise on "
            f"the motors is {percent[1]} %. The best gains with the flown filters would give {percent[0]} %."
        ),
        height=_HEIGHT,
        left=_LEFT,
        right=WIDTH - _RIGHT,
    )


def _log(percent: float) -> float:
    return math.log(max(percent, 1e-4))


def _scale(values: list[float], begin: float, end: float) -> Scale:
    room = _ROOM * (end - begin)
    return Scale(min(values), max(values), begin + room, end - room)
