"""Which frame an ArduPilot log describes: motors and outputs by its parameters."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

import numpy as np

from quadid_logs.actuation.airframe import Airframe, Unknown
from quadid_logs.autopilots.ardupilot.frames import frame_geometry
from quadid_logs.data.log import FlightLog, whole_number
from quadid_logs.errors import ShapeError
from quadid_logs.vocabulary import MULTIROTOR, vehicle_words

#: SRV_Channel.h: k_motor1 to k_motor8 are 33 to 40, k_motor9 to k_motor12 are 82 to 85.
_MOTOR_FUNCTIONS: Final = {**{33 + i: i for i in range(8)}, **{82 + i: 8 + i for i in range(4)}}
_N_OUTPUTS: Final = 32
#: What a motor's pulse width exceeds in flight, and by how much it changes at least [us].
_ALOFT_US: Final = 1150.0
_MOVES_US: Final = 20.0
#: A log with this many parameters of the simulator was made by it.
_SIMULATOR_PARAMETERS: Final = 50
#: SIM_Motor.cpp.
_SIMULATED_YAW: Final = (
    "The flight is from ArduPilot's simulator. Its yaw torque is torque_to_thrust_m times thrust times "
    "motor command (SIM_Motor.cpp), unlike that of a real propeller. N is computed in the same way."
)


def motor_prefix(parameters: Mapping[str, float]) -> str:
    """Return "Q_" for a QuadPlane, whose lifting motors have parameters of their own, else ""."""
    return "Q_" if parameters.get("Q_ENABLE", 0.0) > 0.0 and "Q_FRAME_CLASS" in parameters else ""


def find_airframe(log: FlightLog) -> Airframe | Unknown:
    """Read FRAME_CLASS and FRAME_TYPE; FRAME with the number of motors before 3.5."""
    if log.vehicle_type not in (MULTIROTOR, "vtol", "unknown"):
        # A rover has a FRAME_CLASS, too, of which 1 is no quad.
        return Unknown(remark=f"The rotors of {vehicle_words(log.vehicle_type)} are not modelled.")
    prefix = motor_prefix(log.parameters)
    number = log.parameters.get(f"{prefix}FRAME_CLASS")
    if number is not None:
        key = _whole(number), _whole(log.parameters.get(f"{prefix}FRAME_TYPE", 1.0))
        return _frame(log, key, f"{prefix}FRAME_CLASS {key[0]}, {prefix}FRAME_TYPE {key[1]}")
    if "FRAME" not in log.parameters:
        return Unknown(remark="The log holds no parameter that names the frame.")
    frame_type = _whole(log.parameters["FRAME"])
    frame_class, why = _old_class(log, frame_type)
    if frame_class is None:
        return Unknown(remark=f"FRAME {frame_type} gives the layout, but {why}.")
    return _frame(log, (frame_class, frame_type), f"FRAME {frame_type}, {why}")


def _frame(log: FlightLog, key: tuple[int, int], source: str) -> Airframe | Unknown:
    """Return a frame of the table."""
    try:
        frame = frame_geometry(*key)
    except ShapeError:
        return Unknown(remark=f"{source} is not a frame with a known table of fixed rotors.")
    channels, channel_source = _channels(log.parameters, frame.n_rotors)
    simulated = sum(name.startswith("SIM_") for name in log.parameters) >= _SIMULATOR_PARAMETERS
    return Airframe(
        # A Y6 that names its kind, as Y6B, says it all.
        name=frame.name.removeprefix("y6 ") if frame.name.startswith("y6 y6") else frame.name,
        source=source,
        factors=np.column_stack([frame.mixer, np.ones(frame.n_rotors)]),
        position=frame.position,
        spin=frame.spin,
        channels=channels,
        channel_source=channel_source,
        yaw_with_command=simulated,
        yaw_remark=_SIMULATED_YAW if simulated else "",
    )


def _old_class(log: FlightLog, frame_type: int) -> tuple[int | None, str]:
    """Return FRAME_CLASS of a log that has FRAME only, and what says so."""
    if frame_type in (10, 11):
        return 5, "which is a Y6"
    words = log.frame.lower()
    for word, number in (
        ("octa-quad", 4), ("octaquad", 4), ("dodeca", 12), ("y6", 5), ("hexa", 2), ("octa", 3), ("quad", 1),
    ):  # fmt: skip
        if re.search(rf"\b{word}", words):
            return number, f'and the log calls it "{log.frame}"'
    # The leading output channels that behave like motors.
    motors, outputs = 0, next(iter(log.candidates("output_pwm")), None)
    if outputs is not None and outputs.n_samples:
        low, high = np.percentile(np.nan_to_num(outputs.values), (5.0, 95.0), axis=0)
        moves = (high > _ALOFT_US) & (high - low > _MOVES_US)
        motors = int(np.argmin(np.append(moves, False)))
    if "eight" in words or motors == 8:
        return None, "eight motors may be an octa or an octa-quad"
    if "six" in words or motors == 6:
        return None, "six motors may be a hexa or a Y6"
    if motors == 4 or "four" in words:
        return 1, "and four outputs change"
    return None, "the number of motors is unknown"


def _channels(parameters: Mapping[str, float], n_rotors: int) -> tuple[tuple[int, ...], str]:
    """Return the output channel of each motor from SERVOn_FUNCTION, else motor n on output n."""
    found: dict[int, int] = {}
    for output in range(1, _N_OUTPUTS + 1):
        motor = _MOTOR_FUNCTIONS.get(_whole(parameters.get(f"SERVO{output}_FUNCTION", 0.0)))
        if motor is not None:
            found.setdefault(motor, output)
    if all(motor in found for motor in range(n_rotors)):
        return tuple(found[motor] for motor in range(n_rotors)), "SERVOn_FUNCTION"
    if any(name.startswith("SERVO") and name.endswith("_FUNCTION") for name in parameters):
        missing = ", ".join(str(motor + 1) for motor in range(n_rotors) if motor not in found)
        return (), f"SERVOn_FUNCTION assigns no output to motor {missing}"
    return tuple(range(1, n_rotors + 1)), "motor n on output n, as before firmware 3.5"


def _whole(value: float) -> int:
    """Round a parameter to its integer meaning; -1 where it has none."""
    return whole_number(value, otherwise=-1)
