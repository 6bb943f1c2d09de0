"""A motor that stands still while it is told to turn, in the air or on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from quadid_logs.align.series import CleanSeries
from quadid_logs.arrays import runs
from quadid_logs.data.health import Quantity, Standstill

#: At half the speed of the slowest other rotor, the same propeller gives a quarter of its thrust at most.
_OF_THE_SLOWEST: Final = 0.5
#: The others turn at a tenth of the quickest speed at least, which a few samples may exceed: rotors that run
#: down after landing stop one before the other, and whatever was sent last is sent to none.
_RUNNING: Final = 0.1
_QUICKEST: Final = 0.99
#: Judgement: longer than any ESC takes to start a motor, so that a slow start is no fault [s].
_SHORTEST_S: Final = 1.0


def find_standstill(outputs: CleanSeries, speed: CleanSeries, names: Sequence[str]) -> Standstill | None:
    """Search for a rotor that hardly turns although its command is above the mean of the others.

    Parameters
    ----------
    outputs : CleanSeries
        What each motor was sent, in any unit that grows with thrust.
    speed : CleanSeries
        Measured speed of each rotor, in the same order.
    names : sequence of str
        Of the motors.

    Returns
    -------
    Standstill or None
        The longest one; None where there is none.
    """
    n_rotors = len(names)
    if n_rotors < 3 or min(outputs.n_columns, speed.n_columns) < n_rotors:
        return None
    turns = speed.values[:, :n_rotors]
    known = turns[np.isfinite(turns)]
    running = _RUNNING * float(np.quantile(known, _QUICKEST)) if known.size else np.inf
    sent = np.column_stack([outputs.at(speed.time_s, rotor) for rotor in range(n_rotors)])
    longest: Standstill | None = None
    for rotor, name in enumerate(names):
        others = np.delete(np.arange(n_rotors), rotor)
        slowest = np.nan_to_num(turns[:, others].min(axis=1))
        asked = sent[:, rotor] > sent[:, others].mean(axis=1)
        stands = (slowest > running) & (turns[:, rotor] < _OF_THE_SLOWEST * slowest)
        for first, last in runs(asked & stands):
            length_s = float(speed.time_s[last - 1] - speed.time_s[first])
            if length_s < max(_SHORTEST_S, 0.0 if longest is None else longest.length.value):
                continue
            rpm = 30.0 / np.pi * np.array([turns[first:last, rotor].mean(), slowest[first:last].mean()])
            longest = Standstill(
                sentence=(
                    f"From {speed.time_s[first]:.1f} s, {name} turned at only {rpm[0]:.0f} rpm for "
                    f"{length_s:.1f} s. Its command was above the mean of the others, which turned at "
                    f"{rpm[1]:.0f} rpm or more. It stood still, or its speed was not measured."
                ),
                level="severe",
                findings=("QL436",),
                rotor=rotor,
                time_s=float(speed.time_s[first]),
                length=Quantity(length_s, "s"),
            )
    return longest
