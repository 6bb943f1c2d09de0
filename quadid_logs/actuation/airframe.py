"""A multirotor as its torque needs it: places and spin of the rotors, and how commands are mixed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.maths.frames import normalised_allocation, torque_matrix

#: Drag torque over thrust of an ordinary propeller [m]; of rotors that are only drawn, any value serves.
_TYPICAL_RATIO_M: Final = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Airframe:
    """Geometry and mixing of a multirotor.

    Attributes
    ----------
    name, source : str
        In words, and what says so.
    factors : ndarray, shape (n_rotors, 4)
        Motor thrust per unit of roll, pitch, yaw and throttle command.
    position : ndarray, shape (n_rotors, 3)
        FRD, in metres if ``in_metres``, else the longest arm is 1.
    spin : ndarray, shape (n_rotors,)
        +1 counter-clockwise from above, -1 clockwise.
    channels : tuple of int
        Output channel of each motor, from 1; empty if outputs come per motor.
    max_thrust_n, torque_to_thrust_m : float
        From parameters that are not untouched defaults; NaN otherwise.
    thrust_source : str
        The parameter that says ``max_thrust_n``.
    yaw_with_command : bool
        The drag torque goes with thrust times motor command, as no real propeller's does.
    yaw_remark : str
        Why that is so.
    remarks : tuple of str
        What had to be assumed.
    refused : tuple of str
        Which parameters look like a calibration but are none, and why.
    """

    name: str
    source: str
    factors: FloatArray
    position: FloatArray
    spin: FloatArray
    in_metres: bool = False
    channels: tuple[int, ...] = ()
    channel_source: str = ""
    max_thrust_n: float = float("nan")
    torque_to_thrust_m: float = float("nan")
    thrust_source: str = ""
    yaw_with_command: bool = False
    yaw_remark: str = ""
    remarks: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()

    @property
    def n_rotors(self) -> int:
        """Number of motors."""
        return int(self.spin.shape[0])

    @property
    def command_per_thrust(self) -> FloatArray:
        """Roll, pitch and yaw command per unit of each motor's thrust; shape (3, n_rotors).

        The inverse of the mixing where nothing is limited, by least squares.
        """
        return np.asarray(np.linalg.pinv(self.factors)[:3], dtype=np.float64)

    @property
    def inverts(self) -> bool:
        """Whether the command follows from the motors' thrusts, because no two commands mix alike."""
        return bool(
            np.isfinite(self.factors).all() and np.linalg.matrix_rank(self.factors) == self.factors.shape[1]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """Why the airframe is not known, and what to pass with --vehicle."""

    remark: str
    need: str = "[[rotor]] tables with position_m and spin of every motor, in the order of the motors"


def with_rotors(found: Airframe | Unknown, vehicle: Vehicle | None) -> Airframe | Unknown:
    """Take positions and spin from the vehicle file, mixing from the log if the number fits.

    Parameters
    ----------
    found : Airframe or Unknown
        What the log says.
    vehicle : Vehicle or None

    Returns
    -------
    Airframe or Unknown
        ``found`` where the file names no rotors.
    """
    if vehicle is None or not vehicle.rotors:
        return found
    position = np.array([rotor.position_m for rotor in vehicle.rotors], dtype=np.float64)
    spin = np.array([1.0 if rotor.spin == "ccw" else -1.0 for rotor in vehicle.rotors])
    if isinstance(found, Unknown):
        effectiveness = np.vstack([torque_matrix(position, spin, _TYPICAL_RATIO_M), -np.ones(len(spin))])
        return Airframe(
            name=f"{len(spin)} rotors",
            source="vehicle file",
            factors=normalised_allocation(effectiveness),
            position=position,
            spin=spin,
            in_metres=True,
            remarks=(
                f"{found.remark} How commands are mixed to motors is unknown, so the rotors of the vehicle "
                "file are only drawn.",
            ),
        )
    if found.n_rotors != len(spin):
        return Unknown(
            remark=f"The vehicle file has {len(spin)} rotors, the log says {found.name} ({found.source}).",
            need=f"{found.n_rotors} [[rotor]] tables, in the order of the motors",
        )
    return replace(
        found, source=f"vehicle file; {found.source}", position=position, spin=spin, in_metres=True
    )
