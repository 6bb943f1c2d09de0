"""Which airframe the log describes: frame, motors, outputs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import FlightLog
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.errors import ShapeError
from quadid_logs.maths.frames import frame_geometry, normalised_allocation, torque_matrix

#: SRV_Channel.h: k_motor1 to k_motor8 are 33 to 40, k_motor9 to k_motor12 are 82 to 85.
_MOTOR_FUNCTIONS: Final = {**{33 + i: i for i in range(8)}, **{82 + i: 8 + i for i in range(4)}}
_N_OUTPUTS: Final = 32
#: What a motor's pulse width exceeds in flight, and by how much it changes at least [us].
_FLYING_US: Final = 1150.0
_MOVES_US: Final = 20.0
#: control_allocator/module.yaml: the defaults of CA_ROTORn_CT, CA_ROTORn_KM.
_DEFAULT_CT, _DEFAULT_KM = 6.5, 0.05
_MOST_ROTORS: Final = 12
#: No multirotor that anybody logs has longer arms [m].
_LONGEST_ARM_M: Final = 5.0
#: A rotor that leans further than this from the vertical is no lifting rotor of a multirotor.
_UPRIGHT: Final = 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Airframe:
    """Geometry and mixing of a multirotor.

    Attributes
    ----------
    name, source : str
        In words, and what says so.
    factors : ndarray, shape (n_rotors, 4)
        Motor thrust per unit of roll, pitch, yaw and throttle command.
    position : ndarray, shape (n_rotors, 3)
        FRD, in metres if ``in_metres``, else the longest arm is 1.
    spin : ndarray, shape (n_rotors,)
        +1 counter-clockwise from above, -1 clockwise.
    channels : tuple of int
        Output channel of each motor, from 1; empty if outputs come per motor.
    max_thrust_n, torque_to_thrust_m : float
        From parameters that are not untouched defaults; NaN otherwise.
    """

    name: str
    source: str
    factors: FloatArray
    position: FloatArray
    spin: FloatArray
    in_metres: bool = False
    channels: tuple[int, ...] = ()
    channel_source: str = ""
    max_thrust_n: float = float("nan")
    torque_to_thrust_m: float = float("nan")
    remarks: tuple[str, ...] = ()

    @property
    def n_rotors(self) -> int:
        """Number of motors."""
        return int(self.spin.shape[0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """Why the airframe is not known, and what to pass with --vehicle."""

    remark: str
    need: str


#: Enough to rebuild nothing, but to draw and to calibrate.
_NEED_ROTORS: Final = "[[rotor]] tables with position_m and spin of every motor, in the order of the motors"


def find_airframe(log: FlightLog, vehicle: Vehicle | None) -> Airframe | Unknown:
    """Tell the airframe from the vehicle file and the log's parameters.

    Parameters
    ----------
    log : FlightLog
    vehicle : Vehicle or None
        Rotors given there win.

    Returns
    -------
    Airframe or Unknown
    """
    if log.autopilot == "px4":
        found = _px4(log.parameters)
    elif log.autopilot == "ardupilot":
        found = _ardupilot(log)
    else:
        found = Unknown(remark="The log names no autopilot, so no frame either.", need=_NEED_ROTORS)
    if vehicle is not None and vehicle.rotors:
        return _with_rotors(found, vehicle)
    return found


def motor_prefix(parameters: Mapping[str, float]) -> str:
    """Return "Q_" for a QuadPlane, whose lifting motors have parameters of their own, else ""."""
    return "Q_" if parameters.get("Q_ENABLE", 0.0) > 0.0 and "Q_FRAME_CLASS" in parameters else ""


def _ardupilot(log: FlightLog) -> Airframe | Unknown:
    """FRAME_CLASS and FRAME_TYPE; FRAME with the number of motors before 3.5."""
    prefix = motor_prefix(log.parameters)
    number = log.parameters.get(f"{prefix}FRAME_CLASS")
    if number is not None:
        key = _whole(number), _whole(log.parameters.get(f"{prefix}FRAME_TYPE", 1.0))
        source = f"{prefix}FRAME_CLASS {key[0]}, {prefix}FRAME_TYPE {key[1]}"
    else:
        frame_type = log.parameters.get("FRAME")
        if frame_type is None:
            return Unknown(remark="The log holds no parameter that names the frame.", need=_NEED_ROTORS)
        frame_class, why = _old_class(log, _whole(frame_type))
        if frame_class is None:
            return Unknown(
                remark=f"FRAME {_whole(frame_type)} gives the layout, but {why}.", need=_NEED_ROTORS
            )
        key, source = (frame_class, _whole(frame_type)), f"FRAME {_whole(frame_type)}, {why}"
    try:
        frame = frame_geometry(*key)
    except ShapeError:
        return Unknown(remark=f"{source} is no frame with fixed rotors of a known table.", need=_NEED_ROTORS)
    channels, channel_source = _channels(log.parameters, frame.n_rotors)
    return Airframe(
        # A Y6 that names its kind, as Y6B, says it all.
        name=frame.name.removeprefix("y6 ") if frame.name.startswith("y6 y6") else frame.name,
        source=source,
        factors=np.column_stack([frame.mixer, np.ones(frame.n_rotors)]),
        position=frame.position,
        spin=frame.spin,
        channels=channels,
        channel_source=channel_source,
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
    motors = _moving_channels(log)
    if "eight" in words or motors == 8:
        return None, "eight motors may be an octa or an octa-quad"
    if "six" in words or motors == 6:
        return None, "six motors may be a hexa or a Y6"
    if motors == 4 or "four" in words:
        return 1, "and four outputs move"
    return None, "nothing tells the number of motors"


def _moving_channels(log: FlightLog) -> int:
    """Count the leading output channels that behave like motors."""
    outputs = next(iter(log.candidates("output_pwm")), None)
    if outputs is None or not outputs.n_samples:
        return 0
    values = np.nan_to_num(outputs.values)
    high, low = np.percentile(values, 95.0, axis=0), np.percentile(values, 5.0, axis=0)
    motor = (high > _FLYING_US) & (high - low > _MOVES_US)
    return int(np.argmin(np.append(motor, False)))


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


def _px4(parameters: Mapping[str, float]) -> Airframe | Unknown:
    """CA_ROTORn_*; before 1.13 the geometry was in a mixer file that no log holds."""
    count = _whole(parameters.get("CA_ROTOR_COUNT", 0.0))
    if count <= 0:
        airframe = _whole(parameters.get("SYS_AUTOSTART", 0.0))
        return _px4_legacy(airframe)
    rotors = [_ca_rotor(parameters, i) for i in range(min(count, _MOST_ROTORS))]
    axis = np.array([rotor[3] for rotor in rotors])
    if not (np.isfinite(axis).all() and (-axis[:, 2] > _UPRIGHT * np.linalg.norm(axis, axis=1)).all()):
        return Unknown(
            remark="Rotors that are not upright (CA_ROTORn_A*) are not modelled.", need=_NEED_ROTORS
        )
    position = np.array([rotor[0] for rotor in rotors])
    thrust, ratio = np.array([rotor[1] for rotor in rotors]), np.array([rotor[2] for rotor in rotors])
    if not (np.isfinite(position).all() and np.isfinite(thrust).all() and np.isfinite(ratio).all()):
        return Unknown(remark="CA_ROTOR* holds values that are not finite.", need=_NEED_ROTORS)
    effectiveness = np.vstack([torque_matrix(position, np.sign(ratio), 1.0), -np.ones(len(rotors))])
    effectiveness[2] = ratio
    effectiveness = effectiveness * thrust
    if np.linalg.matrix_rank(effectiveness) < 4:
        return Unknown(
            remark="CA_ROTOR* describes rotors that cannot turn the vehicle about all axes.",
            need=_NEED_ROTORS,
        )
    placeholder, remarks = _placeholders(position, thrust, ratio)
    reach = float(np.hypot(position[:, 0], position[:, 1]).max())
    return Airframe(
        name=f"{len(rotors)} rotors",
        source="CA_ROTORn_PX, PY, KM",
        factors=normalised_allocation(effectiveness),
        position=position / reach if placeholder[0] else position,
        spin=np.sign(ratio),
        in_metres=not placeholder[0],
        max_thrust_n=float("nan") if placeholder[1] else float(thrust.mean()),
        torque_to_thrust_m=float("nan") if placeholder[2] else float(np.abs(ratio).mean()),
        remarks=remarks,
    )


def _ca_rotor(parameters: Mapping[str, float], number: int) -> tuple[list[float], float, float, list[float]]:
    """Return position, thrust coefficient, moment ratio and axis of one rotor, defaults where not logged."""
    prefix = f"CA_ROTOR{number}_"
    position = [parameters.get(f"{prefix}P{axis}", 0.0) for axis in "XYZ"]
    axis = [parameters.get(f"{prefix}A{name}", -1.0 if name == "Z" else 0.0) for name in "XYZ"]
    return (
        position,
        parameters.get(f"{prefix}CT", _DEFAULT_CT),
        parameters.get(f"{prefix}KM", _DEFAULT_KM),
        axis,
    )


def _placeholders(
    position: FloatArray, thrust: FloatArray, ratio: FloatArray
) -> tuple[tuple[bool, bool, bool], tuple[str, ...]]:
    """Return which of arms, thrust and moment ratio are not meant in physical units, and the words for it."""
    arms = np.hypot(position[:, 0], position[:, 1])
    on_grid = bool((np.isclose(np.abs(position[:, :2]), 1.0) | (position[:, :2] == 0.0)).all())
    no_arms = on_grid or float(arms.max()) > _LONGEST_ARM_M
    no_thrust = bool(np.isclose(thrust, _DEFAULT_CT).all()) or bool((thrust <= 0.0).any())
    no_ratio = bool(np.isclose(np.abs(ratio), _DEFAULT_KM).all())
    refused = [
        text
        for is_default, text in (
            (no_arms, "arms of 1 m (CA_ROTORn_PX, PY)"),
            (no_thrust, f"a thrust of {_DEFAULT_CT} (CA_ROTORn_CT)"),
            (no_ratio, f"a torque-to-thrust ratio of {_DEFAULT_KM} (CA_ROTORn_KM)"),
        )
        if is_default
    ]
    remark = f"Not used as calibration, because they are untouched defaults: {', '.join(refused)}."
    return (no_arms, no_thrust, no_ratio), (remark,) if refused else ()


#: ROMFS/px4fmu_common/init.d/airframes up to 1.13: the mixers quad_x and quad_w differ in arm angles only.
_PX4_QUAD_X: Final = frozenset({10016, 10020, *range(4001, 4100)})
_PX4_QUAD_PLUS: Final = range(5001, 5100)
_PX4_HEXA_X, _PX4_HEXA_PLUS = range(6001, 6100), range(7001, 7100)
_PX4_OCTA_X, _PX4_OCTA_PLUS = range(8001, 8100), range(9001, 9100)
_PX4_OCTO_COAX: Final = range(12001, 12100)


def _px4_legacy(airframe: int) -> Airframe | Unknown:
    """Draw a legacy airframe by its number; the mixer's scales are in a file that no log holds."""
    for numbers, key in (
        (_PX4_QUAD_X, (1, 1)), (_PX4_QUAD_PLUS, (1, 0)), (_PX4_HEXA_X, (2, 1)), (_PX4_HEXA_PLUS, (2, 0)),
        (_PX4_OCTA_X, (3, 1)), (_PX4_OCTA_PLUS, (3, 0)), (_PX4_OCTO_COAX, (4, 1)),
    ):  # fmt: skip
        if airframe in numbers:
            return _px4_named(airframe, key)
    return Unknown(
        remark=f"Firmware before 1.13 keeps the geometry in a mixer file; airframe {airframe} names none "
        "that is known here.",
        need=_NEED_ROTORS,
    )


