"""ArduPilot's frames: where the rotors are, how they spin, and how they are mixed.

The numbers are those of its motor table (libraries/AP_Motors/AP_MotorsMatrix.cpp),
keyed by its FRAME_CLASS and FRAME_TYPE. Angles run clockwise from the nose as
seen from above; a rotor that turns counter-clockwise (+1) pushes the nose to
the right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.errors import ShapeError

FRAME_CLASSES: Final = {
    1: "quad",
    2: "hexa",
    3: "octa",
    4: "octaquad",
    5: "y6",
    12: "dodecahexa",
    14: "deca",
}
FRAME_TYPES: Final = {
    0: "plus",
    1: "x",
    2: "v",
    3: "h",
    4: "vtail",
    5: "atail",
    6: "plusrev",
    10: "y6b",
    11: "y6f",
    12: "bf_x",
    13: "dji_x",
    14: "cw_x",
    15: "i",
    18: "bf_x_rev",
    19: "y4",
}

_CCW: Final = 1.0
_CW: Final = -1.0


def _alternating(*angles: float) -> tuple[tuple[float, float], ...]:
    """Rotors in turn counter-clockwise and clockwise."""
    return tuple((angle, _CCW if i % 2 == 0 else _CW) for i, angle in enumerate(angles))


def _spun(angles: tuple[float, ...], yaw: tuple[float, ...]) -> tuple[tuple[float, float], ...]:
    """Pair each arm with its yaw factor."""
    return tuple(zip(angles, yaw, strict=True))


_OCTAQUAD_X: Final = (45.0, -45.0, -135.0, 135.0, -45.0, 45.0, 135.0, -135.0)
_OCTA_SPIN: Final = (_CW, _CW, _CCW, _CCW, _CCW, _CCW, _CW, _CW)
_DODECA_SPIN: Final = (_CCW, _CW, _CW, _CCW) * 3

# (angle of the arm [deg], yaw factor) per motor, by (FRAME_CLASS, FRAME_TYPE).
_BY_ANGLE: Final = {
    (1, 0): _spun((90, -90, 0, 180), (_CCW, _CCW, _CW, _CW)),
    (1, 1): _spun((45, -135, -45, 135), (_CCW, _CCW, _CW, _CW)),
    (1, 2): _spun((45, -135, -45, 135), (0.7981, 1.0, -0.7981, -1.0)),
    (1, 3): _spun((45, -135, -45, 135), (_CW, _CW, _CCW, _CCW)),
    (1, 6): _spun((90, -90, 0, 180), (_CW, _CW, _CCW, _CCW)),
    (1, 12): _spun((135, 45, -135, -45), (_CW, _CCW, _CCW, _CW)),
    (1, 13): _alternating(45, -45, -135, 135),
    (1, 14): _alternating(45, 135, -135, -45),
    (1, 18): _spun((135, 45, -135, -45), (_CCW, _CW, _CW, _CCW)),
    (2, 0): _spun((0, 180, -120, 60, -60, 120), (_CW, _CCW, _CW, _CCW, _CCW, _CW)),
    (2, 1): _spun((90, -90, -30, 150, 30, -150), (_CW, _CCW, _CW, _CCW, _CCW, _CW)),
    (2, 13): _alternating(30, -30, -90, -150, 150, 90),
    (2, 14): _alternating(30, 90, 150, -150, -90, -30),
    (3, 0): _spun((0, 180, 45, 135, -45, -135, -90, 90), _OCTA_SPIN),
    (3, 1): _spun((22.5, -157.5, 67.5, 157.5, -22.5, -112.5, -67.5, 112.5), _OCTA_SPIN),
    (3, 13): _alternating(22.5, -22.5, -67.5, -112.5, -157.5, 157.5, 112.5, 67.5),
    (3, 14): _alternating(22.5, 67.5, 112.5, 157.5, -157.5, -112.5, -67.5, -22.5),
    (4, 0): _alternating(0, -90, 180, 90, -90, 0, 90, 180),
    (4, 1): _alternating(*_OCTAQUAD_X),
    (4, 2): _spun(_OCTAQUAD_X, (0.7981, -0.7981, 1.0, -1.0) * 2),
    (4, 3): _spun(_OCTAQUAD_X, (_CW, _CCW) * 4),
    (4, 12): _spun((135, 45, -135, -45, 135, 45, -135, -45), (_CW, _CCW, _CCW, _CW, _CCW, _CW, _CW, _CCW)),
    (4, 14): _spun((45, 45, 135, 135, -135, -135, -45, -45), (_CCW, _CW, _CW, _CCW) * 2),
    (4, 18): _spun((135, 45, -135, -45, 135, 45, -135, -45), (_CCW, _CW, _CW, _CCW, _CW, _CCW, _CCW, _CW)),
    (12, 0): _spun((0, 0, 60, 60, 120, 120, 180, 180, -120, -120, -60, -60), _DODECA_SPIN),
    (12, 1): _spun((30, 30, 90, 90, 150, 150, -150, -150, -90, -90, -30, -30), _DODECA_SPIN),
    (14, 0): _alternating(0, 36, 72, 108, 144, 180, -144, -108, -72, -36),
    (14, 1): _alternating(18, 54, 90, 126, 162, -162, -126, -90, -54, -18),
    (14, 14): _alternating(18, 54, 90, 126, 162, -162, -126, -90, -54, -18),
}

# (roll, pitch, yaw factor) per motor, for frames that are not defined by an angle alone.
_BY_FACTOR: Final = {
    (1, 4): ((60.0, 60.0, 0.0), (0.0, -160.0, _CW), (-60.0, -60.0, 0.0), (0.0, 160.0, _CCW)),
    (1, 5): ((60.0, 60.0, 0.0), (0.0, -160.0, _CCW), (-60.0, -60.0, 0.0), (0.0, 160.0, _CW)),
    (1, 19): ((-1.0, 1.0, _CCW), (0.0, -1.0, _CW), (0.0, -1.0, _CCW), (1.0, 1.0, _CW)),
    (2, 3): (
        (-1.0, 0.0, _CW),
        (1.0, 0.0, _CCW),
        (1.0, 1.0, _CW),
        (-1.0, -1.0, _CCW),
        (-1.0, 1.0, _CCW),
        (1.0, -1.0, _CW),
    ),
    (3, 2): (
        (0.83, 0.34, _CW),
        (-0.67, -0.32, _CW),
        (0.67, -0.32, _CCW),
        (-0.5, -1.0, _CCW),
        (1.0, 1.0, _CCW),
        (-0.83, 0.34, _CCW),
        (-1.0, 1.0, _CW),
        (0.5, -1.0, _CW),
    ),
    (3, 3): (
        (-1.0, 1.0, _CW),
        (1.0, -1.0, _CW),
        (-1.0, 0.333, _CCW),
        (-1.0, -1.0, _CCW),
        (1.0, 1.0, _CCW),
        (1.0, -0.333, _CCW),
        (1.0, 0.333, _CW),
        (-1.0, -0.333, _CW),
    ),
    (3, 15): (
        (0.333, -1.0, _CW),
        (-0.333, 1.0, _CW),
        (1.0, -1.0, _CCW),
        (0.333, 1.0, _CCW),
        (-0.333, -1.0, _CCW),
        (-1.0, 1.0, _CCW),
        (-1.0, -1.0, _CW),
        (1.0, 1.0, _CW),
    ),
    (5, 10): (
        (-1.0, 0.5, _CW),
        (-1.0, 0.5, _CCW),
        (0.0, -1.0, _CW),
        (0.0, -1.0, _CCW),
        (1.0, 0.5, _CW),
        (1.0, 0.5, _CCW),
    ),
    (5, 11): (
        (0.0, -1.0, _CCW),
        (-1.0, 0.5, _CCW),
        (1.0, 0.5, _CCW),
        (0.0, -1.0, _CW),
        (-1.0, 0.5, _CW),
        (1.0, 0.5, _CW),
    ),
    (5, 0): (
        (-1.0, 0.666, _CCW),
        (1.0, 0.666, _CW),
        (1.0, 0.666, _CCW),
        (0.0, -1.333, _CW),
        (-1.0, 0.666, _CW),
        (0.0, -1.333, _CCW),
    ),
}
_TAILS: Final = ((1, 4), (1, 5))
_Y6_ARM_DEG: Final = {-1.0: 60.0, 0.0: 180.0, 1.0: -60.0}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One airframe of the motor table.

    Attributes
    ----------
    name : str
        For people, for example "quad x".
    mixer : ndarray, shape (n_rotors, 3)
        Roll, pitch and yaw factor, the largest of each axis 0.5 [1].
    position : ndarray, shape (n_rotors, 3)
        FRD, the longest arm 1 [arm lengths]. Coaxial rotors have the same place.
    spin : ndarray, shape (n_rotors,)
        +1 counter-clockwise from above, -1 clockwise, 0 where the table has no yaw.
    """

    name: str
    mixer: FloatArray
    position: FloatArray
    spin: FloatArray

    @property
    def n_rotors(self) -> int:
        """Number of motors."""
        return int(self.spin.shape[0])


