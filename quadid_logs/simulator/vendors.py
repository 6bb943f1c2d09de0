"""What the autopilots call things: parameters, messages, modes and texts of their logs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from quadid_logs.autopilots.ardupilot.frames import FRAME_CLASSES, FRAME_TYPES
from quadid_logs.errors import SimulationError
from quadid_logs.simulator.closed_loop import SPIN_MAX, SPIN_MIN, Setup, controller_gains, final_gains
from quadid_logs.simulator.control import TrackingNotch
from quadid_logs.simulator.outputs import CELL_WARNING_V
from quadid_logs.simulator.position_hold import PositionHold
from quadid_logs.simulator.whole_gains import WholeGains
from quadid_logs.vocabulary import AXES

_PWM_MIN: Final = 1000.0
_PWM_MAX: Final = 2000.0
_SPIN_ARM: Final = 0.1
#: Range of digital motor outputs, and the bit of the features that is airmode.
_DSHOT_LOWEST, _DSHOT_HIGHEST, _AIRMODE = 48, 2047, 1 << 22
#: What `FlightLog.position_control` is made of: no signal.
POSITION_ROWS: Final = "position_control"


@dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """One message of the log: the signals it holds with their field names, and its rate [Hz].

    ``rate_hz`` 0 means the log's main rate.
    """

    message: str
    signals: tuple[tuple[str, str], ...]
    rate_hz: float = 0.0
    latency_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Vendor:
    """How an autopilot logs.

    ``default_rate_hz`` is the main rate without changed log settings; ``terms``: those of the rate
    controllers are logged; ``position_mode`` and ``position_stream``: the mode that holds positions, and what
    it logs besides; ``angle_mode``: where a manoeuvre of angles has another mode than one of rates.
    """

    name: str
    log_format: str
    firmware: str
    default_rate_hz: float
    streams: tuple[Stream, ...]
    flight_mode: str
    sysid_mode: str
    landing_mode: str
    terms: bool = True
    position_mode: str = ""
    angle_mode: str = ""
    position_stream: Stream | None = None


ARDUPILOT: Final = Vendor(
    name="ardupilot",
    log_format="dataflash",
    firmware="ArduCopter V4.5.7 (quadid-logs simulator)",
    default_rate_hz=10.0,
    streams=(
        Stream(
            message="RATE",
            signals=(
                ("body_rate", "R,P,Y"),
                ("body_rate_setpoint", "RDes,PDes,YDes"),
                ("torque_command", "ROut,POut,YOut"),
                ("throttle", "AOut"),
            ),
        ),
        Stream(message="ANG", signals=(("attitude", "Roll,Pitch,Yaw"),)),
        Stream(
            message="IMU",
            signals=(("body_rate_raw", "GyrX,GyrY,GyrZ"), ("specific_force", "AccX,AccY,AccZ")),
        ),
        Stream(message="RCOU", signals=(("output_pwm", "C1.."),), rate_hz=10.0),
        Stream(message="MOTB", signals=(("battery_ratio", "BatVolt"), ("lift_max", "LiftMax")), rate_hz=10.0),
        Stream(message="BAT", signals=(("battery_voltage", "Volt"),), rate_hz=10.0),
        Stream(message="ESC", signals=(("rotor_speed", "RPM"),), rate_hz=20.0, latency_s=0.01),
    ),
    flight_mode="ALT_HOLD",
    sysid_mode="SYSTEMID",
    landing_mode="LAND",
    position_mode="LOITER",
    position_stream=Stream(message="PSCN", signals=((POSITION_ROWS, ""),), rate_hz=10.0),
)

#: Logged in the System ID mode only.
SYSID_STREAM: Final = Stream(message="SIDD", signals=(("sysid_chirp", "Targ"),))

PX4: Final = Vendor(
    name="px4",
    log_format="ulog",
    firmware="PX4 v1.15.4 (quadid-logs simulator)",
    default_rate_hz=50.0,
    streams=(
        Stream(message="vehicle_angular_velocity", signals=(("body_rate", "xyz[0..2]"),)),
        Stream(message="vehicle_rates_setpoint", signals=(("body_rate_setpoint", "roll,pitch,yaw"),)),
        Stream(message="vehicle_torque_setpoint", signals=(("torque_command", "xyz[0..2]"),)),
        Stream(message="vehicle_thrust_setpoint", signals=(("throttle", "xyz[2]"),)),
        Stream(message="vehicle_attitude", signals=(("attitude", "q[0..3]"),)),
        Stream(
            message="sensor_combined",
            signals=(
                ("body_rate_raw", "gyro_rad[0..2]"),
                ("specific_force", "accelerometer_m_s2[0..2]"),
            ),
        ),
        Stream(message="actuator_motors", signals=(("motor_thrust", "control[0..]"),)),
        Stream(message="actuator_outputs", signals=(("output_pwm", "output[0..]"),), rate_hz=10.0),
        Stream(
            message="control_allocator_status",
            signals=(("unallocated_torque", "unallocated_torque[0..2]"),),
            rate_hz=5.0,
        ),
        Stream(message="battery_status", signals=(("battery_voltage", "voltage_v"),), rate_hz=10.0),
        Stream(
            message="esc_status", signals=(("rotor_speed", "esc[].esc_rpm"),), rate_hz=10.0, latency_s=0.01
        ),
    ),
    flight_mode="ALTCTL",
    sysid_mode="ALTCTL",
    landing_mode="AUTO_LAND",
    position_mode="POSCTL",
    position_stream=Stream(
        message="vehicle_local_position_setpoint", signals=((POSITION_ROWS, ""),), rate_hz=10.0
    ),
)


#: The angle of a full stick [deg] (``pid.c``).
ANGLE_LIMIT_DEG: Final = 60.0
BETAFLIGHT: Final = Vendor(
    name="betaflight",
    log_format="blackbox",
    firmware="Betaflight v2025.12.1 (quadid-logs simulator)",
    default_rate_hz=100.0,
    # One frame holds all.
    streams=(
        Stream(
            message="main",
            signals=(
                ("body_rate", "gyroADC"),
                ("body_rate_raw", "gyroUnfilt"),
                ("body_rate_setpoint", "setpoint"),
                ("stick", "rcCommand"),
                ("attitude", "imuQuaternion"),
                ("torque_command", "axisP"),
                ("throttle", "setpoint[3]"),
                ("motor_thrust", "motor"),
                ("rotor_speed", "eRPM"),
                ("specific_force", "accSmooth"),
                ("battery_voltage", "vbatLatest"),
            ),
        ),
    ),
    flight_mode="Acro",
    sysid_mode="Acro",
    landing_mode="Acro",
    angle_mode="Angle",
)


CRAZYFLIE: Final = Vendor(
    name="crazyflie",
    log_format="usd",
    firmware="",
    default_rate_hz=250.0,
    # One event holds all.
    streams=(
        Stream(
            message="fixedFrequency",
            signals=(
                ("body_rate", "controller.r_roll"),
                ("body_rate_setpoint", "controller.rollRate"),
                ("attitude", "stabilizer.roll"),
                ("torque_command", "controller.cmd_roll"),
                ("throttle", "controller.cmd_thrust"),
                ("specific_force", "acc.x"),
                ("battery_voltage", "pm.vbat"),
            ),
        ),
    ),
    flight_mode="",
    sysid_mode="",
    landing_mode="",
    terms=False,
)


def vendor(autopilot: str) -> Vendor:
    """Return the autopilot's way of logging.

    Raises
    ------
    SimulationError
        If it is none of "ardupilot", "px4", "betaflight" and "crazyflie".
    """
    for known in (ARDUPILOT, PX4, BETAFLIGHT, CRAZYFLIE):
        if known.name == autopilot:
            return known
    raise SimulationError(
        f"There is no simulated autopilot {autopilot!r}.",
        hint="Choose ardupilot, px4, betaflight or crazyflie.",
    )


#: Beside the attitude, where positions are held.
_TARGETS: Final = {
    "ardupilot": ("ANG", "DesRoll,DesPitch,DesYaw"),
    "px4": ("vehicle_attitude_setpoint", "q_d[0..3]"),
}


def streams_of(setup: Setup, streams: tuple[Stream, ...]) -> tuple[Stream, ...]:
    """Return an autopilot's messages, with those of its position controllers where they fly.

    Parameters
    ----------
    streams : tuple of Stream
        Of any flight, at the rates of the log's settings.
    """
    extra = vendor(setup.autopilot).position_stream
    if setup.position is None or extra is None:
        return streams
    message, fields = _TARGETS[setup.autopilot]
    target = ("attitude_setpoint", fields)
    if all(stream.message != message for stream in streams):
        return (*streams, Stream(message=message, signals=(target,)), extra)
    joined = (
        replace(stream, signals=(*stream.signals, target)) if stream.message == message else stream
        for stream in streams
    )
    return (*joined, extra)


def frame_name(setup: Setup) -> str:
    """Return the frame as ArduPilot's start-up message names it, for example QUAD/X."""
    airframe = setup.airframe
    return f"{FRAME_CLASSES[airframe.frame_class]}/{FRAME_TYPES[airframe.frame_type]}".upper()


