"""Betaflight's flight modes from the slow frames, which hold one bit for each mode that is switched on."""

from __future__ import annotations

from typing import Final

import numpy as np

from quadid_logs.autopilots.modes import mode_changes
from quadid_logs.containers.blackbox import FrameTable
from quadid_logs.data.log import ModeChange, Rows

#: ``fc/rc_modes.h``: BOXANGLE and BOXHORIZON; without them the sticks command rates.
_ANGLE, _HORIZON = 1 << 1, 1 << 2
#: Of slow frames, by mode.
MODE_FLAGS: Final = {"Acro": 0, "Angle": _ANGLE, "Horizon": _HORIZON}
_NAMES: Final = {flags: name for name, flags in MODE_FLAGS.items()} | {_ANGLE | _HORIZON: "Angle"}
#: Modes with an angle loop around the rate loop.
SELF_LEVELLING: Final = ("Angle", "Horizon")


def flight_modes(slow: FrameTable | None, rows: Rows) -> tuple[ModeChange, ...]:
    """Return the modes; a slow frame has no time, and stands before the main frame that it belongs to.

    Parameters
    ----------
    rows : Rows
        Of the main frames.
    """
    flags = None if slow is None else slow.column("flightModeFlags")
    if slow is None or flags is None or not len(flags):
        return ()
    row = np.minimum(np.searchsorted(rows.position, slow.position), rows.n_samples - 1)
    numbers = flags.astype(np.int64) & (_ANGLE | _HORIZON)
    return mode_changes(numbers, rows.time_s[row], slow.position, _NAMES.get)
