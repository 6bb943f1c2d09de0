"""The frame file of ArduPilot's SITL."""

from __future__ import annotations

import json
import math
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray

#: For people.
TITLE: Final = "ArduPilot SITL's frame"


def sitl_frame(inertia_kg_m2: FloatArray, mass_kg: float) -> str:
    """Return a frame file; keys as in ArduPilot's SIM_Frame.cpp, which knows no products of inertia.

    Parameters
    ----------
    inertia_kg_m2 : ndarray, shape (3, 3)
    mass_kg : float
        NaN where it is not known: the simulator's own is then left.

    Returns
    -------
    str
        JSON.
    """
    content: dict[str, object] = {}
    if math.isfinite(mass_kg):
        content["mass"] = float(f"{mass_kg:.6g}")
    content["moment_inertia"] = [float(f"{value:.6g}") for value in np.diagonal(inertia_kg_m2)]
    return json.dumps(content, indent=1) + "\n"
