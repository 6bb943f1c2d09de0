"""Betaflight's frames: how each mixes, where its rotors are, and which of them are only known by name.

The numbers are those of its motor table (``mixer_init.c``): roll, pitch and yaw of each motor in its order.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray

#: The table's roll is that of the body; its pitch is nose down, and its yaw factor, which the firmware takes
#: negative, so nose right.
_TO_FRD: Final = np.array([1.0, -1.0, 1.0])
_SIN_60: Final = 0.866025
_SIN_45: Final = 0.707107
_TAN_22: Final = 0.414178
_Y_REAR: Final = 1.333333
_Y_FRONT: Final = -0.666667


class Frame(NamedTuple):
    """One frame of the motor table.

    Attributes
    ----------
    name : str
        For people.
    mixer : ndarray, shape (n_rotors, 3)
        Of roll, pitch and yaw, FRD, for propellers turning as in the table.
    position : ndarray, shape (n_rotors, 3)
        FRD, the longest arm 1.
    unread : str
        Why the torque does not follow from the thrusts; empty where it does.
    """

    name: str
    mixer: FloatArray
    position: FloatArray
    unread: str = ""


def _frame(name: str, *rows: tuple[float, float, float], unread: str = "") -> Frame:
    """Return a frame whose rotors stand where the table's lever arms put them."""
    mixer = np.array(rows) * _TO_FRD
    position = np.column_stack([mixer[:, 1], -mixer[:, 0], np.zeros(len(rows))])
    longest = np.linalg.norm(position, axis=1).max()
    return Frame(name, mixer, position / longest, unread)


_V_TAIL: Final = "its rear rotors lean, so their thrust also yaws it"
_Y4: Final = "the drag of its front rotors yaws it, which the mixer leaves out"
_H_FRAME: Final = "no table holds the arms of its middle rotors, which the mixer leaves out"

FRAMES: Final[tuple[Frame, ...]] = (
    _frame("quad X", (-1, 1, -1), (-1, -1, 1), (1, 1, 1), (1, -1, -1)),
    _frame("quad X, motors numbered clockwise", (1, -1, -1), (-1, -1, 1), (-1, 1, -1), (1, 1, 1)),
    _frame("quad plus", (0, 1, -1), (-1, 0, 1), (1, 0, 1), (0, -1, -1)),
    _frame("Y4", (0, 1, -1), (-1, -1, 0), (0, 1, 1), (1, -1, 0), unread=_Y4),
    # An A-tail is a V-tail whose rotors turn the other way round.
    _frame("V-tail or A-tail quad", (-0.58, 0.58, 1), (-0.46, -0.39, -0.5), (0.58, 0.58, -1),
           (0.46, -0.39, 0.5), unread=_V_TAIL),
    _frame("hexa X", (-0.5, _SIN_60, 1), (-0.5, -_SIN_60, 1), (0.5, _SIN_60, -1), (0.5, -_SIN_60, -1),
           (-1, 0, -1), (1, 0, 1)),
    _frame("hexa plus", (-_SIN_60, 0.5, 1), (-_SIN_60, -0.5, -1), (_SIN_60, 0.5, 1), (_SIN_60, -0.5, -1),
           (0, -1, 1), (0, 1, -1)),
    _frame("hexa H", (-1, 1, -1), (-1, -1, 1), (1, 1, 1), (1, -1, -1), (0, 0, 0), (0, 0, 0), unread=_H_FRAME),
    _frame("Y6", (0, _Y_REAR, 1), (-1, _Y_FRONT, -1), (1, _Y_FRONT, -1),
           (0, _Y_REAR, -1), (-1, _Y_FRONT, 1), (1, _Y_FRONT, 1)),
    _frame("octo X8", (-1, 1, -1), (-1, -1, 1), (1, 1, 1), (1, -1, -1),
           (-1, 1, 1), (-1, -1, -1), (1, 1, -1), (1, -1, 1)),
    _frame("octo plus", (_SIN_45, -_SIN_45, 1), (-_SIN_45, -_SIN_45, 1), (-_SIN_45, _SIN_45, 1),
           (_SIN_45, _SIN_45, 1), (0, -1, -1), (-1, 0, -1), (0, 1, -1), (1, 0, -1)),
    _frame("octo X", (1, -_TAN_22, 1), (-_TAN_22, -1, 1), (-1, _TAN_22, 1), (_TAN_22, 1, 1),
           (_TAN_22, -1, -1), (-1, -_TAN_22, -1), (-_TAN_22, 1, -1), (1, _TAN_22, -1)),
)  # fmt: skip

#: What flies with so few motors, and what turns it instead.
FEW_MOTORS: Final = {
    1: "an aeroplane, a flying wing or a helicopter, turned by control surfaces or a swash plate",
    2: "an aeroplane or a bicopter, turned by servos",
    3: "a tricopter, yawed by a servo that tilts its rear rotor",
}
