"""What a firmware makes of the thrust that its mixer asks a motor for, where no thrust curve is behind it.

Source: Betaflight 2025.12, ``pid.c`` (``pidApplyThrustLinearization``) and ``mixer.c``
(``calculateThrottleAndCurrentMotorEndpoints``).
"""

from __future__ import annotations

from typing import Final, NamedTuple

from quadid_logs.simulator.control import higher, lower
from quadid_logs.simulator.effects import Effects

#: Of a cell [V]: full (``CELL_VOLTAGE_FULL_CV``), and the warning's default, where nothing is held back.
CELL_FULL_V: Final = 4.2
CELL_WARNING_V: Final = 3.5


class OutputCurve(NamedTuple):
    """`thrust_linear` and `vbat_sag_compensation` as fractions.

    Attributes
    ----------
    linearisation, sag_compensation : float
    present : bool
        Whether either of them does anything.
    """

    linearisation: float
    sag_compensation: float
    present: bool

    def output(self, thrust: float, voltage: float) -> float:
        """Return a motor's output (0 to 1) for the fraction that the mixer asks for.

        Parameters
        ----------
        voltage : float
            Of the battery over that of a full one.
        """
        rest = 1.0 - thrust
        held = self.held_back(voltage)
        return (1.0 - held) * thrust * (1.0 + self.linearisation * rest * rest)

    def held_back(self, voltage: float) -> float:
        """Return which part of the outputs' range is kept for an empty battery."""
        part = 1.0 - CELL_WARNING_V / CELL_FULL_V
        left = 1.0 - lower(higher((1.0 - voltage) / part, 0.0), 1.0)
        return self.sag_compensation * part * left

    def throttle(self, throttle: float) -> float:
        """Return the throttle lowered so that the linearisation does not raise a hover's outputs."""
        e, rest = self.linearisation, 1.0 - throttle
        return throttle / (1.0 + (e - 0.5 * e * e) * rest * rest)


def output_curve(effects: Effects, *, wanted: bool) -> OutputCurve:
    """Return the curve of a flight; that of firmware without one does nothing.

    Parameters
    ----------
    wanted : bool
        The firmware has these settings.
    """
    if not wanted:
        return OutputCurve(0.0, 0.0, present=False)
    amounts = effects.thrust_linear, effects.sag_compensation
    return OutputCurve(*amounts, present=any(amounts))
