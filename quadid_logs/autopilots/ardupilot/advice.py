"""What to log, set and fly with ArduCopter, by the version of the firmware."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from quadid_logs.autopilots.ardupilot.flight_script import SCRIPT, SWITCH, flight_script
from quadid_logs.autopilots.generic.advice import Advice, Setting, Version
from quadid_logs.commands import LOG, command
from quadid_logs.data.log import own_bits, whole_number
from quadid_logs.sentences import listed

#: ArduCopter/defines.h: bit 0 of LOG_BITMASK has been ATTITUDE_FAST since 2.x; what it logs has changed.
_ATTITUDE_FAST: Final = 1
_DEFAULT_LOG_BITMASK: Final = 176126
#: SCHED_LOOP_RATE of a multirotor unless it was set.
_LOOP_RATE_HZ: Final = 400.0
#: Rate of RATE [Hz] under ATTITUDE_FAST, from this version on (ArduCopter.pde and ArduCopter.cpp: ATT alone;
#: fifty_hz_logging_loop; twentyfive_hz_logging, still so in 3.5-dev; fourhundred_hz_logging).
_RATE_LOGGED: Final[tuple[tuple[Version, float], ...]] = (
    ((0,), 0.0),
    ((3, 3), 50.0),
    ((3, 4), 25.0),
    ((3, 6), float("inf")),
)
#: 8-bit boards had their last version before.
_NOT_ON_APM_SINCE: Final[Version] = (3, 3)
#: mode_systemid.cpp came with 4.0.
_SYSTEM_ID_SINCE: Final[Version] = (4, 0)
#: AC_PID.cpp has a filter each for set-point, error and D since then, before one for all.
_CONTROLLER_SINCE: Final[Version] = (4, 0)
#: mode_systemid.cpp, SID_AXIS: 10 mixer roll, 11 mixer pitch, 12 mixer yaw.
_SID_AXIS: Final[Mapping[str, int]] = MappingProxyType({"roll": 10, "pitch": 11, "yaw": 12})
#: Fraction of the mixer's range. Rolls and pitches a quadrotor by some 30 deg/s at 1 Hz and by little at
#: 8 Hz; yaw answers ten times less. Too small drowns in noise, too large meets the motors' limits.
_SID_MAGNITUDE: Final[Mapping[str, float]] = MappingProxyType({"roll": 0.05, "pitch": 0.05, "yaw": 0.15})
_SID_PARAMETERS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "magnitude": "SID_MAGNITUDE",
        "start_hz": "SID_F_START_HZ",
        "stop_hz": "SID_F_STOP_HZ",
        "fade_in_s": "SID_T_FADE_IN",
        "record_s": "SID_T_REC",
        "fade_out_s": "SID_T_FADE_OUT",
    }
)
#: Between two sweeps of the script: it rests, the mode waits, and it returns [s].
_SCRIPT_REST_S: Final = 4.3
#: How the script fades its sweeps in and out [s].
_FADES: Final[Mapping[str, float]] = MappingProxyType({"fade_in_s": 3.0, "fade_out_s": 1.0})
#: Bits of LOG_BACKEND_TYPE (AP_Logger.cpp, `var_info`).
_BACKEND, _CARD, _MAVLINK = "LOG_BACKEND_TYPE", 1, 2


class ArduPilotAdvice(Advice):
    """LOG_BITMASK, System ID mode, and files of NAME,VALUE."""

    remedies = MappingProxyType(
        {
            "QL104": (
                "Update the firmware to 4.0 or later: it stamps its rows and logs the rate controller's "
                "output. An 8-bit APM board cannot run it: its last firmware, 3.2, does not log that "
                "output."
            ),
            "QL307": "For the achieved torque, log RATE, RCOU and MOTB with a current firmware.",
            "QL620": (
                "Log what the notch of INS_HNTCH_MODE (INS_HNTC2_MODE) follows: ESC for mode 3, RPM for "
                "modes 2 and 5, FTN1 for mode 4 (FTN2 with several sources). Or fly once with mode 1, the "
                "throttle."
            ),
            "QL310": "Check AHRS_ORIENTATION. Check in the PM messages whether the main loop keeps up.",
        }
    )
    excitation_parameters = ("SID_AXIS", "SID_MAGNITUDE", "SID_F_START_HZ", "SID_F_STOP_HZ")
    logging_settings = (("LOG_BITMASK", float(_DEFAULT_LOG_BITMASK | _ATTITUDE_FAST)),)
    logging_bits = MappingProxyType({"LOG_BITMASK": _ATTITUDE_FAST})
    unknown_mask_note = (
        f"the default with bit 0 (ATTITUDE_FAST) added; if your value is not {_DEFAULT_LOG_BITMASK}, do not "
        "load the file, but add bit 0 to your value"
    )
    live_note = (
        "set LOG_BACKEND_TYPE = 3 (card and MAVLink) with live.param, and restart the vehicle; use a link "
        "of about 130 kB/s, such as USB or Wi-Fi; live-back.param is the way back"
    )
    # The calibrations of sensors and sticks, what is learned in flight, and the counters.
    not_set_by_hand = (
        *("STAT_*", "AHRS_TRIM_?", "MOT_THST_HOVER", "BARO*_GND_PRESS", "RC*_MIN", "RC*_MAX", "RC*_TRIM"),
        *("COMPASS_OFS*", "COMPASS_DIA*", "COMPASS_ODI*", "COMPASS_MOT*_?", "COMPASS_DEC"),
        *("INS_ACC*OFFS_?", "INS_ACC*SCAL_?", "INS_GYR*OFFS_?", "INS_*_CALTEMP"),
    )
    excitation_entry = "mixer"
    excitation_by = f"{SCRIPT} or System ID mode"
    gyro_filter_parameter = "INS_GYRO_FILTER"
    hover_mode = "Stabilize"
    parameter_suffix = ".param"

    def _logging(self, log_format: str, parameters: Mapping[str, float], version: Version | None) -> str:
        """Say what to do about LOG_BITMASK; a mask of 16 or 32 bits may be negative."""
        mask = whole_number(parameters.get("LOG_BITMASK"), _DEFAULT_LOG_BITMASK)
        is_set = bool(mask & _ATTITUDE_FAST)
        if limit := _logging_limit(version):
            keep = "keep" if is_set else "set"
            return f"{limit} Then {keep} bit 0 of LOG_BITMASK (ATTITUDE_FAST) and fly again."
        if is_set:
            return (
                f"LOG_BITMASK is {mask}, so bit 0 (ATTITUDE_FAST) is set and RATE is logged at the loop "
                "rate. If rows are missing, the card did not keep up: use a faster one, or log fewer "
                "message types."
            )
        loop = parameters.get("SCHED_LOOP_RATE", _LOOP_RATE_HZ)
        aim = f"to log RATE at the loop rate ({loop:g} Hz). Then fly again."
        if mask < 0 or own_bits(mask) is None:
            return f"Set bit 0 of LOG_BITMASK (ATTITUDE_FAST) in the ground station's list of bits, {aim}"
        known = "LOG_BITMASK" in parameters
        what = (
            "bit 0, ATTITUDE_FAST, added"
            if known
            else "the default with bit 0, ATTITUDE_FAST, added: keep other bits"
        )
        return f"Set LOG_BITMASK to {mask | _ATTITUDE_FAST} ({what}) {aim}"

    def live_files(self, parameters: Mapping[str, float]) -> dict[str, str]:
        """Return LOG_BACKEND_TYPE with the card and MAVLink; see `Advice.live_files`."""
        flown = whole_number(parameters.get(_BACKEND), _CARD)
        return {
            f"live{self.parameter_suffix}": self.parameter_text(
                "Log to the card and to MAVLink, to watch the flight; restart the vehicle afterwards",
                ((_BACKEND, float(flown | _CARD | _MAVLINK)),),
            ),
            f"live-back{self.parameter_suffix}": self.parameter_text(
                "Log as before, or to the card alone if the earlier setting was not known",
                ((_BACKEND, float(flown)),),
            ),
        }

    def excitation(self, axes: Sequence[str], version: Version | None) -> str:
        """Add what System ID mode does by itself, where the firmware has it."""
        by_stick = super().excitation(axes, version)
        if not self.sweep_magnitudes(version):
            return f"{by_stick} {_no_system_id(version)}"
        wanted = ("--axes", ",".join(axes), "-o", "plan", "--like", LOG)
        plan_command = command("plan", "--autopilot", "ardupilot", *wanted)
        return (
            f"{by_stick} Or let ArduCopter's System ID mode{'' if version else ' (4.0 and later)'} sweep "
            f"the axes. `{plan_command}` writes what to set, and what to read back before the flight."
        )

    def sweep_magnitudes(self, version: Version | None) -> Mapping[str, float]:
        """Return SID_MAGNITUDE by axis, nothing before System ID mode."""
        return {} if version is not None and version < _SYSTEM_ID_SINCE else _SID_MAGNITUDE

    def sweep_settings(self, axis: str, sweep: Mapping[str, float]) -> tuple[Setting, ...]:
        """Return the parameters SID_*, SID_AXIS first: it shows the others."""
        described = ((name, sweep[meaning]) for meaning, name in _SID_PARAMETERS.items())
        return (("SID_AXIS", float(_SID_AXIS[axis])), *described)

    def excitation_files(
        self,
        excitations: Mapping[str, Mapping[str, float]],
        multisine: Mapping[str, Any],
        parameters: Mapping[str, float],
    ) -> dict[str, str]:
        """Return the script that flies all sweeps in one flight."""
        if not excitations:
            return {}
        sweeps = [
            {
                "name": axis,
                "limit": each["most_magnitude"],
                **dict(self.sweep_settings(axis, {**_FADES, **each})),
            }
            for axis, each in excitations.items()
        ]
        return {SCRIPT: flight_script(sweeps, multisine)}

    def sweep_comment(self, axis: str) -> str:
        """Return the first line of the parameter file of an axis' sweep."""
        return (
            f"Sweep the {axis} axis. Load twice: the other SID_ parameters only appear after SID_AXIS is "
            "set. Check SID_MAGNITUDE"
        )

    def sweep_off(self) -> tuple[Setting, ...]:
        """Return SID_AXIS 0 alone: without an axis the mode does not start, and the others are hidden."""
        return (("SID_AXIS", 0.0),)

    def logging_needs_update(self, version: Version | None) -> bool:
        """No bit makes old firmware log RATE fast enough."""
        return bool(_logging_limit(version))

    def controller_note(self, version: Version | None) -> str:
        """Return that filters and gains had other parameters before FLTT, FLTE and FLTD."""
        if version is None or version >= _CONTROLLER_SINCE:
            return ""
        return (
            f"Update the firmware to {_dotted(_CONTROLLER_SINCE)} or later: the rate controller of "
            f"ArduCopter {_dotted(version)} is not modelled."
        )

    def version_notes(self, version: Version | None) -> tuple[str, ...]:
        """Return what is logged too slowly, and whether System ID mode is missing."""
        missing = "" if self.sweep_magnitudes(version) else _no_system_id(version)
        return tuple(note for note in (_logging_limit(version), missing) if note)

    def parameter_line(self, name: str, value: str, parameters: Mapping[str, float]) -> str:
        """Return NAME,VALUE."""
        return f"{name},{value}"

    def steps(self, axes: Sequence[str], sweeps: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
        """Return the steps of a flight with System ID mode, or by stick."""
        if not sweeps:
            return super().steps(axes, sweeps)
        return (
            f"Copy {SCRIPT} into APM/scripts on the card. Set SCR_ENABLE to 1, and RCx_OPTION of a free "
            f"switch to {SWITCH} (Scripting1). Restart the autopilot: the ground station then shows "
            "`excite: ready`.",
            "Take off, and hover in Stabilize at that height: the script does not start below 4 m. Leave "
            "the throttle stick where the vehicle hovers.",
            f"Turn the switch on. The script sweeps {listed(axes)} in one flight, for "
            f"{sum(each['record_s'] + _SCRIPT_REST_S for each in sweeps.values()):.0f} s. Hold position "
            "with small stick inputs.",
            "To end it at any time, turn the switch off or change the mode. The script ends by itself when "
            "it is done. It also ends if the vehicle tilts by more than 30 degrees, or if height, battery "
            "or radio leave their limits.",
            "Wait for `excite: parameters are as they were`, and land. A restart also restores every "
            "parameter.",
            "Set SCR_ENABLE back to its earlier value, and remove the script from the card.",
        )

    def steps_by_hand(
        self, axes: Sequence[str], sweeps: Mapping[str, Mapping[str, float]]
    ) -> tuple[str, ...]:
        """Return the steps of sweeps that are loaded one by one."""
        if not sweeps:
            return ()
        return (
            "Put System ID (mode 25) on a switch together with AltHold or Stabilize.",
            "SID_MAGNITUDE is here a fraction of full motor authority, and its default of 15 would flip "
            "the vehicle. Never switch to System ID before you have read it back.",
            "Load parameter files on the ground, disarmed. During the hover only a second person at the "
            "ground station may load one.",
            *(step for axis in axes for step in _axis_steps(axis, sweeps[axis])),
            "After the last landing, load sweep-off.param: it sets SID_AXIS back to 0.",
        )


def _axis_steps(axis: str, sweep: Mapping[str, float]) -> tuple[str, ...]:
    """Return how to load an axis' sweep, and how to fly it.

    SID_AXIS enables the group (AP_PARAM_FLAG_ENABLE): before it is set a ground station
    knows no other SID_*, and SID_MAGNITUDE keeps its default of 15.
    """
    name = axis.capitalize()
    return (
        f"{name}, load: load sweep-{axis}.param and refresh the parameters. Load the file A SECOND TIME: "
        "the other SID_ parameters only appear after SID_AXIS is set.",
        f"{name}, check: READ BACK that SID_AXIS is {_SID_AXIS[axis]} and SID_MAGNITUDE is "
        f"{sweep['magnitude']:g}. If either differs, do not fly the sweep.",
        f"{name}, fly: hover in Stabilize and switch to System ID, which flies like Stabilize. Hold "
        f"position with small stick inputs for {sweep['record_s']:g} s. Switch back when it says finished, "
        "and land. Leaving the mode stops the sweep at any time.",
    )


def _logging_limit(version: Version | None) -> str:
    """Say that no bit makes this firmware log RATE fast enough; "" where one does."""
    if version is None:
        return ""
    rate_hz = next(rate for since, rate in reversed(_RATE_LOGGED) if version >= since)
    if rate_hz == float("inf"):
        return ""
    what = f"logs RATE at {rate_hz:g} Hz at most" if rate_hz else "does not log the rate controller's output"
    # The branch that became 3.4 logged at 50 Hz for its first half.
    early = " (3.4-dev at 50 Hz)" if version == (3, 4) else ""
    apm = " (not possible on an 8-bit APM board: its last firmware, 3.2, does not log it)"
    board = apm if version < _NOT_ON_APM_SINCE else ""
    return (
        f"ArduCopter {_dotted(version)} {what}{early}, whatever LOG_BITMASK is. Update the firmware to 4.0 "
        f"or later{board}."
    )


def _no_system_id(version: Version | None) -> str:
    return (
        f"This is ArduCopter {_dotted(version or ())}: the System ID mode, which injects a sweep, needs 4.0 "
        "or later."
    )


def _dotted(version: Version) -> str:
    return ".".join(map(str, version))


ADVICE: Final = ArduPilotAdvice()
