"""How torque follows from the logged outputs, and how far that is known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from quadid_logs.arrays import FloatArray

#: Between what rows of neighbouring loops differ by and what a wrong parameter does [us].
_TYPICAL_LIMIT_US = 5.0


class DensityLaw(StrEnum):
    """Where the air density comes from that the firmware's compensation used."""

    LOGGED = "logged"
    NONE = "none"
    FITTED = "fitted"


@dataclass(frozen=True, slots=True, kw_only=True)
class MixerCheck:
    """Pulse widths recomputed from the torque command against the logged ones, unsaturated samples only.

    Mean, standard deviation and largest error [us] over ``n_samples`` rows of
    all motors, and what 68 % of the errors stay below; ``law`` is the air
    density law that explains them, ``density`` its name for people.
    """

    n_samples: int
    mean_us: float
    std_us: float
    largest_us: float
    typical_us: float
    density: str
    law: DensityLaw = DensityLaw.NONE

    @property
    def fits(self) -> bool:
        """Whether what the motors did is what is computed here."""
        # Not mean and standard deviation: a log slower than the loop has rows of another
        # loop beside those of the outputs, and where the command jumps a few are far off.
        return self.typical_us < _TYPICAL_LIMIT_US


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """From command to newton metre.

    Attributes
    ----------
    route : str
        In words; "" where nothing is calibrated.
    n_m_per_command : tuple of 3 floats
        Torque per unit of normalised command [N m], mean over the flight; NaN where it is not known.
    relative_sigma : tuple of 3 floats
        Relative standard deviation of that; NaN where it is not known.
    max_thrust_n : float
        Thrust of one rotor at full command and full battery [N]; in air of sea level where the
        density is logged, else in that of the flight.
    torque_to_thrust_m : float
        Drag torque over thrust [m].
    mass_kg, arm_length_m : float
        As given; for the check of the inertia against m r^2.
    second_opinion : float
        Thrust by the next best route (hover, or a parameter) over that taken [-]; NaN where there is none.
    """

    route: str = ""
    n_m_per_command: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    relative_sigma: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    max_thrust_n: float = math.nan
    torque_to_thrust_m: float = math.nan
    mass_kg: float = math.nan
    arm_length_m: float = math.nan
    second_opinion: float = math.nan

    @property
    def known(self) -> tuple[bool, bool, bool]:
        """Which of L, M, N are known in N m."""
        roll, pitch, yaw = (math.isfinite(value) for value in self.n_m_per_command)
        return roll, pitch, yaw


class HeldScale(StrEnum):
    """What stays the same of a thrust curve, whatever its expo: by this its scale is known."""

    SLOPE = "slope"
    """A unit of command is what it does at the thrust of the flight."""
    WEIGHT = "weight"
    """The mean thrust carries the vehicle."""
    FULL = "full"
    """The thrust at full throttle is given."""
    COMMAND = "command"
    """A unit of torque is, by least squares over the flight, one of command."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AssumedExpo:
    """The expo with which the torque was rebuilt, the parameter that says so, and what fixes the scale.

    ``half_width`` is how far it may be off (95 %), 0 where nothing is known before the flight is asked;
    ``parameter`` is empty where none says so; ``slope_by_expo`` is the relative change of thrust per command
    by the expo, by axis, where the command holds the scale; ``rotor_lag_s`` is the range in which measured
    speeds of the rotors say that their lag lies.
    """

    value: float
    parameter: str
    held: HeldScale = HeldScale.SLOPE
    half_width: float = 0.0
    slope_by_expo: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotor_lag_s: tuple[float, float] = (0.0, math.inf)

    @property
    def lag_is_measured(self) -> bool:
        """Whether the speeds of the rotors tell their lag."""
        return math.isfinite(self.rotor_lag_s[1])

    @property
    def mean_slope(self) -> float:
        """Mean of ``slope_by_expo``, which the scale of the thrust takes; the rest is of each axis."""
        return sum(self.slope_by_expo) / len(self.slope_by_expo)

    @property
    def own_slopes(self) -> FloatArray:
        """What is left of ``slope_by_expo`` beside its mean; shape (3,)."""
        return np.array(self.slope_by_expo) - self.mean_slope


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueComparison:
    """Two measurements of the torque, fitted alike and compared on validation data.

    Attributes
    ----------
    used, other : str
        Their sources.
    takes_preferred : bool
        Whether the one that is used is the one that would be without a comparison.
    decided : bool
        Whether validation data tell which of them predicts the flight better.
    effectiveness_ratio : mapping of str to float
        By axis, the effectiveness that belongs to the other over that of the one used.
    unexplained, unexplained_by_other : mapping of str to float
        By axis, fraction of the squared acceleration in validation data that is not predicted.
    differ : tuple of str
        Axes whose effectiveness differs by more than both intervals.
    """

    used: str
    other: str
    takes_preferred: bool
    decided: bool
    effectiveness_ratio: Mapping[str, float]
    unexplained: Mapping[str, float]
    unexplained_by_other: Mapping[str, float]
    differ: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TorqueModel:
    """The airframe as it is understood, and what its outputs say about torque.

    Attributes
    ----------
    frame : str
        In words, "" where it is not known.
    frame_source : str
        The parameters or the file that say so.
    position : ndarray, shape (n_rotors, 3)
        FRD from the centre of mass, in ``position_unit``.
    position_unit : str
        "m", or "arm length" where only the shape is known.
    spin : ndarray, shape (n_rotors,)
        +1 counter-clockwise from above, -1 clockwise, 0 unknown or none.
    allocation : ndarray, shape (n_rotors, 4)
        Fraction of thrust per unit of roll, pitch, yaw command and throttle [1].
    channels : tuple of int
        Output channel of each motor, counted from 1; empty where outputs are logged per motor.
    channel_source : str
        What says so.
    calibration : Calibration
    output_range_us : tuple of (lowest, highest) ndarray, each shape (n_rotors,), or None
        Pulse widths between which each motor is driven in flight; None where outputs come as fractions, or
        the parameters do not tell.
    check : MixerCheck, optional
    saturated_fraction : tuple of 3 floats
        Fraction of flown samples in which the axis did not get what was commanded; NaN where unknown.
    rotor_speed : str
        What the ESCs' speeds turned out to be, "" where there are none.
    comparison : TorqueComparison, optional
        None unless the flight chose between two sources of the torque.
    remarks : tuple of str
        What had to be decided or refused.
    refused : tuple of str
        Of these, which parameters look like a calibration but are not used as one, and why.
    needs : tuple of str
        What to pass with --vehicle to learn more.
    """

    frame: str = ""
    frame_source: str = ""
    position: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    position_unit: str = "arm length"
    spin: FloatArray = field(default_factory=lambda: np.zeros(0))
    allocation: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    channels: tuple[int, ...] = ()
    channel_source: str = ""
    calibration: Calibration = field(default_factory=Calibration)
    output_range_us: tuple[FloatArray, FloatArray] | None = None
    check: MixerCheck | None = None
    saturated_fraction: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    rotor_speed: str = ""
    comparison: TorqueComparison | None = None
    remarks: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()

    @property
    def n_rotors(self) -> int:
        """Number of rotors, 0 where the frame is not known."""
        return int(self.spin.shape[0])
