"""THE table of canonical signals: name, columns, unit, frame and sign.

Body axes are FRD (x forward, y right, z down), Earth axes NED, attitude is
Euler 3-2-1 (yaw, pitch, roll), signs are right-handed, units are SI. A reader
turns a vendor's fields into these names; nothing behind the readers knows any
other name.
"""

from __future__ import annotations

from typing import Final, NamedTuple


class SignalSpec(NamedTuple):
    """What a canonical signal means.

    ``columns`` is empty where the number of columns depends on the vehicle
    (one per motor or output channel).
    """

    name: str
    columns: tuple[str, ...]
    symbols: tuple[str, ...]
    unit: str
    meaning: str


_SPECS = (
    SignalSpec(
        "body_rate",
        ("p_rad_s", "q_rad_s", "r_rad_s"),
        ("p", "q", "r"),
        "rad/s",
        "angular velocity of the body, in body axes; p>0 right side down, q>0 nose up, "
        "r>0 nose right; not the Euler rates",
    ),
    SignalSpec(
        "body_rate_setpoint",
        ("p_setpoint_rad_s", "q_setpoint_rad_s", "r_setpoint_rad_s"),
        ("p_sp", "q_sp", "r_sp"),
        "rad/s",
        "body rates that the rate controller was commanded",
    ),
    SignalSpec(
        "reference_rate",
        ("p_reference_rad_s", "q_reference_rad_s", "r_reference_rad_s"),
        ("p_ref", "q_ref", "r_ref"),
        "rad/s",
        "body rates of a planned trajectory, which do not depend on the motion of the vehicle",
    ),
    SignalSpec(
        "attitude",
        ("phi_rad", "theta_rad", "psi_rad"),
        ("phi", "theta", "psi"),
        "rad",
        "Euler 3-2-1 angles roll, pitch, yaw of the body relative to NED",
    ),
    SignalSpec(
        "attitude_setpoint",
        ("phi_setpoint_rad", "theta_setpoint_rad", "psi_setpoint_rad"),
        ("phi_sp", "theta_sp", "psi_sp"),
        "rad",
        "Euler 3-2-1 angles that the attitude controller was commanded",
    ),
    SignalSpec(
        "velocity",
        ("v_north_m_s", "v_east_m_s", "v_down_m_s"),
        ("v_N", "v_E", "v_D"),
        "m/s",
        "velocity over ground, in NED",
    ),
    SignalSpec(
        "torque_command",
        ("L_command", "M_command", "N_command"),
        ("L", "M", "N"),
        "1",
        "normalised roll, pitch and yaw torque on the scale of the autopilot's own command; not N m",
    ),
    SignalSpec(
        "torque_n_m",
        ("L_n_m", "M_n_m", "N_n_m"),
        ("L", "M", "N"),
        "N m",
        "roll, pitch and yaw torque about the centre of mass, in body axes",
    ),
    SignalSpec("throttle", ("throttle",), ("T",), "1", "collective thrust command, 0 to 1, up positive"),
    SignalSpec("thrust_n", ("thrust_n",), ("T",), "N", "collective thrust, up (-z) positive"),
    SignalSpec("motor_thrust", (), (), "1", "thrust command per motor, 0 to 1, before the thrust curve"),
    SignalSpec("output_pwm", (), (), "us", "pulse width per output channel (a channel is not a motor)"),
    SignalSpec("rotor_speed", (), (), "rad/s", "measured speed per rotor, unsigned"),
    SignalSpec(
        "specific_force",
        ("ax_m_s2", "ay_m_s2", "az_m_s2"),
        ("ax", "ay", "az"),
        "m/s^2",
        "accelerometer: non-gravitational acceleration in body axes (-9.8 on z at rest)",
    ),
    SignalSpec(
        "vibration",
        ("vibration_x_m_s2", "vibration_y_m_s2", "vibration_z_m_s2"),
        ("vx", "vy", "vz"),
        "m/s^2",
        "rms of the specific force above 5 Hz, as the autopilot measured it at the sensor's rate",
    ),
    SignalSpec(
        "vibration_level",
        ("vibration_level_m_s2",),
        ("v",),
        "m/s^2",
        "mean change of the specific force from sample to sample of the sensor",
    ),
    SignalSpec(
        "accelerometer_clips",
        (),
        (),
        "1",
        "number of samples at the end of the accelerometer's range since the start",
    ),
    SignalSpec(
        "gyro_samples",
        (),
        (),
        "rad/s",
        "samples of one gyro at its own rate, in body axes, perhaps in batches with pauses between them",
    ),
    SignalSpec("battery_voltage", ("battery_v",), ("V",), "V", "battery voltage"),
    SignalSpec(
        "battery_ratio",
        ("battery_ratio",),
        ("v",),
        "1",
        "filtered battery voltage divided by the full voltage, as the thrust compensation uses it",
    ),
    SignalSpec("lift_max", ("lift_max",), ("lift_max",), "1", "available lift relative to a full battery"),
    SignalSpec(
        "air_density_ratio", ("air_density_ratio",), ("rho",), "1", "air density divided by 1.225 kg/m^3"
    ),
    SignalSpec(
        "unallocated_torque",
        ("L_unallocated", "M_unallocated", "N_unallocated"),
        ("L", "M", "N"),
        "1",
        "normalised torque that the mixer could not give",
    ),
    SignalSpec(
        "torque_saturation",
        ("L_saturated", "M_saturated", "N_saturated"),
        ("L", "M", "N"),
        "1",
        "1 while the actuators could not give the command about this axis",
    ),
    SignalSpec(
        "throttle_limit",
        ("throttle_limit",),
        ("T_limit",),
        "1",
        "highest throttle that the mixer grants",
    ),
    SignalSpec(
        "throttle_average_max",
        ("throttle_average_max",),
        ("T_average_max",),
        "1",
        "highest mean throttle that the mixer may choose to make room for torque",
    ),
    SignalSpec("armed", ("armed",), ("armed",), "1", "1 while the motors are armed"),
    SignalSpec("landed", ("landed",), ("landed",), "1", "1 while the autopilot believes it stands on ground"),
    SignalSpec(
        "stick",
        ("roll_stick", "pitch_stick"),
        ("roll", "pitch"),
        "1",
        "position of the pilot's sticks, -1 to 1, with the signs of the body rates",
    ),
    SignalSpec("sysid_chirp", ("sysid_chirp",), ("chirp",), "1", "excitation injected by a system-ID mode"),
)

