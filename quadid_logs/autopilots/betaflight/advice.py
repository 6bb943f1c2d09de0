"""What to log, set and fly with Betaflight, by the version of the firmware."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from quadid_logs.autopilots.betaflight.chirp import SWEEP_SETTINGS
from quadid_logs.autopilots.betaflight.law import (
    GYRO_SCALED_SINCE,
    OLDEST_LAW,
    UNFILTERED_SINCE,
    loop_period_us,
)
from quadid_logs.autopilots.generic.advice import Advice, GainLine, Setting, Version, digits
from quadid_logs.data.log import whole_number
from quadid_logs.sentences import listed
from quadid_logs.vocabulary import AXES

#: The chirp flight mode is in builds since then, where it was chosen (USE_CHIRP).
_CHIRP_SINCE: Final[Version] = (2025, 12)
#: blackbox_sample_rate took the place of blackbox_p_ratio, frames in 32 ms, and fields could be left out; the
#: field eRPM came later.
_SAMPLE_RATE_SINCE: Final[Version] = (4, 3)
#: blackbox_p_ratio took the place of blackbox_rate_num and blackbox_rate_denom, one frame in so many loops.
_RATIO_SINCE: Final[Version] = (3, 2)
_RPM_SINCE: Final[Version] = (4, 5)
#: Rates have a tenth of a degree per second.
_HIGH_RESOLUTION_SINCE: Final[Version] = (4, 4)
#: What is wanted [us], and the parts of the loop's rate that blackbox_sample_rate can be.
_WANTED_US: Final = 1000.0
_SAMPLE_RATES: Final = (1, 2, 4, 8, 16)
_COMMON_LOOP_US: Final = 250.0
#: Sliders of the configurator that make gains from others, since 4.3, and what its modes are called.
SLIDERS: Final = "simplified_pids_mode"
_SLIDER_MODES: Final = ("OFF", "RP", "RPY")
_LEAVE_UNFILTERED: Final = (
    "Keep the unfiltered gyro among the logged fields: it shows the delay of all filters."
)
CHIRP, CHIRP_OFF = "chirp.txt", "chirp-off.txt"
#: flight/pid.c, resetPidProfile: amplitudes in deg/s, added to the rate set-point behind a lead-lag.
_CHIRP_DEFAULTS: Final[Mapping[str, float]] = MappingProxyType(
    {
        "chirp_amplitude_roll": 230,
        "chirp_amplitude_pitch": 230,
        "chirp_amplitude_yaw": 180,
        "chirp_frequency_start_deci_hz": 2,
        "chirp_frequency_end_deci_hz": 6000,
        "chirp_time_seconds": 20,
    }
)
#: The same of filters, by how the names of what they set begin; on or off.
_FILTER_SLIDERS: Final = {"gyro_l": "simplified_gyro_filter", "dterm_l": "simplified_dterm_filter"}
#: Ends of a range, whose names in a log's header are others than on the command line.
_RANGES: Final = {
    f"{header}[{place}]": f"{begin}_{end}_hz"
    for header, begin in (
        ("gyro_lpf1_dyn_hz", "gyro_lpf1_dyn"),
        ("dterm_lpf1_dyn_hz", "dterm_lpf1_dyn"),
        ("gyro_lowpass_dyn_hz", "dyn_lpf_gyro"),
        ("dterm_lowpass_dyn_hz", "dyn_lpf_dterm"),
    )
    for place, end in enumerate(("min", "max"))
}
_PROFILE: Final = (
    "First choose the PID profile that flew. The log does not name it: profile 0 is the first one.",
    "Paste this into the command line while disarmed.",
)


class BetaflightAdvice(Advice):
    """Blackbox rate, chirp mode, and the text of the command line."""

    remedies = MappingProxyType(
        {
            "QL306": (
                "For the structure linear-9 only: log the attitude with firmware 2025.12 or later, which "
                "has it among the logged fields."
            ),
            "QL401": (
                "Use a log with a flight of at least half a minute. If the file holds several logs, "
                "`quadid-log info LOG` lists them and --log N chooses one. If you did fly, fetch the whole "
                "file again."
            ),
            "QL604": "Keep profiles and gains as they are during the flight: no adjustments by a switch.",
            "QL613": (
                "Keep gyro, PID and set-points among the logged fields (blackbox_disable_gyro, "
                "blackbox_disable_pids and blackbox_disable_setpoint = OFF), and fly once more."
            ),
            "QL620": f"{_LEAVE_UNFILTERED} Firmware from 3.4 to 4.4 logs it if debug_mode = GYRO_SCALED.",
            "QL643": "Fly the whole flight in Acro mode, and tune from that flight.",
            "QL644": "Set blackbox_high_resolution = ON (4.4 and later).",
        }
    )
    excitation_parameters = SWEEP_SETTINGS
    # A gain of "rollPID" has a name of its own beside it; the voltage is that of the battery.
    not_set_by_hand = ("*[[]*", "vbatref")
    excitation_entry = "rate"
    excitation_by = "the CHIRP mode"
    #: chirp_lag_freq_hz and chirp_lead_freq_hz by default.
    excitation_lead_lag_hz = (3.0, 30.0)
    gyro_filter_parameter = "gyro_lpf1_static_hz"
    hover_mode = "Angle or Acro mode"
    plans_by_hand = True
    last_line = "save"
    before_setting = (
        "first run `diff all` on the command line and keep what it prints: pasted again, it restores every "
        "setting"
    )
    gain_loading = "Paste {} into the command line of the configurator"

    def remedy(self, code: str, version: Version | None) -> str:
        """As of `Advice.remedy`; of a known version, what it can log."""
        if version is not None and code == "QL620":
            if version >= UNFILTERED_SINCE:
                return _LEAVE_UNFILTERED
            if version >= GYRO_SCALED_SINCE:
                return "Set debug_mode = GYRO_SCALED: it shows the delay of all filters."
            return f"Update the firmware to 4.5 or later. {_LEAVE_UNFILTERED}"
        if version is not None and version < _SAMPLE_RATE_SINCE and code == "QL613":
            # No field could be left out: the rate is what is wrong.
            return ""
        if version is not None and code == "QL644":
            if version >= _HIGH_RESOLUTION_SINCE:
                return "Set blackbox_high_resolution = ON."
            return "Update the firmware to 4.4 or later, and set blackbox_high_resolution = ON."
        return super().remedy(code, version)

    def step_note(self, parameters: Mapping[str, float]) -> str:
        """Name what acts while a stick moves, and is in no loop."""
        at_work = {
            "feed-forward": any(parameters.get(f"f_{axis}", 0.0) > 0.0 for axis in AXES),
            "iterm relax": parameters.get("iterm_relax", 0.0) > 0.0,
        }
        named = [name for name, works in at_work.items() if works]
        if not named:
            return ""
        told = f"Computed for sticks at rest, without {listed(named)}"
        return f"{told}: the response to a stick in flight differs."

    def _logging(self, log_format: str, parameters: Mapping[str, float], version: Version | None) -> str:
        """Say how to log fast, with the speed of the rotors where the firmware logs it."""
        if version is not None and version < _RATIO_SINCE:
            loops = max(round(_WANTED_US / _period_us(parameters)), 1)
            return (
                f"On the command line set blackbox_rate_num = 1 and blackbox_rate_denom = {loops}, save, and "
                "fly again."
            )
        if version is not None and version < _SAMPLE_RATE_SINCE:
            return (
                "On the command line set blackbox_p_ratio = 32 (1 kHz) and blackbox_mode = NORMAL, save, "
                "and fly again."
            )
        told, speeds = "gyro, PID, set-points and motors", ""
        if version is None or version >= _RPM_SINCE:
            told = "gyro, PID, set-points, motors and RPM"
            speeds = "" if parameters.get("dshot_bidir") == 1.0 else "turn on bidirectional DShot, "
        period_us = _period_us(parameters)
        part = max(one for one in _SAMPLE_RATES if one == 1 or one * period_us <= _WANTED_US)
        logged, loop = (f"{1e3 / each:.3g}" for each in (part * period_us, period_us))
        sample_rate = f"blackbox_sample_rate = 1/{part} ({logged} kHz with a PID loop of {loop} kHz)"
        return (
            f"On the command line, set {sample_rate} and blackbox_mode = NORMAL. Keep {told} among the "
            f"logged fields, {speeds}save, and fly again."
        )

    def controller_note(self, version: Version | None) -> str:
        """Return that the law of old versions counts in other units."""
        if version is None or version >= OLDEST_LAW:
            return ""
        return (
            f"Update the firmware to {'.'.join(map(str, OLDEST_LAW))} or later: the rate controller of "
            f"{'.'.join(map(str, version))} is not modelled."
        )

    def excitation(self, axes: Sequence[str], version: Version | None) -> str:
        """Chirp mode where the firmware has it, else doublets by stick."""
        if version is not None and version < _CHIRP_SINCE:
            return super().excitation(axes, version)
        return (
            "Set debug_mode = CHIRP. In calm air, hover, switch the CHIRP mode on for chirp_time_seconds, "
            "and off again. Do this three times: the firmware moves roll, pitch and yaw in turn. If the "
            f"build has no CHIRP mode, {self._doublets(axes)}"
        )

    def excites(self, version: Version | None) -> bool:
        """By the chirp mode, which older firmware lacks."""
        return version is None or version >= _CHIRP_SINCE

    @property
    def excitation_step(self) -> str:
        """The chirp mode: whether a build has it, nothing tells before the flight."""
        since = ".".join(map(str, _CHIRP_SINCE))
        return (
            f"With a build that has CHIRP ({since} or later), the firmware can replace the doublets. Paste "
            f"{CHIRP} on the command line. Switch the CHIRP mode on six times for chirp_time_seconds, with "
            "a pause between. The firmware moves roll, pitch and yaw in turn, each twice in one log. "
            f"Afterwards paste {CHIRP_OFF}."
        )

    def excitation_files(
        self,
        excitations: Mapping[str, Mapping[str, float]],
        multisine: Mapping[str, Any],
        parameters: Mapping[str, float],
    ) -> dict[str, str]:
        """Return lines that set the chirp up, and lines that set it back."""
        if not excitations:
            return {}
        lowest = min(each["start_hz"] for each in excitations.values())
        highest = max(each["stop_hz"] for each in excitations.values())
        longest = max(each["record_s"] for each in excitations.values())
        # The amplitude of a chirp [deg/s], no larger than the motion that was planned.
        wanted = {
            **{
                f"chirp_amplitude_{axis}": max(int(math.degrees(each["magnitude"])), 1)
                for axis, each in excitations.items()
            },
            "chirp_frequency_start_deci_hz": max(int(10.0 * lowest), 1),
            "chirp_frequency_end_deci_hz": math.ceil(10.0 * highest),
            "chirp_time_seconds": math.ceil(longest),
        }
        before = {name: parameters.get(name, _CHIRP_DEFAULTS[name]) for name in wanted}
        return {
            CHIRP: command_line("The CHIRP mode moves all axes, twice", wanted.items(), "debug_mode = CHIRP"),
            CHIRP_OFF: command_line(
                "The chirp settings as they were, or the defaults", before.items(), "debug_mode = NONE"
            ),
        }

    def gain_text(
        self, heading: Sequence[str], gains: Sequence[GainLine], parameters: Mapping[str, float]
    ) -> str:
        """Say in which profile they are: each line changes the one that was chosen before."""
        named = [(comment, _RANGES.get(name, name), value) for comment, name, value in gains]
        return super().gain_text((*heading, *_PROFILE), named, parameters)

    def parameter_line(self, name: str, value: str, parameters: Mapping[str, float]) -> str:
        """Return a line for the command line."""
        return f"set {name} = {value}"

    def beside_gains(
        self, parameters: Mapping[str, float], changed: Collection[str] = (), *, back: bool = False
    ) -> tuple[GainLine, ...]:
        """Switch the sliders off, which would set the gains anew, and on again on the way back."""
        sliders = {SLIDERS: whole_number(parameters.get(SLIDERS))}
        for begin, slider in _FILTER_SLIDERS.items():
            if any(name.startswith(begin) for name in changed):
                sliders[slider] = whole_number(parameters.get(slider))
        used = {name: mode for name, mode in sliders.items() if 0 < mode < len(_SLIDER_MODES)}
        if not back:
            return tuple(
                ("the sliders would overwrite these values", name, _SLIDER_MODES[0]) for name in used
            )
        return tuple(
            ("as flown", name, _SLIDER_MODES[mode] if name == SLIDERS else "ON")
            for name, mode in used.items()
        )


def command_line(comment: str, settings: Iterable[Setting], *first: str) -> str:
    """Return lines for the command line that set, after what comes first, parameters and save them."""
    lines = (*first, *(f"{name} = {digits(value)}" for name, value in settings))
    return "\n".join((f"# {comment}", *(f"set {line}" for line in lines), "save")) + "\n"


def _period_us(parameters: Mapping[str, float]) -> float:
    """Return the loop's period of a log, or a common one [us]."""
    period_us = loop_period_us(parameters)
    return period_us if 0.0 < period_us <= _WANTED_US else _COMMON_LOOP_US


ADVICE: Final = BetaflightAdvice()