def _px4_named(airframe: int, key: tuple[int, int]) -> Airframe:
    """Return the shape of a legacy airframe, motors numbered as in ArduPilot's table (PX4 took it over)."""
    frame = frame_geometry(*key)
    effectiveness = np.vstack([torque_matrix(frame.position, frame.spin, 0.05), -np.ones(frame.n_rotors)])
    return Airframe(
        name=frame.name,
        source=f"SYS_AUTOSTART {airframe}",
        factors=normalised_allocation(effectiveness),
        position=frame.position,
        spin=frame.spin,
        channels=tuple(range(1, frame.n_rotors + 1)),
        channel_source="motor n on output n, as the mixer files before 1.13 have it",
        remarks=(
            "The arms are those of a symmetric frame: before 1.13 the real geometry is in a mixer file "
            "that no log holds.",
        ),
    )


def _with_rotors(found: Airframe | Unknown, vehicle: Vehicle) -> Airframe | Unknown:
    """Take positions and spin from the vehicle file, mixing from the log if the number fits."""
    position = np.array([rotor.position_m for rotor in vehicle.rotors], dtype=np.float64)
    spin = np.array([1.0 if rotor.spin == "ccw" else -1.0 for rotor in vehicle.rotors])
    if isinstance(found, Airframe) and found.n_rotors != len(spin):
        return Unknown(
            remark=f"The vehicle file has {len(spin)} rotors, the log says {found.name} ({found.source}).",
            need=f"{found.n_rotors} [[rotor]] tables, in the order of the motors",
        )
    if isinstance(found, Airframe):
        return Airframe(
            name=found.name,
            source=f"vehicle file; {found.source}",
            factors=found.factors,
            position=position,
            spin=spin,
            in_metres=True,
            channels=found.channels,
            channel_source=found.channel_source,
            max_thrust_n=found.max_thrust_n,
            torque_to_thrust_m=found.torque_to_thrust_m,
            remarks=found.remarks,
        )
    effectiveness = np.vstack([torque_matrix(position, spin, 0.05), -np.ones(len(spin))])
    return Airframe(
        name=f"{len(spin)} rotors",
        source="vehicle file",
        factors=normalised_allocation(effectiveness),
        position=position,
        spin=spin,
        in_metres=True,
        remarks=(f"{found.remark} The mixing is unknown; the rotors of the vehicle file are only drawn.",),
    )


def _whole(value: float) -> int:
    """Round a parameter to its integer meaning; -1 where it has none."""
    return int(value) if np.isfinite(value) and abs(value) < 1e6 else -1
