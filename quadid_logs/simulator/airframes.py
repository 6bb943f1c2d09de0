"""The simulated vehicles: what is true about them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.ardupilot.frames import Frame, frame_geometry
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.errors import SimulationError
from quadid_logs.maths.frames import torque_matrix
from quadid_logs.vocabulary import GRAVITY_M_S2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Battery:
    """A lithium pack: open-circuit voltage falls with charge, terminal voltage with current.

    ``sag`` is the fraction of the full voltage that is lost with the whole charge,
    ``hover_current_a`` what hovering draws; more thrust draws its power 1.5.
    """

    full_v: float = 16.8
    sag: float = 0.14
    resistance_ohm: float = 0.025
    capacity_a_s: float = 18_000.0
    hover_current_a: float = 16.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedAirframe:
    """A multirotor.

    Attributes
    ----------
    frame_class, frame_type : int
        ArduPilot's numbers for the layout.
    inertia_kg_m2 : ndarray, shape (3, 3)
        About the centre of mass, products with the sign of eq. (7): J[0, 1] is I_xy of the tensor.
    position_m : ndarray, shape (n_rotors, 3)
        FRD from the centre of mass [m].
    spin : ndarray, shape (n_rotors,)
        +1 counter-clockwise from above.
    max_thrust_n, rotor_speed_max_rad_s : float
        Of one rotor with a full battery.
    thrust_expo : float
        Thrust is max_thrust_n * ((1-e) y + e y^2) for the throttle times voltage ratio y.
    lag_up_s, lag_down_s : float
        Time constant of the rotor speed.
    rotor_inertia_kg_m2 : float
        Of one propeller with the bell of its motor, about its axis: accelerating rotors turn the vehicle.
    rate_damping_n_m_s : ndarray, shape (3,)
        Torque against p, q, r.
    drag_n_s_m, drag_area_m2 : float
        Rotor drag (with airspeed) and body drag (with its square).
    drag_height_m : float
        Where the drag attacks, above the centre of mass.
    propellers : tuple of float
        Fraction of its thrust that each damaged propeller still gives; () if all are whole. The
        autopilot, its mixer and its tuning know nothing of it.
    """

    name: str
    frame_class: int
    frame_type: int
    mass_kg: float
    inertia_kg_m2: FloatArray
    position_m: FloatArray
    spin: FloatArray
    max_thrust_n: float
    torque_to_thrust_m: float
    rotor_speed_max_rad_s: float = 1000.0
    thrust_expo: float = 0.6
    lag_up_s: float = 0.03
    lag_down_s: float = 0.03
    rotor_inertia_kg_m2: float = 0.0
    rate_damping_n_m_s: FloatArray = field(default_factory=lambda: np.array([0.012, 0.012, 0.008]))
    drag_n_s_m: float = 0.25
    drag_area_m2: float = 0.012
    drag_height_m: float = 0.02
    propellers: tuple[float, ...] = ()
    battery: Battery = field(default_factory=Battery)

    @property
    def n_rotors(self) -> int:
        """Number of rotors."""
        return int(self.spin.shape[0])

    @property
    def hover_throttle(self) -> float:
        """Fraction of the full thrust that carries the weight [1]."""
        return self.mass_kg * GRAVITY_M_S2 / (self.n_rotors * self.max_thrust_n)

    @property
    def yaw_lead_s(self) -> float:
        """Return T of the yaw torque N + T dN/dt in hover at speed w: J_r / (2 k w), drag k w^2 [s]."""
        speed = self.rotor_speed_max_rad_s * self.hover_throttle**0.5
        drag = self.torque_to_thrust_m * self.max_thrust_n / self.rotor_speed_max_rad_s**2
        return float(self.rotor_inertia_kg_m2 / (2.0 * drag * speed))

    @property
    def rotor_thrust_n(self) -> FloatArray:
        """Return what each rotor gives at full throttle [N], damage included, shape (n_rotors,)."""
        return self.max_thrust_n * np.array(self.propellers or [1.0] * self.n_rotors)

    @property
    def torque_per_thrust(self) -> FloatArray:
        """Return L, M, N per newton of each rotor, shape (3, n_rotors)."""
        return torque_matrix(self.position_m, self.spin, self.torque_to_thrust_m)


def layout(frame_class: int, frame_type: int, arm_length_m: float) -> dict[str, object]:
    """Return the fields of an `SimulatedAirframe` that follow from its frame and arm length [m]."""
    frame: Frame = frame_geometry(frame_class, frame_type)
    return {
        "frame_class": frame_class,
        "frame_type": frame_type,
        "position_m": frame.position * arm_length_m,
        "spin": frame.spin,
    }


def quad_x() -> SimulatedAirframe:
    """Return a 1.5 kg quadrotor of the 450 mm class."""
    return _make(
        "quad 450", (1, 1), 0.225, mass_kg=1.5, inertia=(0.0145, 0.0162, 0.0265), max_thrust_n=9.0, k_m=0.016
    )


def hexa_x() -> SimulatedAirframe:
    """Return a 3.2 kg hexarotor of the 680 mm class."""
    return _make(
        "hexa 680", (2, 1), 0.34, mass_kg=3.2, inertia=(0.055, 0.059, 0.102), max_thrust_n=11.5, k_m=0.019
    )


def octa_coaxial() -> SimulatedAirframe:
    """Return a 4.5 kg coaxial octorotor (X8)."""
    return _make(
        "octa coaxial", (4, 1), 0.3, mass_kg=4.5, inertia=(0.062, 0.071, 0.108), max_thrust_n=12.0, k_m=0.018
    )


def _make(
    name: str,
    frame: tuple[int, int],
    arm_length_m: float,
    *,
    mass_kg: float,
    inertia: tuple[float, float, float],
    max_thrust_n: float,
    k_m: float,
) -> SimulatedAirframe:
    """Build an airframe whose damping and drag go with its size."""
    return SimulatedAirframe(
        name=name,
        mass_kg=mass_kg,
        inertia_kg_m2=np.diag(inertia),
        max_thrust_n=max_thrust_n,
        torque_to_thrust_m=k_m,
        rate_damping_n_m_s=0.9 * np.asarray(inertia),
        drag_n_s_m=0.17 * mass_kg,
        battery=Battery(hover_current_a=11.0 * mass_kg, resistance_ohm=0.03 / mass_kg),
        **layout(*frame, arm_length_m),  # type: ignore[arg-type]
    )


def scaled(airframe: SimulatedAirframe, factor: float) -> SimulatedAirframe:
    """Return a similar vehicle whose lengths are so many times as large.

    The disk loading and the speed of the blade tips stay: mass and thrust go with the area, inertia with mass
    times area, and the time constant of a rotor, J / (2 k w) with J ~ d^5, k ~ d^5 and w ~ 1 / d, with d.
    """
    area = factor**2
    return dataclasses.replace(
        airframe,
        mass_kg=airframe.mass_kg * area,
        inertia_kg_m2=airframe.inertia_kg_m2 * area**2,
        position_m=airframe.position_m * factor,
        max_thrust_n=airframe.max_thrust_n * area,
        torque_to_thrust_m=airframe.torque_to_thrust_m * factor,
        rotor_speed_max_rad_s=airframe.rotor_speed_max_rad_s / factor,
        lag_up_s=airframe.lag_up_s * factor,
        lag_down_s=airframe.lag_down_s * factor,
        rotor_inertia_kg_m2=airframe.rotor_inertia_kg_m2 * factor**5,
        rate_damping_n_m_s=airframe.rate_damping_n_m_s * area**2,
        drag_n_s_m=airframe.drag_n_s_m * area,
        drag_area_m2=airframe.drag_area_m2 * area,
        drag_height_m=airframe.drag_height_m * factor,
        battery=dataclasses.replace(
            airframe.battery,
            resistance_ohm=airframe.battery.resistance_ohm / area,
            capacity_a_s=airframe.battery.capacity_a_s * area,
            hover_current_a=airframe.battery.hover_current_a * area,
        ),
    )


def adapted(airframe: SimulatedAirframe, vehicle: Vehicle) -> SimulatedAirframe:
    """Replace what a vehicle file gives; without a given inertia, the known one grows with m r^2.

    Raises
    ------
    SimulationError
        If the vehicle cannot fly.
    """
    changes: dict[str, object] = {}
    if vehicle.name:
        changes["name"] = vehicle.name
    if vehicle.mass_kg is not None:
        changes["mass_kg"] = vehicle.mass_kg
    if vehicle.max_thrust_n is not None:
        changes["max_thrust_n"] = vehicle.max_thrust_n
    if vehicle.torque_to_thrust_m is not None:
        changes["torque_to_thrust_m"] = vehicle.torque_to_thrust_m
    # Rotor positions and spins, or the arm length alone
    if vehicle.rotors:
        if len(vehicle.rotors) != airframe.n_rotors:
            raise SimulationError(
                f"The vehicle file has {len(vehicle.rotors)} rotors, the scenario {airframe.n_rotors}.",
                hint="Choose a scenario with that number of rotors, or give arm_length_m instead.",
            )
        rotor_changes = {
            "position_m": np.array([rotor.position_m for rotor in vehicle.rotors], dtype=np.float64),
            "spin": np.array([1.0 if rotor.spin == "ccw" else -1.0 for rotor in vehicle.rotors]),
        }
    elif vehicle.arm_length_m is not None:
        rotor_changes = {"position_m": airframe.position_m * vehicle.arm_length_m / _reach(airframe)}
    else:
        rotor_changes = {}
    changes |= rotor_changes
    changed = dataclasses.replace(airframe, **changes)  # type: ignore[arg-type]
    if vehicle.inertia_kg_m2 is not None:
        if not np.isfinite(vehicle.inertia_kg_m2).all():
            raise SimulationError(
                "The vehicle's moments of inertia are not all known.", hint="Give all three."
            )
        inertia = np.asarray(vehicle.inertia_kg_m2, dtype=np.float64)
    else:
        reach = _reach(changed) / _reach(airframe)
        inertia = airframe.inertia_kg_m2 * (changed.mass_kg / airframe.mass_kg) * reach**2
    changed = dataclasses.replace(
        changed, inertia_kg_m2=inertia, rate_damping_n_m_s=0.9 * np.diagonal(inertia)
    )
    if not 0.05 < changed.hover_throttle < 0.85:
        raise SimulationError(
            f"The vehicle would hover at {changed.hover_throttle:.0%} of its thrust, which cannot be flown.",
            hint="Check mass_kg against max_thrust_n (one rotor, full battery) in the vehicle file.",
        )
    return changed


def _reach(airframe: SimulatedAirframe) -> float:
    """Length of the longest arm [m]."""
    return float(np.hypot(airframe.position_m[:, 0], airframe.position_m[:, 1]).max())