def start_texts(setup: Setup) -> tuple[str, ...]:
    """Return the messages of the log's first second."""
    if setup.autopilot == "px4":
        return ("[logger] logging started",)
    if setup.autopilot in ("betaflight", "crazyflie"):
        return ()
    return (ARDUPILOT.firmware, f"Frame: {frame_name(setup)}")


def pulse_widths(setup: Setup) -> tuple[float, float, float]:
    """Return the pulse width [us] of actuator 0, of actuator 1, and of an armed motor that idles."""
    if setup.autopilot == "px4":
        return _PWM_MIN, _PWM_MAX, _PWM_MIN
    span = _PWM_MAX - _PWM_MIN
    return _PWM_MIN + span * SPIN_MIN, _PWM_MIN + span * SPIN_MAX, _PWM_MIN + span * _SPIN_ARM


def motor_order(setup: Setup) -> list[int]:
    """Return Betaflight's motors, rear right, front right, rear left, front left, as numbers of the rotors.

    Raises
    ------
    SimulationError
        If the vehicle is no quad X.
    """
    x, y = setup.airframe.position_m[:, 0], setup.airframe.position_m[:, 1]
    if setup.airframe.n_rotors != 4 or not (np.abs(x) > 0.0).all() or not (np.abs(y) > 0.0).all():
        raise SimulationError("Betaflight is simulated on a quad X only.", hint="Choose another scenario.")
    return [int(number) for number in np.lexsort((x > 0.0, y < 0.0))]


