"""The named scenarios: one for every case that a user meets."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.simulator import manoeuvres
from quadid_logs.simulator.airframes import SimulatedAirframe, hexa_x, octa_coaxial, quad_x
from quadid_logs.simulator.closed_loop import Noise, Tuning
from quadid_logs.simulator.damage import Damage
from quadid_logs.simulator.effects import Effects
from quadid_logs.simulator.logger import Logging
from quadid_logs.simulator.manoeuvres import Reference
from quadid_logs.simulator.wind import Wind

_GOOD: Final = ("usable",)
_AT_MOST_CAUTION: Final = ("usable", "caution")
_BAD: Final = ("refused",)
_ANY: Final = ("usable", "caution", "refused")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scenario:
    """A named flight.

    Attributes
    ----------
    sentence : str
        What it is for.
    airframe : callable
        Makes the vehicle.
    manoeuvre : callable
        Makes the `Reference` from the manoeuvre's times and a random generator.
    n_flights : int
        Take-offs in the one log; the duration is divided among them.
    verdicts : mapping of str to tuple of str
        Which verdicts of `analyze` the truth allows, by axis.
    """

    name: str
    sentence: str
    manoeuvre: Callable[[FloatArray, np.random.Generator], Reference] = manoeuvres.multisine
    airframe: Callable[[], SimulatedAirframe] = quad_x
    duration_s: float = 60.0
    gyro_filter_hz: float = 40.0
    delay_steps: int = 0
    noise: Noise = field(default_factory=Noise)
    wind: Wind = field(default_factory=Wind)
    tuning: Tuning = field(default_factory=Tuning)
    effects: Effects = field(default_factory=Effects)
    logging: Logging = field(default_factory=Logging)
    damage: tuple[Damage, ...] = ()
    n_flights: int = 1
    verdicts: Mapping[str, tuple[str, ...]] = field(
        default_factory=lambda: {"roll": _GOOD, "pitch": _GOOD, "yaw": _GOOD}
    )


def _all(verdicts: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Allow the same verdicts on every axis."""
    return dict.fromkeys(("roll", "pitch", "yaw"), verdicts)


def with_products() -> SimulatedAirframe:
    """Return the quadrotor with its load mounted askew: all products of inertia."""
    inertia = np.array([[0.0150, -0.0011, 0.0017], [-0.0011, 0.0172, 0.0008], [0.0017, 0.0008, 0.0268]])
    return dataclasses.replace(quad_x(), name="quad 450, load askew", inertia_kg_m2=inertia)


def underpowered() -> SimulatedAirframe:
    """Return the quadrotor with weak rotors: little thrust and little yaw torque in reserve."""
    return dataclasses.replace(
        quad_x(), name="quad 450, underpowered", max_thrust_n=7.0, torque_to_thrust_m=0.013
    )


def slow_motors() -> SimulatedAirframe:
    """Return the quadrotor with large propellers: 45 ms up, 70 ms down."""
    return dataclasses.replace(quad_x(), name="quad 450, slow motors", lag_up_s=0.045, lag_down_s=0.07)


def heavy_rotors() -> SimulatedAirframe:
    """Return the quadrotor with rotors whose inertia makes yaw lead by 76 ms in hover."""
    return dataclasses.replace(quad_x(), name="quad 450, heavy rotors", rotor_inertia_kg_m2=1.4e-5)


def paper_vehicle() -> SimulatedAirframe:
    """Return the quadrotor with the inertia of the source paper's Table I."""
    inertia = np.diag([0.008, 0.008, 0.01])
    return dataclasses.replace(
        quad_x(), name="Table I", inertia_kg_m2=inertia, rate_damping_n_m_s=0.9 * np.diagonal(inertia)
    )


#: What a hovering research vehicle leaves unexplained between 0.3 and 5 Hz [rad/s^2].
_ROUGH: Final = (1.3, 1.3, 0.43)
#: Of each scenario with one structural effect: its name, what it is for, the effect.
_STRUCTURAL: Final = (
    (
        "rough-air",
        "The good flight with disturbances as strong as in flown logs.",
        Effects(disturbance_rad_s2=_ROUGH),
    ),
    (
        "tilt-unstable",
        "The good flight of a vehicle that is unstable in tilt: a tilt grows e-fold in 0.3 s.",
        Effects(tilt_stiffness_1_s2=10.0),
    ),
    (
        "sling-load",
        "The good flight with 15 % of the mass on a string of 1 m.",
        Effects(sling_load_fraction=0.15),
    ),
    (
        "dead-zone",
        "The good flight with actuators that ignore the first 2 % of a torque command.",
        Effects(dead_zone=0.02),
    ),
    (
        "rotor-dead-zone",
        "The good flight with rotors that ignore commands within 1 % of the mean of all rotors.",
        Effects(rotor_dead_zone=0.01),
    ),
    (
        "hidden-saturation",
        "The good flight with motors limited to a tenth of the full torque, which the log does not show.",
        Effects(torque_limit=(0.1, 0.1, 0.3)),
    ),
    (
        "alternating-gain",
        "The good flight with effectiveness that alternates between +20 % and -20 % every 2.5 s.",
        Effects(gain_swing=0.2),
    ),
    (
        "slow-spin-down",
        "The good flight with rotors that speed up in 30 ms and slow down in 100 ms.",
        Effects(spin_down_ratio=100.0 / 30.0),
    ),
    (
        "expo-mismatch",
        "The good flight with the thrust expo set to 0.2 in the firmware, but 0.6 in the propellers.",
        Effects(firmware_expo=0.2),
    ),
    (
        "flexible-mode",
        "The good flight with a mode of the frame at 5 Hz between motors and gyro.",
        Effects(flexible_mode_hz=5.0, flexible_mode_gain=-0.2),
    ),
    (
        "late-torque",
        "The good flight with torque stamped 20 ms late.",
        Effects(torque_late_s=0.02),
    ),
    (
        "outliers",
        "The good flight in which one of a thousand samples of rates, torque and rotor speeds is absurd.",
        Effects(outlier_fraction=0.001),
    ),
)

