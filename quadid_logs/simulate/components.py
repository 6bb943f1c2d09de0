"""Values of one flight as floats, of many flights as arrays of one value per flight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.rotational_dynamics import Triple
from quadid_logs.maths.rotations import Component


def stacked(values: Sequence[float]) -> Component:
    """Make a float of one flight's value, an array of many flights' values."""
    return float(values[0]) if len(values) == 1 else np.asarray(values, dtype=np.float64)


def vector(vectors: Sequence[FloatArray]) -> Triple:
    """Stack one 3-vector per flight into components."""
    p, q, r = (stacked([float(vector[axis]) for vector in vectors]) for axis in range(3))
    return p, q, r
