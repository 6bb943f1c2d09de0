"""What PX4 makes of a command of thrust.

Sources: `FunctionMotors.hpp`, `MulticopterRateControl.cpp`, `battery.cpp` (`Battery::computeScale`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.px4.torque import output_of_thrust
from quadid_logs.data.off_nominal import AS_COMMANDED, ThrustLaw

#: 30 % at most; BAT1_V_CHARGED where the log does not hold it [V].
_MOST_SCALE: Final = 1.3
_CHARGED_V: Final = 4.05


def thrust_law(parameters: Mapping[str, float]) -> ThrustLaw:
    """Return the law of these parameters.

    THR_MDL_FAC undoes the curve. With MC_BAT_SCALE_EN the set-points of torque and thrust are multiplied by
    the charged cell's voltage over that of the cell now, before the allocation. Nothing makes up for thin
    air.
    """
    factor = float(np.clip(parameters.get("THR_MDL_FAC", 0.0), 0.0, 1.0))
    charged_v = parameters.get("BAT1_V_CHARGED", _CHARGED_V)

    def output(command: FloatArray) -> FloatArray:
        return output_of_thrust(command, factor)

    def before(voltage_v: float, n_cells: int) -> float:
        cells = int(parameters.get("BAT1_N_CELLS", 0.0)) or n_cells
        if not (parameters.get("MC_BAT_SCALE_EN", 0.0) > 0.0 and voltage_v > 0.0 and cells > 0):
            return 1.0
        return float(np.clip(charged_v * cells / voltage_v, 1.0, _MOST_SCALE))

    return AS_COMMANDED._replace(output=output, before=before)
