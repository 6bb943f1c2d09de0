"""Draw a flight at random: vehicle, manoeuvre, sensors, weather, logging, structural effects.

The study's seed and the number of the flight decide everything.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.rotations import quaternion_from_euler, rotation_matrix
from quadid_logs.simulator import Scenario, manoeuvres
from quadid_logs.simulator.airframes import Battery, SimulatedAirframe, layout
from quadid_logs.simulator.closed_loop import Noise, torque_gain
from quadid_logs.simulator.logger import Logging
from quadid_logs.simulator.manoeuvres import Reference
from quadid_logs.simulator.wind import Wind
from quadid_logs.vocabulary import GRAVITY_M_S2
from study.structural import draw_structural, log_uniform

Manoeuvre = Callable[[FloatArray, np.random.Generator], Reference]

#: ArduPilot's frame class and type, with the fraction of flights.
FRAMES: Final = {
    "quad x": ((1, 1), 0.4),
    "quad plus": ((1, 0), 0.1),
    "hexa x": ((2, 1), 0.2),
    "hexa plus": ((2, 0), 0.05),
    "octa x": ((3, 1), 0.1),
    "octa coaxial x": ((4, 1), 0.15),
}
#: What is flown, with the fraction of flights.
MANOEUVRES: Final = {"multisine": 0.3, "doublets": 0.2, "steps-3211": 0.2, "sticks": 0.2, "chirp": 0.1}
#: Logging rates with which a control loop at about 400 Hz can be sampled evenly.
RATES_HZ: Final = (100.0, 125.0, 200.0, 250.0, 400.0)
#: The intervals allow for scale and cross-axis sensitivities of the gyro of 1 % or less
#: in 95 of 100 cases.
GYRO_SCALE_SIGMA: Final = 0.01 / NORMAL_95


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drawn:
    """One flight of the study.

    ``settings`` are the numbers and names that results are sorted by; the
    scenario, the rate and the autopilot are what the simulator needs.
    ``clipped_fraction`` of the commands are to be beyond a limit that nothing tells.
    """

    seed: int
    settings: dict[str, float | str]
    scenario: Scenario
    autopilot: str
    clipped_fraction: float = 0.0

    @property
    def number(self) -> int:
        """Number of the flight in the study."""
        return int(self.settings["number"])


def draw_flight(seed: int, number: int) -> Drawn:
    """Draw one flight of a study."""
    rng = np.random.default_rng([seed, number, *b"coverage study"])
    autopilot = str(rng.choice(["ardupilot", "px4"]))
    airframe, vehicle_settings = _draw_airframe(rng)
    manoeuvre, manoeuvre_settings = _draw_manoeuvre(rng, airframe, autopilot)
    structural = draw_structural(seed, number, airframe)
    airframe = structural.on(airframe)
    noise = Noise(
        gyro_rad_s_per_rthz=1.0e-4 * log_uniform(rng, 0.3, 5.0),
        gyro_bias_rad_s=_triple(0.004 * rng.standard_normal(3)),
        gyro_scale=_triple(GYRO_SCALE_SIGMA * rng.standard_normal(3)),
        gyro_cross=_six(GYRO_SCALE_SIGMA * rng.standard_normal(6)),
    )
    windless = rng.random() < 0.3
    wind = Wind(
        speed_m_s=0.0 if windless else rng.uniform(0.5, 6.0), heading_rad=rng.uniform(-math.pi, math.pi)
    )
    logging = Logging(
        rate_hz=float(rng.choice(RATES_HZ)),
        jitter_s=log_uniform(rng, 10e-6, 300e-6),
        drop_fraction=rng.uniform(0.0, 0.02) if rng.random() < 0.2 else 0.0,
    )
    scenario = Scenario(
        name=f"study {number}",
        sentence="One flight of the coverage study.",
        airframe=lambda: airframe,
        manoeuvre=structural.manoeuvre or manoeuvre,
        # Enough for held-out blocks, and no more: many flights tell more than long ones.
        duration_s=rng.uniform(30.0, 60.0),
        gyro_filter_hz=rng.uniform(20.0, 80.0),
        delay_steps=int(rng.integers(0, 4)),
        noise=noise,
        wind=wind,
        effects=structural.effects,
        logging=logging,
    )
    settings: dict[str, float | str] = {
        "number": number,
        "autopilot": autopilot,
        **vehicle_settings,
        **manoeuvre_settings,
        **({"manoeuvre": "single tone"} if structural.manoeuvre else {}),
        "gyro_noise_rad_s_per_rthz": noise.gyro_rad_s_per_rthz,
        "gyro_scale_p": noise.gyro_scale[0],
        "gyro_scale_q": noise.gyro_scale[1],
        "gyro_scale_r": noise.gyro_scale[2],
        "wind_m_s": wind.speed_m_s,
        "rate_hz": logging.rate_hz,
        "jitter_s": logging.jitter_s,
        "drop_fraction": logging.drop_fraction,
        "duration_s": scenario.duration_s,
        "gyro_filter_hz": scenario.gyro_filter_hz,
        "delay_steps": scenario.delay_steps,
        "structural": " + ".join(structural.names),
        "disturbance_rad_s2": structural.effects.disturbance_rad_s2[0],
        "yaw_lead_s": airframe.yaw_lead_s,
    }
    return Drawn(
        seed=seed,
        settings=settings,
        scenario=scenario,
        autopilot=autopilot,
        clipped_fraction=structural.clipped_fraction,
    )


def _draw_airframe(rng: np.random.Generator) -> tuple[SimulatedAirframe, dict[str, float | str]]:
    """Draw a vehicle of 0.3 to 8 kg whose arms, inertias, drag and battery go with its size."""
    frame = str(rng.choice(list(FRAMES), p=[fraction for _, fraction in FRAMES.values()]))
    (frame_class, frame_type), _ = FRAMES[frame]
    mass_kg = log_uniform(rng, 0.3, 8.0)
    # 1.5 kg and 0.225 m are a common quadrotor; density falls a little with size.
    arm_m = 0.225 * (mass_kg / 1.5) ** 0.4 * rng.uniform(0.85, 1.2)
    inertia, askew_deg = _draw_inertia(rng, mass_kg, arm_m)
    described = layout(frame_class, frame_type, arm_m)
    n_rotors = len(described["spin"])  # type: ignore[arg-type]
    hover = rng.uniform(0.25, 0.5)
    lag_up_s = log_uniform(rng, 0.010, 0.070)
    asymmetric = rng.random() < 0.25
    lag_down_s = lag_up_s * (rng.uniform(1.1, 1.5) if asymmetric else 1.0)
    damping_1_s = np.append(np.repeat(rng.uniform(0.3, 2.5), 2), rng.uniform(0.3, 1.5))
    airframe = SimulatedAirframe(
        name=frame,
        mass_kg=mass_kg,
        inertia_kg_m2=inertia,
        max_thrust_n=mass_kg * GRAVITY_M_S2 / (n_rotors * hover),
        torque_to_thrust_m=0.016 * arm_m / 0.225 * rng.uniform(0.8, 1.4),
        thrust_expo=rng.uniform(0.3, 0.75),
        lag_up_s=lag_up_s,
        lag_down_s=lag_down_s,
        rate_damping_n_m_s=damping_1_s * np.diagonal(inertia),
        drag_n_s_m=rng.uniform(0.1, 0.25) * mass_kg,
        drag_area_m2=0.012 * (mass_kg / 1.5) ** 0.8,
        drag_height_m=rng.uniform(0.0, 0.03) * arm_m / 0.225,
        battery=Battery(
            hover_current_a=11.0 * mass_kg,
            resistance_ohm=0.03 / mass_kg,
            capacity_a_s=12_000.0 * mass_kg,
        ),
        **described,  # type: ignore[arg-type]
    )
    return airframe, {
        "frame": frame,
        "mass_kg": mass_kg,
        "arm_m": arm_m,
        "askew_deg": askew_deg,
        "hover_throttle": hover,
        "thrust_expo": airframe.thrust_expo,
        "lag_s": 0.5 * (lag_up_s + lag_down_s),
        "lag_ratio": lag_down_s / lag_up_s,
        "damping_roll_1_s": float(damping_1_s[0]),
        "drag_height_m": airframe.drag_height_m,
        "drag_n_s_m": airframe.drag_n_s_m,
    }


def _draw_inertia(rng: np.random.Generator, mass_kg: float, arm_m: float) -> tuple[FloatArray, float]:
    """Draw a tensor [kg m^2], and how far its principal axes lie off the body's [deg]."""
    roll = 0.19 * mass_kg * arm_m**2 * rng.uniform(0.75, 1.25)
    pitch = roll * rng.uniform(0.9, 1.3)
    principal = np.diag([roll, pitch, (roll + pitch) * rng.uniform(0.8, 0.97)])
    if rng.random() < 2.0 / 3.0:
        return principal, 0.0
    askew = np.radians(rng.uniform(-12.0, 12.0, 3))
    R = rotation_matrix(quaternion_from_euler(askew[np.newaxis]))[0]
    tensor = R @ principal @ R.T
    return 0.5 * (tensor + tensor.T), float(np.degrees(np.linalg.norm(askew)))


