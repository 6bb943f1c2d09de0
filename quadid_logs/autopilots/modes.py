"""Flight modes from numbers that are logged again and again."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Final

import numpy as np

from quadid_logs.arrays import AnyArray, BoolArray, FloatArray, IntArray
from quadid_logs.containers.mavlink_dialect import enum_names
from quadid_logs.data.log import ModeChange

#: ArduPilot's mode enumeration by vehicle; there are no others that fly it.
_MODE_ENUMS: Final = {
    "multirotor": "COPTER_MODE", "helicopter": "COPTER_MODE", "fixed-wing": "PLANE_MODE",
    "vtol": "PLANE_MODE", "rover": "ROVER_MODE", "boat": "ROVER_MODE",
    "submarine": "SUB_MODE", "tracker": "TRACKER_MODE",
}  # fmt: skip


def ardupilot_modes(vehicle_type: str) -> Mapping[int, str]:
    """Return the names of ArduPilot's flight modes by number, empty for a vehicle of unknown kind."""
    enum = _MODE_ENUMS.get(vehicle_type, "")
    return enum_names(enum, f"{enum}_")


def mode_changes(
    numbers: AnyArray, time_s: FloatArray, position: IntArray, name_of: Callable[[int], str | None]
) -> tuple[ModeChange, ...]:
    """Return the first mode and every change.

    Parameters
    ----------
    numbers : ndarray of integers, shape (n_rows,)
    time_s, position : ndarray, shape (n_rows,)
        When [s] and where in the file they were logged.
    name_of : callable
        Returns the name of a number, None where it has none.
    """
    changes = np.flatnonzero(np.append(True, numbers[1:] != numbers[:-1]))
    return tuple(
        ModeChange(
            time_s=float(time_s[row]),
            position=int(position[row]),
            name=name_of(int(numbers[row])) or f"mode {int(numbers[row])}",
        )
        for row in changes.tolist()
    )


def in_modes(modes: Sequence[ModeChange], names: Collection[str], time_s: FloatArray) -> BoolArray:
    """Mark the times at which one of some modes was on.

    Parameters
    ----------
    time_s : ndarray, shape (n,)

    Returns
    -------
    ndarray of bool, shape (n,)
        The first mode counts from the beginning.
    """
    if not modes:
        return np.zeros(time_s.shape, np.bool_)
    on = np.array([one.name in names for one in modes])
    order = np.argsort([one.time_s for one in modes], kind="stable")
    starts = np.array([one.time_s for one in modes])[order]
    return np.asarray(on[order][np.maximum(np.searchsorted(starts, time_s, side="right") - 1, 0)], np.bool_)