#: Of each scenario with a fault: its name, what it is for, the fault, and what the air does beside it.
_FAULTS: Final = (
    (
        "weak-motor",
        "A careful pilot in rough air; motor 2 gives 80 % of its thrust from the beginning.",
        Effects(disturbance_rad_s2=_ROUGH, motor_fault=2, motor_fault_at=0.0),
    ),
    (
        "motor-step",
        "A careful pilot in rough air; motor 3 falls to 80 % of its thrust in the middle of the flight.",
        Effects(disturbance_rad_s2=_ROUGH, motor_fault=3),
    ),
    (
        "motor-ramp",
        "A careful pilot in rough air; motor 1 falls to 80 % of its thrust within 10 s.",
        Effects(disturbance_rad_s2=_ROUGH, motor_fault=1, motor_fault_at=0.4, motor_ramp_s=10.0),
    ),
    (
        "bent-propeller",
        "A careful pilot in rough air, with a bent propeller on motor 4.",
        Effects(disturbance_rad_s2=_ROUGH, bent_propeller=4),
    ),
    (
        "clipping",
        "A careful pilot in rough air, with a broken propeller that shakes the accelerometer beyond 16 g.",
        Effects(
            disturbance_rad_s2=_ROUGH,
            bent_propeller=4,
            propeller_gyro_rad_s=1.5,
            propeller_acceleration_m_s2=250.0,
        ),
    ),
    (
        "mass-off-centre",
        "A careful pilot in rough air; the centre of mass is 3 % of the arm too far forward.",
        Effects(disturbance_rad_s2=_ROUGH, mass_offset=(0.03, 0.0)),
    ),
    (
        "desync",
        "A careful pilot in rough air; the ESC of motor 2 loses step for 80 ms.",
        Effects(disturbance_rad_s2=_ROUGH, desync_rotor=2),
    ),
)