def parameters(setup: Setup, *, rate_hz: float) -> dict[str, float]:
    """Return the parameters that the autopilot would log, the interesting ones of many."""
    if setup.autopilot == "crazyflie":
        listed = {}
    elif setup.autopilot == "betaflight":
        listed = _betaflight(setup)
    else:
        listed = _px4(setup, rate_hz) if setup.autopilot == "px4" else _ardupilot(setup, rate_hz)
    # Parameters are stored in single precision, and single precision is what a log returns.
    return {name: float(np.float32(value)) for name, value in sorted(listed.items())}


def _ardupilot(setup: Setup, rate_hz: float) -> dict[str, float]:
    """ArduCopter: frame, motors, rate loops, filters, logging."""
    airframe = setup.airframe
    default, fast_attitude, fast_imu, pids = 176126, 1, 1 << 18, 1 << 12
    values = {
        "FRAME_CLASS": airframe.frame_class,
        "FRAME_TYPE": airframe.frame_type,
        "MOT_THST_EXPO": setup.firmware_expo,
        "MOT_SPIN_MIN": SPIN_MIN,
        "MOT_SPIN_MAX": SPIN_MAX,
        "MOT_SPIN_ARM": _SPIN_ARM,
        "MOT_PWM_MIN": _PWM_MIN,
        "MOT_PWM_MAX": _PWM_MAX,
        "MOT_PWM_TYPE": 0,
        "MOT_BAT_VOLT_MAX": airframe.battery.full_v,
        "MOT_BAT_VOLT_MIN": 0.5 * airframe.battery.full_v,
        "MOT_THST_HOVER": setup.hover_throttle,
        "MOT_YAW_HEADROOM": 200,
        "MOT_OPTIONS": 0,
        "ATC_THR_MIX_MAN": 0.5,
        "ATC_THR_MIX_MAX": 0.5,
        "INS_GYRO_FILTER": setup.gyro_filter_hz,
        "INS_ACCEL_FILTER": 20,
        "SCHED_LOOP_RATE": setup.loop_hz,
        "LOG_BITMASK": default
        if rate_hz <= ARDUPILOT.default_rate_hz
        else default | fast_attitude | fast_imu | pids,
        "LOG_DISARMED": 0,
        "LOG_FILE_DSRMROT": 0,
        "SYSID_THISMAV": 1,
    }
    values |= _ardupilot_notch(setup.tuning.notch)
    for motor in range(airframe.n_rotors):
        values[f"SERVO{motor + 1}_FUNCTION"] = 33 + motor if motor < 8 else 82 + motor - 8
    torque = np.any(setup.reference.torque, axis=0)
    if torque.any():
        values["SID_AXIS"] = 10 + int(np.argmax(torque))
    # ATC_*: the loops that flew.
    gains = final_gains(setup)
    loops: dict[str, float] = {}
    for axis, name in enumerate(("RLL", "PIT", "YAW")):
        loops |= {
            f"ATC_ANG_{name}_P": gains.attitude[axis],
            f"ATC_RAT_{name}_P": gains.proportional[axis],
            f"ATC_RAT_{name}_I": gains.integral[axis],
            f"ATC_RAT_{name}_D": gains.derivative[axis],
            f"ATC_RAT_{name}_FF": 0.0,
            f"ATC_RAT_{name}_IMAX": gains.integral_limit,
            f"ATC_RAT_{name}_FLTD": setup.tuning.of_derivative_hz(axis),
            f"ATC_RAT_{name}_FLTE": setup.tuning.error_hz,
            f"ATC_RAT_{name}_FLTT": setup.tuning.target_hz,
            f"ATC_RAT_{name}_SMAX": setup.tuning.slew_limit,
        }
    return values | loops | _ardupilot_position(setup.position)


