"""Properties of the vehicle that a user can give in a TOML file."""

from __future__ import annotations

from dataclasses import dataclass

from quadid_logs.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Rotor:
    """A rotor: position from the centre of mass in FRD [m], and spin "ccw" or "cw", seen from above."""

    position_m: tuple[float, float, float]
    spin: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Vehicle:
    """Known properties of a vehicle. They take precedence over the log's parameters; None means not given.

    ``inertia_kg_m2`` (3, 3) is only compared with the estimate, never used in a fit; NaN means not measured.
    ``max_thrust_n`` [N] and ``thrust_curve`` (n_points, 2) (command, thrust [N]) are those of one rotor.
    ``path`` is the file that the values were read from, "" for none.

    Examples
    --------
    >>> from quadid_logs import Vehicle
    >>> Vehicle(mass_kg=1.5, arm_length_m=0.225).mass_kg
    1.5
    """

    name: str = ""
    mass_kg: float | None = None
    arm_length_m: float | None = None
    rotors: tuple[Rotor, ...] = ()
    max_thrust_n: float | None = None
    thrust_curve: FloatArray | None = None
    torque_to_thrust_m: float | None = None
    inertia_kg_m2: FloatArray | None = None
    path: str = ""
