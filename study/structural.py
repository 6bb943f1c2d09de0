"""Draw structural effects: what real vehicles and logs do, and the fitted model does not know."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from quadid_logs.simulator import manoeuvres
from quadid_logs.simulator.airframes import SimulatedAirframe
from quadid_logs.simulator.effects import Effects

#: Angular acceleration that a hovering research vehicle leaves unexplained between 0.3 and 5 Hz [rad/s^2].
FLOWN_DISTURBANCE_RAD_S2: Final = np.array([1.3, 1.3, 0.43])
#: Half of the flights have no structural effect; air as rough as flown is none, and comes with 40 % of all.
CLEAN_FRACTION: Final = 0.5
ROUGH_FRACTION: Final = 0.4
#: A second effect comes with a quarter of the flights that have one.
SECOND_FRACTION: Final = 0.25


class Structural(NamedTuple):
    """What a flight has beside rigid body, rotors, wind and noise.

    ``clipped_fraction`` is that of the commands beyond the limit of an unlogged
    saturation; ``manoeuvre`` replaces the one drawn before, ``rotor_inertia_kg_m2`` that of each rotor,
    ``drag_height_m`` how high above the centre of mass the drag acts, unless it is None.
    """

    names: tuple[str, ...]
    effects: Effects
    clipped_fraction: float = 0.0
    manoeuvre: Callable[..., Any] | None = None
    rotor_inertia_kg_m2: float = 0.0
    drag_height_m: float | None = None

    def on(self, airframe: SimulatedAirframe) -> SimulatedAirframe:
        """Return the airframe with what the effects make of it."""
        height_m = airframe.drag_height_m if self.drag_height_m is None else self.drag_height_m
        return dataclasses.replace(
            airframe, rotor_inertia_kg_m2=self.rotor_inertia_kg_m2, drag_height_m=height_m
        )


def draw_structural(seed: int, number: int, airframe: SimulatedAirframe) -> Structural:
    """Draw the effects of one flight, by random numbers of their own: the rest of the flight is as without.

    Parameters
    ----------
    seed, number : int
        Of the study and of the flight.
    airframe : SimulatedAirframe

    Returns
    -------
    Structural
    """
    rng = np.random.default_rng([seed, number, *b"structural effects"])
    fields: dict[str, Any] = {}
    if rng.random() < ROUGH_FRACTION:
        size = rng.uniform(0.7, 1.3) * FLOWN_DISTURBANCE_RAD_S2
        fields["disturbance_rad_s2"] = tuple(size.tolist())
    if rng.random() < CLEAN_FRACTION:
        return Structural((), Effects(**fields))
    n_effects = 2 if rng.random() < SECOND_FRACTION else 1
    names = tuple(sorted(rng.choice(list(EFFECTS), n_effects, replace=False).tolist()))
    drawn: dict[str, Any] = {}
    for name in names:
        drawn |= EFFECTS[name](rng, airframe)
    beside = {name: drawn.pop(name) for name in Structural._fields if name in drawn}
    return Structural(names, Effects(**fields, **drawn), **beside)


def _tilt_stiffness(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:  # noqa: ARG001
    """Let a tilt grow, or swing back as a pendulum, at 0.25 to 0.6 Hz."""
    return {"tilt_stiffness_1_s2": rng.choice([-1.0, 1.0]) * (2.0 * math.pi * rng.uniform(0.25, 0.6)) ** 2}


def _sling_load(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:
    """Hang 5 to 20 % of the vehicle's mass on a string, hooked below the centre of mass."""
    reach = float(np.hypot(*airframe.position_m[:, :2].T).max())
    return {
        "sling_load_fraction": rng.uniform(0.05, 0.2),
        "sling_length_m": rng.uniform(0.5, 2.0),
        "sling_hook_m": rng.uniform(0.1, 0.4) * reach,
    }


