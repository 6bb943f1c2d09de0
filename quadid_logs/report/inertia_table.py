"""The identified moments of inertia beside the user's own and published ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.model import Inertia
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.report.numbers import number

if TYPE_CHECKING:
    from quadid_logs.simulator.published import PublishedVehicle


def comparison_rows(inertia: Inertia, vehicle: Vehicle | None) -> list[tuple[str, str, str, list[str]]]:
    """Return name, mass, source and Ixx, Iyy, Izz in words: ours, the user's own, then the published.

    Published vehicles stand in order of their distance from ours, the mean
    ratio of the moments.
    """
    # Not at the top: it brings the whole simulator with it.
    from quadid_logs.simulator.published import PUBLISHED

    identified = np.diagonal(inertia.matrix)
    mass = vehicle.mass_kg if vehicle is not None else None
    rows = [("this flight", "–" if mass is None else number(mass, 3), "identified", _moments(identified))]
    if vehicle is not None and vehicle.inertia_kg_m2 is not None:
        given = np.diagonal(np.asarray(vehicle.inertia_kg_m2, dtype=np.float64))
        # Say about which axes the given moments lie within the identified intervals.
        low, high = np.diagonal(inertia.ci95_low), np.diagonal(inertia.ci95_high)
        known = np.isfinite(low) & np.isfinite(high) & np.isfinite(given)
        inside = known & (low <= given) & (given <= high)
        texts = []
        for words, chosen in (("within the interval", inside), ("outside the interval", known & ~inside)):
            names = [name for name, yes in zip(("Ixx", "Iyy", "Izz"), chosen, strict=True) if yes]
            if names:
                texts.append(f"{', '.join(names)} {words}")
        rows.append(
            ("given with --vehicle", rows[0][1], ("; ".join(texts) or "not comparable"), _moments(given))
        )
    # How far apart two vehicles are, over the moments that are known.
    sure = np.isfinite(identified) & (identified > 0.0)

    def distance(item: PublishedVehicle) -> float:
        if not sure.any():
            return 0.0
        return float(np.abs(np.mean(np.log(identified[sure] / np.array(item.inertia_kg_m2)[sure]))))

    for item in sorted(PUBLISHED, key=distance):
        moments = np.array(item.inertia_kg_m2)
        rows.append((item.name, number(item.mass_kg, 3), item.source, _moments(moments)))
    return rows


def _moments(values: FloatArray) -> list[str]:
    return [number(float(value), 3) for value in values]