SIGNALS: Final[dict[str, SignalSpec]] = {spec.name: spec for spec in _SPECS}

#: The three axes, in the order of every 3-column array.
AXES: Final = ("roll", "pitch", "yaw")
RATE_SYMBOLS: Final = ("p", "q", "r")
TORQUE_SYMBOLS: Final = ("L", "M", "N")
ACCELERATION_SYMBOLS: Final = ("p_dot", "q_dot", "r_dot")
#: By axis: target and regressor of its on-axis gain, how the torque about it turns the vehicle about it.
ON_AXIS: Final = dict(zip(AXES, zip(ACCELERATION_SYMBOLS, TORQUE_SYMBOLS, strict=True), strict=True))

_WORDS: Final = {
    **{symbol: f"{axis} rate" for axis, symbol in zip(AXES, RATE_SYMBOLS, strict=True)},
    **{symbol: f"{axis} torque" for axis, symbol in zip(AXES, TORQUE_SYMBOLS, strict=True)},
    **{symbol: f"{axis} angle" for axis, symbol in zip(AXES, ("phi", "theta", "psi"), strict=True)},
    "1": "constant",
    "N*throttle": "yaw torque × throttle",
    "N_dot": "reaction of accelerating rotors",
    "u": "forward speed",
    "v": "sideways speed",
    "vx": "logged forward speed",
    "vy": "logged sideways speed",
    "vz": "logged downward speed",
    "cos(psi)": "wind along north",
    "sin(psi)": "wind along east",
}
_AXIS_OF: Final = {
    **dict(zip(ACCELERATION_SYMBOLS, AXES, strict=True)),
    **{f"{angle}_dot": f"{axis} angle" for axis, angle in zip(AXES, ("phi", "theta", "psi"), strict=True)},
}


