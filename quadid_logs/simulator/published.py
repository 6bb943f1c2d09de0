"""Inertias of multirotors that others have published."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from quadid_logs.vocabulary import GRAVITY_M_S2


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedVehicle:
    """A vehicle with a citable inertia: mass [kg], Ixx, Iyy, Izz [kg m^2], and where it is said.

    ``lever_m`` is the distance of its rotors from the roll axis, by the same source.
    """

    name: str
    mass_kg: float
    inertia_kg_m2: tuple[float, float, float]
    lever_m: float
    source: str

    @property
    def roll_effectiveness(self) -> float:
        """Angular acceleration at full roll command [rad/s^2], if the rotors can lift twice the weight.

        A normalised command of one moves half of the largest thrust on each side: m g l / Ixx.
        """
        return self.mass_kg * GRAVITY_M_S2 * self.lever_m / self.inertia_kg_m2[0]


PUBLISHED: Final = (
    PublishedVehicle(
        name="Crazyflie 2.0",
        mass_kg=0.027,
        inertia_kg_m2=(16.571710e-6, 16.655602e-6, 29.261652e-6),
        lever_m=0.0325,
        source="J. Förster, ETH Zürich, 2015, as in crazyflie-firmware",
    ),
    PublishedVehicle(
        name="AscTec Hummingbird",
        mass_kg=0.5,
        inertia_kg_m2=(3.65e-3, 3.68e-3, 7.03e-3),
        lever_m=0.1202,
        source="RotorPy, hummingbird_params.py",
    ),
    PublishedVehicle(
        name="Iris (RotorS)",
        mass_kg=1.5,
        inertia_kg_m2=(0.0347563, 0.0458929, 0.0977),
        lever_m=0.21,
        source="RotorS, widely copied",
    ),
    PublishedVehicle(
        name="Iris (PX4, Gazebo classic)",
        mass_kg=1.5,
        inertia_kg_m2=(0.029125, 0.029125, 0.055225),
        lever_m=0.21,
        source="ETH Zürich, quadrotor_model.yaml",
    ),
    PublishedVehicle(
        name="x500 (PX4, Gazebo) with propellers",
        mass_kg=2.064,
        inertia_kg_m2=(0.0236, 0.0236, 0.0439),
        lever_m=0.174,
        source="PX4 model.sdf, its parts summed",
    ),
    PublishedVehicle(
        name="ArduPilot SITL quadrotor",
        mass_kg=3.0,
        inertia_kg_m2=(0.02297, 0.02297, 0.04594),
        lever_m=0.1237,
        source="ArduPilot, SIM_Frame.cpp: half the mass on a ring of 0.35 m",
    ),
)
