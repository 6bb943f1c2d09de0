"""What is true about a simulated flight, in the terms in which `analyze` answers."""

from __future__ import annotations

import math
from importlib.metadata import version
from typing import Any

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.maths.rotational_dynamics import PRODUCTS, gyroscopic_matrix
from quadid_logs.simulator.airframes import SimulatedAirframe
from quadid_logs.simulator.closed_loop import Record, Setup, mixer_factors
from quadid_logs.simulator.control import throttle_for_thrust, thrust_of_throttle
from quadid_logs.simulator.outputs import output_curve

_TARGETS = ["p_dot", "q_dot", "r_dot"]
_INPUTS = ["L", "M", "N"]


def flight_truth(records: tuple[Record, ...], *, scenario: str, boot_s: float) -> dict[str, Any]:
    """Collect the truth of one or several flights of one vehicle.

    Parameters
    ----------
    records : tuple of Record
        In order; each begins where the one before ended.
    boot_s : float
        The log's clock when the first begins [s].

    Returns
    -------
    dict
        Ready for JSON.
    """
    setup = records[0].setup
    in_manoeuvre = _manoeuvre(records[0])
    rate, command = (records[0].channels[name][in_manoeuvre] for name in ("rate", "command"))
    noise = setup.noise
    segments, begin = [], boot_s
    for record in records:
        own = record.setup
        segments.append([begin + own.schedule.manoeuvre_s, begin + own.schedule.land_s])
        begin += record.time_s.size / own.loop_hz
    return {
        "schema_version": "1.0",
        "version": version("quadid-logs"),
        "scenario": scenario,
        "seed": setup.seed,
        "autopilot": setup.autopilot,
        "segments_s": segments,
        "vehicle": vehicle_truth(setup.airframe),
        "effects": setup.effects.named(),
        "actuator": actuator_truth(setup),
        "sensing": {
            "gyro_filter_hz": setup.gyro_filter_hz,
            "gyro_noise_rad_s_per_rthz": noise.gyro_rad_s_per_rthz,
            "gyro_bias_rad_s": list(noise.gyro_bias_rad_s),
            "gyro_scale": list(noise.gyro_scale),
            "gyro_cross": list(noise.gyro_cross),
            "gyro_resolution_rad_s": noise.gyro_resolution_rad_s,
            "accelerometer_noise_m_s2_per_rthz": noise.accelerometer_m_s2_per_rthz,
            "rotor_line_rad_s": noise.rotor_line_rad_s,
            "frame_line_rad_s": noise.frame_line_rad_s,
            "frame_line_hz": noise.frame_line_hz,
        },
        "wind_m_s": setup.wind.speed_m_s,
        "loop_hz": setup.loop_hz,
        "mean": _means(records[0], in_manoeuvre),
        "excitation": {
            "rms_rate_rad_s": np.sqrt(np.mean(rate**2, axis=0)).tolist(),
            "max_rate_rad_s": np.abs(rate).max(axis=0).tolist(),
            "rms_command": np.std(command, axis=0).tolist(),
            "max_command": np.abs(command).max(axis=0).tolist(),
        },
        "torque_n_m_per_command": torque_per_command(records[0]).tolist(),
        "models": model_truth(setup.airframe, torque_per_command(records[0])),
    }


def _manoeuvre(record: Record) -> BoolArray:
    """Control periods between take-off and landing."""
    schedule = record.setup.schedule
    return (record.time_s >= schedule.manoeuvre_s) & (record.time_s < schedule.land_s)


def vehicle_truth(airframe: SimulatedAirframe) -> dict[str, Any]:
    """Return mass, inertia, rotors and drag of the vehicle."""
    rotors = zip(airframe.position_m.tolist(), airframe.spin.tolist(), strict=True)
    return {
        "name": airframe.name,
        "frame_class": airframe.frame_class,
        "frame_type": airframe.frame_type,
        "mass_kg": airframe.mass_kg,
        "inertia_kg_m2": airframe.inertia_kg_m2.tolist(),
        "arm_length_m": float(np.hypot(*airframe.position_m[:, :2].T).max()),
        "rotors": [
            {"position_m": position, "spin": "ccw" if spin > 0.0 else "cw"} for position, spin in rotors
        ],
        "max_thrust_n": airframe.max_thrust_n,
        "rotor_thrust_n": airframe.rotor_thrust_n.tolist(),
        "torque_to_thrust_m": airframe.torque_to_thrust_m,
        "rotor_inertia_kg_m2": airframe.rotor_inertia_kg_m2,
        "thrust_expo": airframe.thrust_expo,
        "rotor_speed_max_rad_s": airframe.rotor_speed_max_rad_s,
        "hover_throttle": airframe.hover_throttle,
        "rate_damping_n_m_s": np.asarray(airframe.rate_damping_n_m_s).tolist(),
        "drag_n_s_m": airframe.drag_n_s_m,
        "drag_area_m2": airframe.drag_area_m2,
        "drag_height_m": airframe.drag_height_m,
    }