def regressor_words(symbol: str) -> str:
    """Return what a column of the model is called.

    Returns
    -------
    str
        A symbol that nobody knows stays as it is.

    Examples
    --------
    >>> regressor_words("N"), regressor_words("qr"), regressor_words("pp")
    ('yaw torque', 'pitch rate × yaw rate', 'roll rate squared')
    """
    if symbol in _WORDS:
        return _WORDS[symbol]
    if len(symbol) == 2 and all(letter in RATE_SYMBOLS for letter in symbol):
        first, second = (_WORDS[letter] for letter in symbol)
        return f"{first} squared" if first == second else f"{first} × {second}"
    return symbol


def term_words(target: str, regressor: str) -> str:
    """Return what an element of A or B is called.

    Parameters
    ----------
    target, regressor : str
        Its row and its column, as "p_dot" and "N".

    Examples
    --------
    >>> term_words("p_dot", "L"), term_words("p_dot", "p"), term_words("p_dot", "N")
    ('roll effectiveness', 'roll damping', 'roll from yaw torque')
    >>> term_words("r_dot", "pq"), term_words("q_dot", "1")
    ('yaw from roll rate × pitch rate', 'pitch trim')
    """
    axis = _AXIS_OF.get(target, target)
    if (target, regressor) in zip(ACCELERATION_SYMBOLS, TORQUE_SYMBOLS, strict=True):
        return f"{axis} effectiveness"
    if (target, regressor) in zip(ACCELERATION_SYMBOLS, RATE_SYMBOLS, strict=True):
        return f"{axis} damping"
    return f"{axis} trim" if regressor == "1" else f"{axis} from {regressor_words(regressor)}"


def explained_words(r2: float) -> str:
    """Say how much of something a model explains, as in "explains ... of it".

    Parameters
    ----------
    r2 : float
        Coefficient of determination; below zero the mean does better than the model.
    """
    if not r2 > 0.0:
        return "nothing"
    return f"only {100.0 * r2:.0f} %" if r2 >= 0.005 else "less than 1 %"


#: Standard gravity (third General Conference on Weights and Measures, 1901; ISO 80000-3) [m/s^2].
GRAVITY_M_S2: Final = 9.80665

#: What a vehicle can be. Only a multirotor is analyzed.
MULTIROTOR: Final = "multirotor"
VEHICLE_TYPES: Final = (
    MULTIROTOR,
    "helicopter",
    "fixed-wing",
    "vtol",
    "rover",
    "boat",
    "submarine",
    "tracker",
    "unknown",
)
#: Why nothing of another vehicle is judged.
NOT_A_MULTIROTOR: Final = "this is not a multirotor"
_VEHICLE_WORDS: Final = {
    MULTIROTOR: "a multirotor",
    "helicopter": "a helicopter",
    "fixed-wing": "a fixed-wing aircraft",
    "vtol": "a VTOL aircraft",
    "rover": "a rover",
    "boat": "a boat",
    "submarine": "a submarine",
    "tracker": "an antenna tracker",
    "unknown": "a vehicle of unknown kind",
}


def vehicle_words(vehicle_type: str) -> str:
    """Return what a sentence calls a vehicle of one of `VEHICLE_TYPES`, or of a type that is none of them."""
    return _VEHICLE_WORDS.get(vehicle_type, "another vehicle")


#: ``format`` in result.json of what a person has put into columns.
TABLE_FORMAT: Final = "table"