def _ardupilot_position(hold: PositionHold | None) -> dict[str, float]:
    """PSC_*, and an input shaper without limits of the acceleration."""
    if hold is None:
        return {}
    return {
        "ATC_INPUT_TC": hold.lag_s,
        "ATC_RATE_FF_ENAB": float(hold.lag_s > 0.0),
        **{f"ATC_ACCEL_{axis}_MAX": 0.0 for axis in "RPY"},
        "PSC_POSXY_P": hold.position_per_s,
        "PSC_VELXY_P": hold.proportional_per_s,
        "PSC_VELXY_I": hold.integral_per_s2,
        "PSC_VELXY_D": hold.derivative,
        "PSC_VELXY_FLTE": hold.error_hz,
        "PSC_VELXY_FLTD": hold.derivative_hz,
    }


def _px4_position(hold: PositionHold | None) -> dict[str, float]:
    """MPC_XY_*; the heading counts in full."""
    if hold is None:
        return {}
    return {
        "MC_YAW_WEIGHT": 1.0,
        "MPC_XY_P": hold.position_per_s,
        "MPC_XY_VEL_P_ACC": hold.proportional_per_s,
        "MPC_XY_VEL_I_ACC": hold.integral_per_s2,
        "MPC_XY_VEL_D_ACC": hold.derivative,
        "MPC_VELD_LP": hold.derivative_hz,
    }


def _ardupilot_notch(notch: TrackingNotch | None) -> dict[str, float]:
    """INS_HNTCH_*: what follows the rotors' speed, by the ESCs' telemetry."""
    if notch is None:
        return {"INS_HNTCH_ENABLE": 0}
    return {
        "INS_HNTCH_ENABLE": 1,
        "INS_HNTCH_MODE": 0 if notch.stands else 3,
        "INS_HNTCH_REF": 1,
        "INS_HNTCH_FREQ": notch.lowest_hz,
        "INS_HNTCH_BW": notch.width_hz,
        "INS_HNTCH_ATT": notch.depth_db,
        "INS_HNTCH_HMNCS": 2**notch.n_harmonics - 1,
    }


