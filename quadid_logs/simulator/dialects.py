"""A simulated flight as other firmware of the Blackbox family would have logged it: the truth is the same."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from quadid_logs.data.log import FlightLog

#: What old headers hold of sticks and voltage, by their names of today.
_OLD: Final = {
    **{f"rc_rates[{axis}]": 100.0 for axis in range(3)},
    **{f"rc_expo[{axis}]": 20.0 for axis in range(3)},
    **{f"rates[{axis}]": 70.0 for axis in range(3)},
    "rc_interpolation": 2.0,
    "vbatref": 168.0,
}
_TENTHS: Final = {"vbatcellvoltage[0]": 33.0, "vbatcellvoltage[1]": 35.0, "vbatcellvoltage[2]": 43.0}
#: Counts of the converter of a full battery of four cells.
_COUNTED: Final = {"vbatscale": 110.0, "vbatref": 1895.0}
#: Settings that came later.
_LATER: Final = ("blackbox_high_resolution", "thrust_linear", "vbat_sag_compensation", "dshot_bidir")
#: Lists of gains, which other firmware counts in other units.
_GAINS: Final = ("rollPID", "pitchPID", "yawPID")
#: Outputs of INAV are microseconds with every protocol.
_PULSES: Final = {"motorOutput[0]": 1000.0, "motorOutput[1]": 2000.0}
FIRMWARE: Final = {
    "betaflight-3": ("betaflight", "Betaflight v3.4.0 (a5ba01666) SITL"),
    "cleanflight": ("cleanflight", "Cleanflight bdaf8ec"),
    "inav": ("inav", "INAV v9.0.1 (d44f2cf6) SITL"),
}


def in_dialect(log: FlightLog, dialect: str) -> FlightLog:
    """Return a flight of a simulated Betaflight for the writer, as of other firmware.

    Parameters
    ----------
    log : FlightLog
        Of ``simulate(..., autopilot="betaflight")``.
    dialect : str
        "betaflight-3", whose log holds sticks and no set-points; "cleanflight" of 2016; "inav" of version 9.

    Returns
    -------
    FlightLog
        Without signals that the firmware does not log, without flight modes, gains and terms.

    Raises
    ------
    KeyError
        If it is none of them.
    """
    autopilot, firmware = FIRMWARE[dialect]
    left = {name: value for name, value in log.parameters.items() if name not in _LATER}
    settings = {name: value for name, value in left.items() if not name.startswith(_GAINS)}
    if dialect == "inav":
        settings |= _PULSES | {f"rates[{axis}]": 60.0 for axis in range(3)}
    else:
        settings |= _TENTHS | (_OLD if dialect == "betaflight-3" else _PULSES | _COUNTED)
    gone = {"rotor_speed", "stick"} if dialect == "inav" else {"rotor_speed", "stick", "attitude"}
    signals = {
        name: sources if dialect == "inav" else sources[:1]
        for name, sources in log.signals.items()
        if name not in gone
    }
    return replace(
        log,
        autopilot=autopilot,
        firmware=firmware,
        parameters=settings,
        signals=signals,
        controller_terms=(),
        modes=(),
    )