def _draw_manoeuvre(
    rng: np.random.Generator, airframe: SimulatedAirframe, autopilot: str
) -> tuple[Manoeuvre, dict[str, float | str]]:
    """Draw what is flown; ``amplitude`` is relative to the manoeuvre's typical one."""
    name = str(rng.choice(list(MANOEUVRES), p=list(MANOEUVRES.values())))
    amplitude = log_uniform(rng, 0.4, 1.3)
    settings: dict[str, float | str] = {"manoeuvre": name, "amplitude": amplitude}
    if name == "multisine":
        rms = _triple(amplitude * np.array([0.9, 0.9, 0.35]))
        return partial(manoeuvres.multisine, rms_rad_s=rms), settings
    if name == "doublets":
        pulse_s = rng.uniform(0.15, 0.35)
        return partial(manoeuvres.doublets, amplitude_rad_s=1.2 * amplitude, pulse_s=pulse_s), settings
    if name == "steps-3211":
        pulse_s = rng.uniform(0.1, 0.2)
        return partial(manoeuvres.steps_3211, amplitude_rad_s=0.8 * amplitude, pulse_s=pulse_s), settings
    if name == "sticks":
        tilt, turn = 0.25 * amplitude, 0.7 * amplitude
        return partial(manoeuvres.sticks, tilt_rad=tilt, yaw_rate_rad_s=turn), settings
    axis = int(rng.integers(0, 3))
    gain = np.linalg.solve(airframe.inertia_kg_m2, torque_gain(airframe, autopilot))[axis, axis]
    # 12 rad/s^2 of roll and pitch and 4 of yaw swing a vehicle by some degrees at 1 Hz.
    torque = amplitude * (12.0, 12.0, 4.0)[axis] / gain
    settings["axis"] = ("roll", "pitch", "yaw")[axis]
    return partial(manoeuvres.chirp, axis=axis, amplitude=torque), settings


def _six(values: FloatArray) -> tuple[float, float, float, float, float, float]:
    """Make six floats of an array."""
    a, b, c, d, e, f = values.tolist()
    return a, b, c, d, e, f


def _triple(values: FloatArray) -> tuple[float, float, float]:
    """Make three floats of an array."""
    first, second, third = values.tolist()
    return first, second, third