def _px4(setup: Setup, rate_hz: float) -> dict[str, float]:
    """PX4: geometry, outputs, rate loops, filters, logging; CT and KM as a careful owner sets them."""
    airframe = setup.airframe
    default, sysid_and_high_rate = 1, 8 + 16
    values: dict[str, float] = {
        "MAV_TYPE": {4: 2, 6: 13}.get(airframe.n_rotors, 14),
        "MAV_SYS_ID": 1,
        "CA_AIRFRAME": 0,
        "CA_METHOD": 2,
        "CA_R_REV": 0,
        "CA_ROTOR_COUNT": airframe.n_rotors,
        "THR_MDL_FAC": setup.firmware_expo,
        "MC_BAT_SCALE_EN": 0,
        "MPC_THR_HOVER": setup.hover_throttle,
        "IMU_GYRO_CUTOFF": setup.gyro_filter_hz,
        "IMU_DGYRO_CUTOFF": setup.tuning.derivative_hz,
        "IMU_GYRO_RATEMAX": setup.loop_hz,
        "SDLOG_PROFILE": default if rate_hz <= PX4.default_rate_hz else default | sysid_and_high_rate,
        "SDLOG_MODE": 0,
        "SYS_AUTOSTART": 4001,
    }
    for i, ((x, y, z), spin) in enumerate(zip(airframe.position_m.tolist(), airframe.spin, strict=True)):
        values |= {
            f"CA_ROTOR{i}_PX": x,
            f"CA_ROTOR{i}_PY": y,
            f"CA_ROTOR{i}_PZ": z,
            f"CA_ROTOR{i}_AX": 0.0,
            f"CA_ROTOR{i}_AY": 0.0,
            f"CA_ROTOR{i}_AZ": -1.0,
            f"CA_ROTOR{i}_CT": airframe.max_thrust_n,
            f"CA_ROTOR{i}_KM": float(spin) * airframe.torque_to_thrust_m,
            f"PWM_MAIN_FUNC{i + 1}": 101 + i,
            f"PWM_MAIN_MIN{i + 1}": _PWM_MIN,
            f"PWM_MAIN_MAX{i + 1}": _PWM_MAX,
        }
    # MC_*: the loops that flew.
    gains = final_gains(setup)
    loops: dict[str, float] = {}
    for axis, (name, short) in enumerate((("ROLL", "RR"), ("PITCH", "PR"), ("YAW", "YR"))):
        loops |= {
            f"MC_{name}_P": gains.attitude[axis],
            f"MC_{name}RATE_P": gains.proportional[axis],
            f"MC_{name}RATE_I": gains.integral[axis],
            f"MC_{name}RATE_D": gains.derivative[axis],
            f"MC_{name}RATE_K": 1.0,
            f"MC_{short}_INT_LIM": gains.integral_limit,
        }
    return values | loops | _px4_position(setup.position)


def _betaflight(setup: Setup) -> dict[str, float]:
    """Betaflight: the settings that the header of a Blackbox log holds; digital outputs without idle.

    What bends the law of its rate loop is off: iterm relax, anti-gravity, throttle attenuation, D-max,
    feed-forward.
    """
    whole = WholeGains.near(controller_gains(setup))
    gains = {
        f"{axis}PID[{place}]": float(whole.rates[place, number])
        for number, axis in enumerate(AXES)
        for place in range(3)
    }
    return gains | {
        "levelPID[0]": float(whole.angle[0]),
        "levelPID[1]": 50,
        "dterm_lpf1_type": 0,
        "dterm_lpf1_static_hz": setup.tuning.derivative_hz,
        "simplified_pids_mode": 0,
        "iterm_relax": 0,
        "iterm_windup": 85,
        "anti_gravity_gain": 0,
        "tpa_rate": 0,
        "angle_limit": ANGLE_LIMIT_DEG,
        "looptime": 1e6 / setup.loop_hz,
        "pid_process_denom": 1,
        "gyro_lpf1_type": 1,
        "gyro_lpf1_static_hz": setup.gyro_filter_hz,
        "motorOutput[0]": _DSHOT_LOWEST,
        "motorOutput[1]": _DSHOT_HIGHEST,
        "motor_pwm_protocol": 6,
        "motor_poles": 14,
        "dshot_bidir": 1,
        "acc_1G": 2048,
        "pidsum_limit": 500,
        "pidsum_limit_yaw": 400,
        "features": _AIRMODE,
        "blackbox_high_resolution": 1,
        "thrust_linear": round(100.0 * setup.effects.thrust_linear),
        "vbat_sag_compensation": round(100.0 * setup.effects.sag_compensation),
        "vbatcellvoltage[0]": 330,
        "vbatcellvoltage[1]": round(100.0 * CELL_WARNING_V),
        "vbatcellvoltage[2]": 430,
        "vbatref": round(100.0 * setup.airframe.battery.full_v),
    }