_LIST: Final = (
    Scenario(
        name="sysid-quad-x",
        sentence="A good system-identification flight: multisines on all axes at once, logged at 400 Hz.",
    ),
    Scenario(
        name="doublets",
        sentence="Doublets on roll, pitch and yaw in turn, logged at 400 Hz.",
        manoeuvre=manoeuvres.doublets,
    ),
    Scenario(
        name="steps-3211",
        sentence="3-2-1-1 steps on roll, pitch and yaw in turn, logged at 400 Hz.",
        manoeuvre=manoeuvres.steps_3211,
    ),
    Scenario(
        name="pilot-sticks",
        sentence="A pilot moves the sticks at random, logged at 400 Hz.",
        manoeuvre=manoeuvres.sticks,
        # The speed that the vehicle picks up tilts it by its drag: how much, is chance.
        verdicts=_all(_ANY),
    ),
    Scenario(
        name="hover",
        sentence="Nothing but hovering in calm air: no axis is excited.",
        manoeuvre=manoeuvres.hover,
        verdicts=_all(_BAD),
    ),
    Scenario(
        name="gentle-hover",
        sentence="A careful pilot in a light breeze: almost no excitation.",
        manoeuvre=manoeuvres.gentle_sticks,
        wind=Wind(speed_m_s=2.0),
        verdicts=_all(_BAD),
    ),
    Scenario(
        name="default-logging",
        sentence="The good flight, but logged with default settings: 10 Hz (ArduPilot) or 50 Hz (PX4).",
        logging=Logging(rate_hz=10.0),
        verdicts=_all(("caution", "refused")),
    ),
    Scenario(
        name="single-axis",
        sentence="A chirp on roll only: pitch and yaw are not excited.",
        manoeuvre=manoeuvres.chirp,
        verdicts={"roll": _GOOD, "pitch": _BAD, "yaw": _BAD},
    ),
    Scenario(
        name="saturation",
        sentence="Too much excitation for weak motors: the mixer is at its limits for much of the flight.",
        manoeuvre=partial(manoeuvres.multisine, rms_rad_s=(1.5, 1.5, 0.6)),
        airframe=underpowered,
        verdicts=_all(_AT_MOST_CAUTION),
    ),
    Scenario(
        name="wind",
        sentence="The good flight in 8 m/s of wind with turbulence.",
        wind=Wind(speed_m_s=8.0),
        verdicts=_all(_AT_MOST_CAUTION),
    ),
    Scenario(
        name="products-of-inertia",
        sentence="A load mounted askew: the inertia tensor has all its products.",
        airframe=with_products,
    ),
    Scenario(
        name="slow-motors",
        sentence="Large propellers that speed up in 45 ms and slow down in 70 ms.",
        airframe=slow_motors,
    ),
    Scenario(
        name="rotor-reaction",
        sentence="Heavy rotors, which turn the vehicle as they speed up: yaw leads its torque by 76 ms.",
        manoeuvre=manoeuvres.doublets,
        airframe=heavy_rotors,
    ),
    Scenario(
        name="noisy-gyro",
        sentence="A flight controller on bad vibration dampers: ten times the gyro noise.",
        noise=Noise(gyro_rad_s_per_rthz=1.0e-3),
        gyro_filter_hz=20.0,
        verdicts=_all(_AT_MOST_CAUTION),
    ),
    Scenario(
        name="hexa-x",
        sentence="A hexarotor with multisines on all axes.",
        airframe=hexa_x,
    ),
    Scenario(
        name="octa-coax",
        sentence="A coaxial octorotor (X8) with multisines on all axes.",
        airframe=octa_coaxial,
    ),
    Scenario(
        name="damaged",
        sentence=(
            "The good flight on a bad card: the file holds noise, zeros and a lost block, and its end is "
            "missing."
        ),
        damage=(
            Damage(kind="noise", at=0.3, n_bytes=3000),
            Damage(kind="zeros", at=0.5, n_bytes=4096),
            Damage(kind="missing", at=0.7, n_bytes=1777),
            Damage(kind="cut", at=0.97),
        ),
        verdicts=_all(_AT_MOST_CAUTION),
    ),
    Scenario(
        name="dropouts",
        sentence=(
            "A slow card: 2 % of the rows are missing in bursts of 0.1 s, the log starts late, and time "
            "stamps jitter."
        ),
        logging=Logging(drop_fraction=0.02, start_s=4.0, jitter_s=150e-6),
        verdicts=_all(_AT_MOST_CAUTION),
    ),
    Scenario(
        name="two-flights",
        sentence="Two flights in one file, disarmed on the ground between them.",
        n_flights=2,
        duration_s=80.0,
    ),
    Scenario(
        name="clock-jump",
        sentence="The autopilot's clock is set back by 20 s in the middle of the flight.",
        logging=Logging(clock_jump_s=-20.0),
        verdicts=_all(_AT_MOST_CAUTION),
    ),
    Scenario(
        name="nearly-unstable-loop",
        sentence="The good flight with gains eight times too high: the rate loops are close to oscillating.",
        tuning=Tuning(gain=8.0),
        verdicts=_all(_ANY),
    ),
    Scenario(
        name="detuned-filter",
        sentence="Filters of 4 Hz in the rate loops: they delay more than gyro and motors together.",
        tuning=Tuning(error_hz=4.0, derivative_hz=4.0),
        verdicts=_all(_ANY),
    ),
    Scenario(
        name="slew-limited",
        sentence="ArduPilot's slew limiter (SMAX) at work: P and D are scaled down for much of the flight.",
        tuning=Tuning(gain=3.0, slew_limit=8.0),
        verdicts=_all(_ANY),
    ),
    Scenario(
        name="gains-changed",
        sentence="The good flight, but somebody raises the rate loops' gains by half in the middle of it.",
        tuning=Tuning(later_gain=1.5),
        verdicts=_all(_ANY),
    ),
    Scenario(
        name="paper",
        sentence="The paper's input on a vehicle in flight: 1 rad/s on roll alone, logged every 200 ms.",
        manoeuvre=manoeuvres.sinusoid,
        airframe=paper_vehicle,
        logging=Logging(rate_hz=5.0),
        verdicts=_all(_BAD),
    ),
    # Whatever is said of these may be right, as long as no wrong gain is called usable.
    *(
        Scenario(name=name, sentence=sentence, effects=effects, verdicts=_all(_ANY))
        for name, sentence, effects in _STRUCTURAL
    ),
    *(
        Scenario(
            name=name,
            sentence=sentence,
            manoeuvre=manoeuvres.gentle_sticks,
            effects=effects,
            verdicts=_all(_ANY),
        )
        for name, sentence, effects in _FAULTS
    ),
    Scenario(
        name="no-setpoints",
        sentence="A pilot's sticks in rough air, and the log holds no rate set-points.",
        manoeuvre=manoeuvres.sticks,
        effects=Effects(disturbance_rad_s2=_ROUGH, setpoints_logged=False),
        verdicts=_all(_ANY),
    ),
    Scenario(
        name="single-tone",
        sentence="One tone per axis: a gain cannot be separated from a lag.",
        manoeuvre=manoeuvres.tones,
        verdicts=_all(_ANY),
    ),
)

SCENARIOS: Final[Mapping[str, Scenario]] = MappingProxyType({one.name: one for one in _LIST})
