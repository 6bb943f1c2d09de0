"""What Betaflight makes of a command of thrust: `mixer.c`, `pid.c` (`pidApplyThrustLinearization`)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.betaflight.mixer import highest_output, linearised
from quadid_logs.data.log import FlightLog
from quadid_logs.data.off_nominal import AS_COMMANDED, ThrustLaw


def thrust_law(log: FlightLog, parameters: Mapping[str, float]) -> ThrustLaw:
    """Return the law of these settings.

    Parameters
    ----------
    log : FlightLog
        Whose version it is.

    Returns
    -------
    ThrustLaw
        ``vbat_sag_compensation`` keeps a part of the outputs' range for an emptier battery; nothing makes
        up for thin air.
    """
    amount = parameters.get("thrust_linear", 0.0) / 100.0

    def output(command: FloatArray) -> FloatArray:
        return linearised(command, amount, log.version)

    def behind(voltage_v: float, n_cells: int) -> float:  # noqa: ARG001
        if not math.isfinite(voltage_v):
            return 1.0
        return float(highest_output(np.array([voltage_v]), parameters)[0])

    return AS_COMMANDED._replace(output=output, behind=behind)