def known_frames() -> tuple[tuple[int, int], ...]:
    """Return every (FRAME_CLASS, FRAME_TYPE) of the table."""
    return tuple(sorted((*_BY_ANGLE, *_BY_FACTOR)))


def frame_geometry(frame_class: int, frame_type: int) -> Frame:
    """Look an airframe up by ArduPilot's FRAME_CLASS and FRAME_TYPE.

    A Y6 of any type that the table does not name is the original Y6, as in
    the firmware.

    Raises
    ------
    ShapeError
        If the table has no such airframe.

    Examples
    --------
    >>> frame_geometry(1, 1).mixer[0].round(3).tolist()
    [-0.5, 0.5, 0.5]
    """
    key = (frame_class, frame_type)
    if frame_class == 5 and key not in _BY_FACTOR:
        key = (5, 0)
    if key not in known_frames():
        raise ShapeError(f"There is no multirotor with FRAME_CLASS {frame_class}, FRAME_TYPE {frame_type}.")
    if key in _BY_ANGLE:
        angle_deg, yaw = np.asarray(_BY_ANGLE[key], dtype=np.float64).T
        x, y = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
        factors = np.column_stack([-y, x, yaw])
    else:
        factors = np.asarray(_BY_FACTOR[key], dtype=np.float64)
        x, y = factors[:, 1], -factors[:, 0]
        if key in _TAILS:
            roll_deg, pitch_deg, yaw = factors.T
            x, y = np.cos(np.deg2rad(pitch_deg)), np.sin(np.deg2rad(pitch_deg))
            factors = np.column_stack([-np.sin(np.deg2rad(roll_deg)), x, yaw])
        elif frame_class == 5:
            arm = np.deg2rad([_Y6_ARM_DEG[float(roll)] for roll in factors[:, 0]])
            x, y = np.cos(arm), np.sin(arm)
        reach = np.hypot(x, y).max()
        x, y = x / reach, y / reach
    factors, position = (
        # What only rounding keeps from zero is zero, so that no axis leaks.
        np.where(np.abs(each) < 1e-12, 0.0, each)
        for each in (factors, np.column_stack([x, y, np.zeros_like(x)]))
    )
    return Frame(
        name=f"{FRAME_CLASSES[key[0]]} {FRAME_TYPES.get(frame_type, str(frame_type))}",
        mixer=0.5 * factors / np.abs(factors).max(axis=0),
        position=position,
        spin=np.sign(factors[:, 2]),
    )
