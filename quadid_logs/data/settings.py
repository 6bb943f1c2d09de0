"""The settings of an analysis: one object for each stage; each threshold has its reason."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from quadid_logs.errors import SettingsError

STRUCTURES = ("rigid-body", "damped", "quadrotor-6", "linear-9")


def _check_at_least(name: str, value: float, lowest: float) -> None:
    if not (math.isfinite(value) and value >= lowest):
        raise SettingsError(f"{name} is {value}, but must be at least {lowest:g}.")


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignSettings:
    """The part of the log to use [s], and the sample rate to resample it to [Hz].

    Examples
    --------
    >>> from quadid_logs import AlignSettings, Settings
    >>> Settings(align=AlignSettings(start_s=20.0, sample_rate_hz=100.0)).align.start_s
    20.0
    """

    start_s: float = -math.inf
    end_s: float = math.inf
    """Part of the log to analyze, on the log's clock [s]."""
    sample_rate_hz: float = 0.0
    """Rate to resample to [Hz]; 0 takes that of the torque series, at most 400 Hz."""

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
    """Structure, windows and frequency band of the fit.

    Examples
    --------
    >>> from quadid_logs import IdentifySettings, Settings
    >>> Settings(identify=IdentifySettings(structure="damped", smoothing_hz=8.0)).identify.structure
    'damped'
    """

    structure: str = ""
    """Structure to recommend; "" selects it by the error on validation data."""
    window: int = 0
    """Samples per window of the published structures; 0 takes as many as there are unknowns."""
    stride: int = 0
    """Samples between windows; 0 takes every window, as published."""
    smoothing_hz: float = 0.0
    """Upper edge of the band [Hz]: the cut-off of the filter on target and regressors. 0 selects both edges
    from the measured response."""
    high_pass_hz: float = 0.3
    """Lower edge of the band [Hz]. Below it, gusts and drag move the vehicle. They bias effectiveness by
    -17 % and damping by -50 % in stick flights; with this edge, by less than 1 % and 25 %. At 1 Hz, the slow
    yaw axis would lose half of its information."""
    most_samples: int = 480_000
    """Largest number of samples: twenty minutes at 400 Hz. Of a longer flight, the minutes with most motion
    are used. They contain nearly all information, and sensor errors then dominate the interval."""

    def __post_init__(self) -> None:
        if self.structure and self.structure not in STRUCTURES:
            raise SettingsError(
                f"There is no structure {self.structure!r}.", hint=f"Choose one of {', '.join(STRUCTURES)}."
            )
        _check_at_least("window", self.window, 0)
        _check_at_least("stride", self.stride, 0)


def in_band(band_hz: tuple[float, float] | None, settings: IdentifySettings) -> IdentifySettings:
    """Return settings with a user-defined frequency band of the fit.

    Parameters
    ----------
    band_hz : (low, high) or None
        Edges of the band [Hz]; None selects the band from the log.
    settings : IdentifySettings

    Returns
    -------
    IdentifySettings

    Raises
    ------
    SettingsError
        Unless 0 < low < high.
    """
    if band_hz is None:
        return settings
    low_hz, high_hz = band_hz
    if not 0.0 < low_hz < high_hz < math.inf:
        raise SettingsError(
            f"{low_hz:g} to {high_hz:g} Hz is not a possible band.",
            hint="Give two frequencies above 0, the lower one first, such as --band 1 8.",
        )
    return replace(settings, high_pass_hz=low_hz, smoothing_hz=high_hz)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of one analysis, by stage.

    Examples
    --------
    >>> from quadid_logs import AlignSettings, Settings
    >>> Settings(align=AlignSettings(start_s=20.0, end_s=80.0)).align.end_s
    80.0
    """

    system: int = 0
    """MAVLink system id to analyze; 0 chooses the autopilot with most messages."""
    log: int = 0
    """Which log of a file that holds several, from 1; 0 takes the only one."""
    align: AlignSettings = field(default_factory=AlignSettings)
    identify: IdentifySettings = field(default_factory=IdentifySettings)

    def __post_init__(self) -> None:
        _check_at_least("system", self.system, 0)
        _check_at_least("log", self.log, 0)
