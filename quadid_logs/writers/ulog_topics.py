"""What PX4's topics look like: field lists as PX4 main logs them.

Sources: PX4-Autopilot msg/*.msg and msg/versioned/*.msg; the order is that of
the logged formats (largest type first), checked against logs of PX4 main.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

#: numpy type per ULog type (docs.px4.io, "ULog File Format").
TYPES: Final = {
    "int8_t": "i1",
    "uint8_t": "u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "u1",
}

TOPICS: Final = {
    "vehicle_angular_velocity": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;float[3] xyz_derivative;"
    ),
    "vehicle_acceleration": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;uint8_t[4] _padding0;"
    ),
    "vehicle_attitude": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;float[4] delta_q_reset;"
        "uint8_t quat_reset_counter;uint8_t[7] _padding0;"
    ),
    "vehicle_torque_setpoint": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;uint8_t[4] _padding0;"
    ),
    "vehicle_thrust_setpoint": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;uint8_t[4] _padding0;"
    ),
    "vehicle_rates_setpoint": (
        "uint64_t timestamp;float roll;float pitch;float yaw;float[3] thrust_body;"
        "bool reset_integral;uint8_t[7] _padding0;"
    ),
    "vehicle_attitude_setpoint": (
        "uint64_t timestamp;float yaw_sp_move_rate;float[4] q_d;float[3] thrust_body;"
    ),
    "vehicle_local_position_setpoint": (
        "uint64_t timestamp;float x;float y;float z;float vx;float vy;float vz;float[3] acceleration;"
        "float[3] thrust;float yaw;float yawspeed;uint8_t[4] _padding0;"
    ),
    "trajectory_setpoint": (
        "uint64_t timestamp;float[3] position;float[3] velocity;float[3] acceleration;float[3] jerk;"
        "float yaw;float yawspeed;"
    ),
    # Without the fields of accuracy and resets, of which nothing is known.
    "vehicle_local_position": (
        "uint64_t timestamp;uint64_t timestamp_sample;float x;float y;float z;float vx;float vy;float vz;"
    ),
    "actuator_motors": (
        "uint64_t timestamp;uint64_t timestamp_sample;float[12] control;uint16_t reversible_flags;"
        "uint8_t[6] _padding0;"
    ),
    "actuator_outputs": "uint64_t timestamp;uint32_t noutputs;float[16] output;uint8_t[4] _padding0;",
    "esc_report": (
        "uint64_t timestamp;uint32_t esc_errorcount;int32_t esc_rpm;float esc_voltage;float esc_current;"
        "float esc_temperature;int16_t motor_temperature;uint16_t failures;uint8_t esc_state;"
        "uint8_t actuator_function;int8_t esc_power;uint8_t[5] _padding0;"
    ),
    "esc_status": (
        "uint64_t timestamp;uint16_t counter;uint16_t esc_online_flags;uint16_t esc_armed_flags;"
        "uint8_t esc_count;uint8_t esc_connectiontype;esc_report[12] esc;"
    ),
    "sensor_combined": (
        "uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
        "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;"
        "uint32_t accelerometer_integral_dt;uint8_t accelerometer_clipping;uint8_t gyro_clipping;"
        "uint8_t accel_calibration_count;uint8_t gyro_calibration_count;"
    ),
    "sensor_gyro_fifo": (
        "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float dt;float scale;"
        "int16_t[32] x;int16_t[32] y;int16_t[32] z;bool is_external;uint8_t samples;uint8_t[2] _padding0;"
    ),
    "vehicle_status": (
        "uint64_t timestamp;uint64_t armed_time;uint64_t takeoff_time;uint64_t nav_state_timestamp;"
        "uint32_t valid_nav_states_mask;uint32_t can_set_nav_states_mask;uint8_t arming_state;"
        "uint8_t latest_arming_reason;uint8_t latest_disarming_reason;uint8_t nav_state_user_intention;"
        "uint8_t nav_state;uint8_t executor_in_charge;uint8_t nav_state_display;"
        "bool accepts_offboard_setpoints;uint8_t hil_state;uint8_t vehicle_type;bool failsafe;"
        "bool failsafe_and_user_took_over;uint8_t failsafe_defer_state;bool gcs_connection_lost;"
        "uint8_t gcs_connection_lost_counter;bool high_latency_data_link_lost;bool is_vtol;"
        "bool is_vtol_tailsitter;bool in_transition_mode;bool in_transition_to_fw;uint8_t system_type;"
        "uint8_t system_id;uint8_t component_id;bool safety_button_available;bool safety_off;"
        "bool power_input_valid;bool usb_connected;bool open_drone_id_system_present;"
        "bool open_drone_id_system_healthy;bool parachute_system_present;bool parachute_system_healthy;"
        "bool traffic_avoidance_system_present;bool rc_calibration_in_progress;bool calibration_enabled;"
        "bool pre_flight_checks_pass;uint8_t[5] _padding0;"
    ),
    "actuator_armed": (
        "uint64_t timestamp;bool armed;bool prearmed;bool ready_to_arm;bool lockdown;bool kill;"
        "bool termination;bool in_esc_calibration_mode;uint8_t[1] _padding0;"
    ),
    "vehicle_land_detected": (
        "uint64_t timestamp;bool freefall;bool ground_contact;bool maybe_landed;bool landed;"
        "bool in_ground_effect;bool in_descend;bool has_low_throttle;bool vertical_movement;"
        "bool horizontal_movement;bool rotational_movement;bool close_to_ground_or_skipped_check;"
        "bool at_rest;uint8_t[4] _padding0;"
    ),
    "battery_status": (
        "uint64_t timestamp;float voltage_v;float current_a;float current_average_a;float discharged_mah;"
        "float remaining;float scale;float time_remaining_s;float temperature;float[14] voltage_cell_v;"
        "float max_cell_voltage_delta;float full_charge_capacity_wh;float remaining_capacity_wh;"
        "float nominal_voltage;float internal_resistance_estimate;float ocv_estimate;"
        "float ocv_estimate_filtered;float volt_based_soc_estimate;float voltage_prediction;"
        "float prediction_error;float estimation_covariance_norm;uint16_t capacity;uint16_t cycle_count;"
        "uint16_t average_time_to_empty;uint16_t manufacture_date;uint16_t state_of_health;"
        "uint16_t max_error;uint16_t interface_error;uint16_t faults;uint16_t over_discharge_count;"
        "bool connected;uint8_t cell_count;uint8_t source;uint8_t priority;uint8_t id;"
        "bool is_powering_off;bool is_required;uint8_t warning;uint8_t[2] _padding0;"
    ),
    "control_allocator_status": (
        "uint64_t timestamp;float[3] unallocated_torque;float[3] unallocated_thrust;"
        "uint16_t handled_motor_failure_mask;uint16_t motor_stop_mask;bool torque_setpoint_achieved;"
        "bool thrust_setpoint_achieved;int8_t[16] actuator_saturation;"
        "bool actuator_group_preflight_check_active;uint8_t[1] _padding0;"
    ),
}

#: Defined in a log that holds it only.
FIFO: Final = "sensor_gyro_fifo"
#: The same, of attitude and position controllers.
ATTITUDE_SETPOINT: Final = "vehicle_attitude_setpoint"
POSITIONS: Final = ("vehicle_local_position_setpoint", "vehicle_local_position", "trajectory_setpoint")
#: PX4 parameters that are integers, by exact name; every other one is written as a float.
INTEGER_PARAMETERS: Final = frozenset(
    (
        "CA_AIRFRAME",
        "CA_FAILURE_MODE",
        "CA_METHOD",
        "CA_ROTOR_COUNT",
        "CA_R_REV",
        "IMU_GYRO_CAL_EN",
        "IMU_GYRO_DNF_EN",
        "IMU_GYRO_DNF_HMC",
        "IMU_GYRO_RATEMAX",
        "IMU_INTEG_RATE",
        "MAV_COMP_ID",
        "MAV_SYS_ID",
        "MAV_TYPE",
        "MC_AIRMODE",
        "MC_AT_APPLY",
        "MC_AT_EN",
        "MC_BAT_SCALE_EN",
        "SDLOG_BACKEND",
        "SDLOG_MODE",
        "SDLOG_PROFILE",
        "SENS_BOARD_ROT",
        "SYS_AUTOCONFIG",
        "SYS_AUTOSTART",
        "SYS_HITL",
        "SYS_PARAM_VER",
        "BAT1_N_CELLS",
        "BAT1_SOURCE",
        *(f"PWM_MAIN_{kind}{channel}" for kind in ("FUNC", "MIN", "MAX", "DIS") for channel in range(1, 17)),
    )
)


def whole_parameter(name: str, value: float) -> int | None:
    """Return an integer parameter's value, None for one that PX4 keeps as a float."""
    if name not in INTEGER_PARAMETERS or not math.isfinite(value):
        return None
    return max(-(2**31), min(round(value), 2**31 - 1))


def row_type(topic: str, *, nested: bool = False) -> np.dtype[np.void]:
    """Return a topic's packed row; the padding at its very end is logged only where it is nested."""
    fields: list[tuple[str, str | np.dtype[np.void], tuple[int, ...]]] = []
    for text in TOPICS[topic].rstrip(";").split(";"):
        # Such as "float[3] xyz".
        kind, _, name = text.partition(" ")
        base, _, count = kind.rstrip("]").partition("[")
        row = TYPES[base] if base in TYPES else row_type(base, nested=True)
        fields.append((name, row, (int(count),) if count else ()))
    while not nested and fields[-1][0].startswith("_padding"):
        fields.pop()
    return np.dtype(fields)
