"""What ArduPilot makes of a command of thrust: `AP_Motors_Thrust_Linearization.cpp`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.ardupilot.airframe import motor_prefix
from quadid_logs.autopilots.ardupilot.mixer import throttle_of_thrust
from quadid_logs.autopilots.ardupilot.torque import motor_settings
from quadid_logs.data.off_nominal import AS_COMMANDED, ThrustLaw

#: The lowest voltage that is believed, of MOT_BAT_VOLT_MAX.
_LEAST_RATIO: Final = 0.6


def thrust_law(parameters: Mapping[str, float]) -> ThrustLaw:
    """Return the law of these parameters.

    MOT_THST_EXPO undoes the curve. Between MOT_BAT_VOLT_MIN and MOT_BAT_VOLT_MAX outputs are divided by the
    battery's resting voltage over the latter, and commands by the density of the air.
    """
    prefix, settings = motor_prefix(parameters), motor_settings(parameters)
    highest_v = parameters.get(f"{prefix}MOT_BAT_VOLT_MAX", 0.0)
    lowest_v = parameters.get(f"{prefix}MOT_BAT_VOLT_MIN", 0.0)

    def output(command: FloatArray) -> FloatArray:
        return command if settings is None else throttle_of_thrust(command, settings)

    def behind(voltage_v: float, n_cells: int) -> float:  # noqa: ARG001
        if not (highest_v > 0.0 and lowest_v < highest_v and voltage_v >= 0.25 * lowest_v):
            return 1.0
        least = max(lowest_v / highest_v, _LEAST_RATIO)
        return float(1.0 / np.clip(voltage_v / highest_v, least, 1.0))

    return AS_COMMANDED._replace(output=output, behind=behind, for_density=True)
