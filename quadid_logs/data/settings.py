"""The settings of an analysis: one object per stage, each threshold with its reason."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from quadid_logs.errors import SettingsError

STRUCTURES = ("rigid-body", "damped", "quadrotor-6", "linear-9")


def _check_at_least(name: str, value: float, lowest: float) -> None:
    if not (math.isfinite(value) and value >= lowest):
        raise SettingsError(f"{name} is {value}, but must be at least {lowest:g}.")


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignSettings:
    """One clock, one period, segments."""

    start_s: float = -math.inf
    end_s: float = math.inf
    """Part of the log to analyze, on the log's clock."""
    sample_rate_hz: float = 0.0
    """Rate to resample to; 0 takes the rate of the torque series, at most `max_sample_rate_hz`."""
    max_sample_rate_hz: float = 400.0
    """The rigid body's content ends far below; loop rates above only add noise and time."""
    gap_periods: float = 3.0
    """A pause longer than this many periods stays a gap: interpolating over it invents data."""
    min_segment_s: float = 2.0
    """Shorter stretches hold no full cycle of the slowest motion that the model must explain."""
    clock_reset_s: float = 1.0
    """Logged rows are out of order by at most some 100 ms; time falling by more is a reboot."""
    clock_jump_s: float = 3600.0
    """A longer pause than any battery lasts is a clock that was set, not a flight."""
    outlier_stamp_s: float = 5.0
    """A single stamp this far from both its neighbours in the file is damaged."""

    def __post_init__(self) -> None:
        if not self.start_s < self.end_s:
            raise SettingsError(
                f"The part of the log to analyze is empty: start {self.start_s:g} s, end {self.end_s:g} s.",
                hint="Give --start-s below --end-s.",
            )
        _check_at_least("sample_rate_hz", self.sample_rate_hz, 0.0)
        if self.sample_rate_hz and not 1.0 <= self.sample_rate_hz <= 10_000.0:
            raise SettingsError(
                f"A sample rate of {self.sample_rate_hz:g} Hz is out of range.", hint="Give 1 to 10000 Hz."
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifySettings:
    """Structure, windows, band and validation of the fit."""

    structure: str = ""
    """Structure to recommend; "" lets held-out error decide."""
    window: int = 0
    """Samples per window of the paper's structures; 0 takes as many as there are unknowns."""
    stride: int = 0
    """Samples between windows; 0 takes every window (the paper)."""
    min_rate_hz: float = 40.0
    """Below, a 50 ms motor lag and the rate loop (2 to 8 Hz) leave under five samples per
    cycle between them, and the torque between two samples is a guess: B comes out wrong by
    factors (measured: factor 2 at 11 Hz)."""
    smoothing_hz: float = 0.0
    """Cut-off of the one filter that target and regressors pass; 0 chooses it from the data."""
    high_pass_hz: float = 0.3
    """What is slower is left out of the fit: there gusts, and drag at the speed that a tilt brings,
    move the vehicle (measured: gain -17 %, damping -50 % on flights by stick; with this below 1 % and
    25 %). At 1 Hz yaw, which moves slowly, would lose half of its information."""
    most_samples: int = 480_000
    """Twenty minutes at 400 Hz: of a longer flight the minutes that move most are taken. They tell
    nearly all that there is to tell, and the interval is that of the sensors by then."""
    held_out_fraction: float = 0.3
    """Share of the flight that no fit sees; taken in blocks, never shuffled."""
    held_out_block_s: float = 5.0
    """Longer than the memory of the dynamics (under 1 s), short enough for both
    sets to see all manoeuvres."""
    horizons_s: tuple[float, ...] = (0.1, 0.2, 0.5)
    max_delay_s: float = 0.06
    """Loop, filter and radio-free output delay of known autopilots stay below 30 ms; twice that."""
    max_lag_s: float = 0.25
    """Published motor lags reach 80 ms; three times that."""
    min_rate_rms_deg_s: float = 2.0
    """A vehicle that hovers by itself turns at 1 to 2 deg/s rms; a manoeuvre must stand above that."""
    min_signal_to_noise: float = 3.0
    """Explained over unexplained acceleration variance in the fitted band: R2 of 0.75."""
    min_simulated_r2: float = 0.0
    """Rates simulated over a held-out block from its torque alone must beat a constant. Where
    slow disturbances move the vehicle, the controller's answer to them is all the torque there
    is, the one-step fit stays good, and the gain is biased (measured: -9 to -41 % at R2 below 0)."""
    gyro_systematic: float = 0.01
    """Scale and cross-axis sensitivity of a MEMS gyro are specified to 1 to 2 %, in 95 of 100 parts
    better than this share. No flight can tell: it is added in squares to every interval."""
    torque_systematic: float = 0.003
    """Thrust is not quite what mixer and thrust curve say, and the torque between the rows of a
    slow log is interpolated: no gain is known better than this share for that alone."""
    damping_systematic: float = 0.005
    """The damping by rotors goes with their speed, whose mean differs by half a per cent in a flight."""
    timing_systematic: float = 0.015
    """Stamps place torque against rate to no better than this share of a sample period: lag and delay
    are not known better."""
    lag_systematic: float = 0.003
    """A rotor is a first-order lag to some thousandths: its time constant goes with its speed."""
    max_relative_ci: float = 0.3
    """A coefficient whose 95 % interval is wider than this half-width is not identified."""

    def __post_init__(self) -> None:
        if self.structure and self.structure not in STRUCTURES:
            raise SettingsError(
                f"There is no structure {self.structure!r}.", hint=f"Choose one of {', '.join(STRUCTURES)}."
            )
        _check_at_least("window", self.window, 0)
        _check_at_least("stride", self.stride, 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnoseSettings:
    """When a result is worth a warning."""

    caution_rate_hz: float = 90.0
    """Between `min_rate_hz` and this, lag and gain can only be told apart on calm data."""
    min_flight_s: float = 10.0
    """Twenty fits of half a second: below, held-out validation says nothing."""
    caution_signal_to_noise: float = 9.0
    """R2 of 0.9."""
    caution_simulated_r2: float = 0.7
    """Wind of 8 m/s leaves 0.4 to 0.9 at a bias below 1 %: below this it is worth a warning."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of one analysis, by stage."""

    system: int = 0
    """MAVLink system id to analyze; 0 chooses the autopilot with most messages."""
    align: AlignSettings = field(default_factory=AlignSettings)
    identify: IdentifySettings = field(default_factory=IdentifySettings)
    diagnose: DiagnoseSettings = field(default_factory=DiagnoseSettings)

    def __post_init__(self) -> None:
        _check_at_least("system", self.system, 0)