def actuator_truth(setup: Setup) -> dict[str, Any]:
    """Return the rotors' lag and every delay between the logged torque and the logged rate [s]."""
    up_s, down_s = setup.airframe.lag_up_s, setup.airframe.lag_down_s * setup.effects.spin_down_ratio
    hold_s = 0.5 / setup.loop_hz
    extra_s = setup.delay_steps / setup.loop_hz
    # The group delay at zero frequency of the discrete filter; close to sqrt(2) / (2 pi f_c).
    filter_s = 1.0 / (
        math.sqrt(2.0) * setup.loop_hz * math.tan(math.pi * min(setup.gyro_filter_hz / setup.loop_hz, 0.4))
    )
    return {
        "acts_on": "rotor speed",
        "lag_s": 0.5 * (up_s + down_s),
        "lag_up_s": up_s,
        "lag_down_s": down_s,
        "yaw_lead_s": setup.airframe.yaw_lead_s,
        "delay_s": hold_s + extra_s + filter_s,
        "delay_parts_s": {
            "zero_order_hold": hold_s,
            "output": extra_s,
            "gyro_filter": filter_s,
        },
    }


def _means(record: Record, in_manoeuvre: BoolArray) -> dict[str, float]:
    """Operating point of the manoeuvre."""
    channels = record.channels
    return {
        "throttle": float(channels["throttle"][in_manoeuvre].mean()),
        "thrust_fraction": float(channels["thrust_fraction"][in_manoeuvre].mean()),
        "battery_ratio": float(channels["voltage"][in_manoeuvre].mean()),
        "battery_ratio_filtered": float(channels["voltage_filtered"][in_manoeuvre].mean()),
        "mixer_limited_fraction": float(channels["limited"][in_manoeuvre].mean()),
    }


def torque_per_command(record: Record) -> FloatArray:
    """Return N m per unit torque command around the manoeuvre's mean, shape (3, 3).

    The chain mixer, thrust curve, battery is linearised at the mean thrust
    fraction and the mean voltages; lag and mixer limits are not part of it.
    """
    return _torque_at(record.setup, _means(record, _manoeuvre(record)))


def torque_at_hover(setup: Setup) -> FloatArray:
    """Return N m per unit torque command at hover with a full battery, shape (3, 3)."""
    full = {"thrust_fraction": setup.hover_throttle, "battery_ratio": 1.0, "battery_ratio_filtered": 1.0}
    return _torque_at(setup, full)


def _torque_at(setup: Setup, means: dict[str, float]) -> FloatArray:
    airframe = setup.airframe
    factors = mixer_factors(airframe, setup.autopilot)[:, :3]
    slope = _thrust_slope(setup, means)
    remaining = airframe.rotor_thrust_n / airframe.max_thrust_n
    return slope * airframe.torque_per_thrust @ (remaining[:, np.newaxis] * factors)


def _thrust_slope(setup: Setup, means: dict[str, float]) -> float:
    """Newton per unit of mixer factor times torque command, at the operating point."""
    airframe, expo = setup.airframe, setup.firmware_expo
    if setup.autopilot == "ardupilot":
        # The gain 1/lift before the mixer cancels the lift behind it, but at the operating point.
        divisor = means["battery_ratio_filtered"]
        argument = thrust_of_throttle(divisor, expo) * means["thrust_fraction"]
    else:
        argument, divisor = means["thrust_fraction"], 1.0

    curve = output_curve(setup.effects, wanted=setup.autopilot == "betaflight")

    def thrust(value: float) -> float:
        throttle = throttle_for_thrust(value, expo) / divisor
        if curve.present:
            throttle = float(curve.output(value, means["battery_ratio"]))
        effective = throttle * means["battery_ratio"]
        return float(airframe.max_thrust_n * thrust_of_throttle(effective, airframe.thrust_expo))

    step = 1e-4
    return (thrust(argument + step) - thrust(argument - step)) / (2.0 * step)


def model_truth(airframe: SimulatedAirframe, torque_n_m_per_command: FloatArray) -> dict[str, Any]:
    """Return A and B [rad/s^2 per unit of regressor or torque command] in the terms of every structure."""
    J = airframe.inertia_kg_m2
    B = np.asarray(np.linalg.solve(J, torque_n_m_per_command), dtype=np.float64)
    damping = -np.asarray(np.linalg.solve(J, np.diag(airframe.rate_damping_n_m_s)), dtype=np.float64)
    products = gyroscopic_matrix(J)
    names = list(PRODUCTS)
    gyroscopic = products[:, [names.index(name) for name in ("qr", "pr", "pq")]]
    kinematics = np.vstack([np.hstack([damping, np.zeros((3, 3))]), np.eye(3, 6)])
    return {
        "quadrotor-6": _model(["qr", "pr", "pq"], gyroscopic, B),
        "damped": _model(
            ["qr", "pr", "pq", "p", "q", "r", "1"],
            np.hstack([gyroscopic, damping, np.zeros((3, 1))]),
            B,
        ),
        "rigid-body": _model([*names, "p", "q", "r"], np.hstack([products, damping]), B)
        | {"inertia_over_torque_command": np.linalg.inv(B).tolist()},
        "linear-9": _model(
            ["p", "q", "r", "phi", "theta", "psi"],
            kinematics,
            np.vstack([B, np.zeros((3, 3))]),
            targets=[*_TARGETS, "phi_dot", "theta_dot", "psi_dot"],
        )
        | {"note": "linearised about level hover"},
    }


def _model(
    regressors: list[str], A: FloatArray, B: FloatArray, *, targets: list[str] | None = None
) -> dict[str, Any]:
    """One structure's matrices with their labels."""
    return {
        "targets": targets or _TARGETS,
        "regressors": regressors,
        "inputs": _INPUTS,
        "A": A.tolist(),
        "B": B.tolist(),
    }
