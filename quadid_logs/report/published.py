"""Inertias that others have published, and the user's own, to hold an identified one against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.model import Inertia
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.report.numbers import number


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedVehicle:
    """A vehicle with a citable inertia: mass [kg], Ixx, Iyy, Izz [kg m^2], and where it is said."""

    name: str
    mass_kg: float
    inertia_kg_m2: tuple[float, float, float]
    source: str


PUBLISHED: Final = (
    PublishedVehicle(
        name="Crazyflie 2.0",
        mass_kg=0.027,
        inertia_kg_m2=(16.571710e-6, 16.655602e-6, 29.261652e-6),
        source="J. Förster, ETH Zürich, 2015, as in crazyflie-firmware",
    ),
    PublishedVehicle(
        name="AscTec Hummingbird",
        mass_kg=0.5,
        inertia_kg_m2=(3.65e-3, 3.68e-3, 7.03e-3),
        source="RotorPy, hummingbird_params.py",
    ),
    PublishedVehicle(
        name="Iris (RotorS)",
        mass_kg=1.5,
        inertia_kg_m2=(0.0347563, 0.0458929, 0.0977),
        source="RotorS, widely copied",
    ),
    PublishedVehicle(
        name="Iris (PX4, Gazebo classic)",
        mass_kg=1.5,
        inertia_kg_m2=(0.029125, 0.029125, 0.055225),
        source="ETH Zürich, quadrotor_model.yaml",
    ),
    PublishedVehicle(
        name="x500 (PX4, Gazebo) with propellers",
        mass_kg=2.064,
        inertia_kg_m2=(0.0236, 0.0236, 0.0439),
        source="PX4 model.sdf, its parts summed",
    ),
    PublishedVehicle(
        name="ArduPilot SITL quadrotor",
        mass_kg=3.0,
        inertia_kg_m2=(0.02297, 0.02297, 0.04594),
        source="ArduPilot, SIM_Frame.cpp: half the mass on a ring of 0.35 m",
    ),
)


def comparison_rows(inertia: Inertia, vehicle: Vehicle | None) -> list[tuple[str, str, str, list[str]]]:
    """Return name, mass, source and Ixx, Iyy, Izz in words: ours, the user's own, then the published.

    Published vehicles stand in order of their distance from ours, the mean
    ratio of the moments.
    """
    own = np.diagonal(inertia.matrix)
    mass = vehicle.mass_kg if vehicle is not None else None
    rows = [("this flight", "–" if mass is None else number(mass, 3), "identified", _moments(own))]
    if vehicle is not None and vehicle.inertia_kg_m2 is not None:
        given = np.diagonal(np.asarray(vehicle.inertia_kg_m2, dtype=np.float64))
        rows.append(("given with --vehicle", rows[0][1], _agreement(inertia, given), _moments(given)))
    for item in sorted(PUBLISHED, key=lambda item: _distance(own, item)):
        moments = np.array(item.inertia_kg_m2)
        rows.append((item.name, number(item.mass_kg, 3), item.source, _moments(moments)))
    return rows


def _moments(values: FloatArray) -> list[str]:
    return [number(float(value), 3) for value in values]


def _distance(own: FloatArray, item: PublishedVehicle) -> float:
    """Return how far apart two vehicles are, over the moments that are known."""
    known = np.isfinite(own) & (own > 0.0)
    if not known.any():
        return 0.0
    return float(np.abs(np.mean(np.log(own[known] / np.array(item.inertia_kg_m2)[known]))))


def _agreement(inertia: Inertia, given: FloatArray) -> str:
    """Say about which axes the given moments lie within the identified intervals."""
    low, high = np.diagonal(inertia.ci95_low), np.diagonal(inertia.ci95_high)
    known = np.isfinite(low) & np.isfinite(high)
    inside = known & (low <= given) & (given <= high)
    texts = []
    for words, chosen in (("within the interval", inside), ("outside the interval", known & ~inside)):
        names = [name for name, yes in zip(("Ixx", "Iyy", "Izz"), chosen, strict=True) if yes]
        if names:
            texts.append(f"{', '.join(names)} {words}")
    return "; ".join(texts) or "not comparable"