def _dead_zone(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:  # noqa: ARG001
    """Take 0.5 to 4 % of the full command."""
    return {"dead_zone": log_uniform(rng, 0.005, 0.04)}


def _rotor_dead_zone(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:  # noqa: ARG001
    """Let each rotor ignore changes of its command below 0.1 to 4 % of the whole."""
    return {"rotor_dead_zone": log_uniform(rng, 0.001, 0.04)}


def _saturation(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:  # noqa: ARG001
    """Clip 1 to 8 % of the commands, more when the controller answers, and tell nobody."""
    return {"clipped_fraction": rng.uniform(0.01, 0.08)}


def _alternating(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:  # noqa: ARG001
    """Move the effectiveness up and down by 10 to 30 % every few seconds."""
    return {"gain_swing": rng.uniform(0.1, 0.3), "gain_period_s": rng.uniform(2.0, 8.0)}


def _spin_down(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:  # noqa: ARG001
    """Let rotors slow down two to four times as slowly as they do already."""
    return {"spin_down_ratio": rng.uniform(2.0, 4.0)}


def _expo(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:
    """Set the firmware's thrust curve to an expo that is 0.2 or more off."""
    expo = airframe.thrust_expo
    while abs(expo - airframe.thrust_expo) < 0.2:
        expo = rng.uniform(0.1, 0.85)
    return {"firmware_expo": expo}


def _flexible(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:  # noqa: ARG001
    """Put a mode at 4 to 12 Hz, of which the gyro sees 3 to 30 %, with either sign: where it is mounted."""
    return {
        "flexible_mode_hz": rng.uniform(4.0, 12.0),
        "flexible_mode_damping": log_uniform(rng, 0.05, 0.3),
        "flexible_mode_gain": rng.choice([-1.0, 1.0]) * log_uniform(rng, 0.03, 0.3),
    }


def _late(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:  # noqa: ARG001
    """Stamp the torque 5 to 30 ms late."""
    return {"torque_late_s": rng.uniform(0.005, 0.03)}


def _outliers(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:  # noqa: ARG001
    """Make one sample in ten thousand to three in a thousand absurd."""
    return {"outlier_fraction": log_uniform(rng, 1e-4, 3e-3)}


def _no_setpoints(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:  # noqa: ARG001
    """Log no rate set-points."""
    return {"setpoints_logged": False}


def _reaction(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:
    """Let accelerating rotors turn the vehicle: yaw leads its torque by 20 to 120 ms in hover."""
    # The lead is proportional to the inertia of a rotor.
    unit = dataclasses.replace(airframe, rotor_inertia_kg_m2=1.0).yaw_lead_s
    return {"rotor_inertia_kg_m2": log_uniform(rng, 0.02, 0.12) / unit}


def _tones(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:  # noqa: ARG001
    """Excite each axis at one frequency only."""
    frequency_hz = rng.uniform(2.5, 5.0, 3) * (1.0, 1.0, 0.5)
    return {"manoeuvre": partial(manoeuvres.tones, frequency_hz=tuple(frequency_hz.tolist()))}


def _speed_moment(rng: np.random.Generator, airframe: SimulatedAirframe) -> dict[str, Any]:
    """Turn roll and pitch by 1 to 10 rad/s^2 for each m/s, as flapping blades and high bodies do.

    Flown 5-inch quads have 3 to 25, by where their moments are as large as the torque's (0.5 to 1 Hz).
    """
    per_speed = log_uniform(rng, 1.0, 10.0)
    return {"drag_height_m": per_speed * float(airframe.inertia_kg_m2[0, 0]) / airframe.drag_n_s_m}


#: By the names of `quadid_logs.simulator.effects.FIELDS` where there is one.
EFFECTS: Final[dict[str, Callable[[np.random.Generator, SimulatedAirframe], dict[str, Any]]]] = {
    "tilt stiffness": _tilt_stiffness,
    "sling load": _sling_load,
    "dead zone": _dead_zone,
    "rotor dead zone": _rotor_dead_zone,
    "unlogged saturation": _saturation,
    "alternating gain": _alternating,
    "spin-down asymmetry": _spin_down,
    "expo mismatch": _expo,
    "flexible mode": _flexible,
    "late torque": _late,
    "outliers": _outliers,
    "missing set-points": _no_setpoints,
    "single tone": _tones,
    "rotor reaction": _reaction,
    "moment of the speed": _speed_moment,
}


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw evenly in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
