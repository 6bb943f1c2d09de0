"""Fly: the closed loop of plant, sensors and autopilot, one flight or many at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from struct import Struct
from typing import Any, Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.ardupilot.frames import frame_geometry
from quadid_logs.data.log import POSITION_VALUES
from quadid_logs.errors import SimulationError
from quadid_logs.maths.frames import normalised_allocation, torque_matrix
from quadid_logs.maths.rotational_dynamics import Quadruple, Triple, inertia_terms
from quadid_logs.maths.rotations import Component, body_rates, quaternion_from_euler
from quadid_logs.simulator.airframes import SimulatedAirframe
from quadid_logs.simulator.control import (
    Arithmetic,
    Gains,
    Mixer,
    RateLaw,
    RateMemory,
    TrackingNotch,
    altitude_throttle,
    arithmetic,
    butterworth,
    filter_rates,
    mix,
    rate_law,
    rate_setpoint,
    reset_rates,
    stacked,
    throttle_for_thrust,
    thrust_of_throttle,
    torque_command,
    vector,
)
from quadid_logs.simulator.effects import (
    Actuation,
    Effects,
    FlexibleMode,
    Surroundings,
    disturbance,
    ringing,
)
from quadid_logs.simulator.faults import MotorFaults, RotorVibration
from quadid_logs.simulator.manoeuvres import Reference
from quadid_logs.simulator.outputs import OutputCurve, output_curve
from quadid_logs.simulator.plant import Body, State, advance, at_rest
from quadid_logs.simulator.position_hold import DIRECTIONS, Navigator, PositionHold
from quadid_logs.simulator.wind import Wind, dryden_wind
from quadid_logs.vocabulary import GRAVITY_M_S2

SPIN_MIN: Final = 0.15
SPIN_MAX: Final = 0.95
BATTERY_PERIOD_S: Final = 0.1
#: The expo of a straight line, large enough to divide by.
_LINEAR: Final = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Of the inertial sensors: densities, residual and raw gyro bias, gyro resolution.

    ``gyro_scale`` is the error of each gyro axis's scale, as a fraction of the
    rate; ``gyro_cross`` how much p shows of q and r, q of p and r, r of p and q.
    ``rotor_line_rad_s`` is the root mean square of what unbalanced rotors show about each axis,
    once in a turn of each; ``frame_line_rad_s`` that of a part of the frame that rings at ``frame_line_hz``.
    """

    gyro_rad_s_per_rthz: float = 1.0e-4
    gyro_bias_rad_s: tuple[float, float, float] = (0.004, -0.003, 0.002)
    gyro_scale: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyro_cross: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    gyro_resolution_rad_s: float = math.radians(2000.0) / 32768.0
    accelerometer_m_s2_per_rthz: float = 2.0e-3
    rotor_line_rad_s: float = 0.0
    frame_line_rad_s: float = 0.0
    frame_line_hz: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """How the rate loops are set, beside the gains that suit the vehicle.

    Attributes
    ----------
    gain : float
        Factor on P, I and D.
    axis_gain : tuple of float
        The same of each axis, on top of it.
    single_gain : tuple of tuple of float
        Factors on P, on I, on D and on the angle gain, of each axis, on top of both.
    later_gain : float or None
        Instead of it from the middle of the manoeuvre on.
    target_hz, error_hz : float
        ArduPilot's filters of set-point and error, 0 for none.
    derivative_hz : float
        Filter of D.
    axis_derivative_hz : tuple of float or None
        ArduPilot's of each axis, instead.
    slew_limit : float
        ArduPilot's limit on how fast P + D may move [1/s], 0 for none.
    notch : TrackingNotch or None
        ArduPilot's, in the gyro's path.
    """

    gain: float = 1.0
    axis_gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    single_gain: tuple[tuple[float, float, float], ...] = ((1.0, 1.0, 1.0),) * 4
    later_gain: float | None = None
    target_hz: float = 20.0
    error_hz: float = 0.0
    derivative_hz: float = 25.0
    axis_derivative_hz: tuple[float, float, float] | None = None
    slew_limit: float = 0.0
    notch: TrackingNotch | None = None

    def of_derivative_hz(self, axis: int) -> float:
        """Return the cut-off of one axis' D."""
        return self.derivative_hz if self.axis_derivative_hz is None else self.axis_derivative_hz[axis]


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """When the flight's phases begin [s from the first control period], and the height flown [m]."""

    arm_s: float
    take_off_s: float
    manoeuvre_s: float
    land_s: float
    touch_down_s: float
    disarm_s: float
    end_s: float
    height_m: float = 5.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Setup:
    """Everything that one flight depends on.

    ``reference`` covers the manoeuvre (`Schedule.manoeuvre_s` to
    `Schedule.land_s`) with one row per control period; ``delay_steps`` are
    the control periods between mixer and motors. With ``position`` a path is flown instead of the reference's
    angles.
    """

    airframe: SimulatedAirframe
    reference: Reference
    schedule: Schedule
    autopilot: str = "ardupilot"
    loop_hz: float = 400.0
    gyro_filter_hz: float = 40.0
    delay_steps: int = 0
    noise: Noise = field(default_factory=Noise)
    wind: Wind = field(default_factory=Wind)
    effects: Effects = field(default_factory=Effects)
    tuning: Tuning = field(default_factory=Tuning)
    position: PositionHold | None = None
    seed: int = 0

    @property
    def firmware_expo(self) -> float:
        """The thrust curve's expo that the firmware takes for the propellers'; Betaflight takes none."""
        mistaken = _LINEAR if self.autopilot == "betaflight" else self.effects.firmware_expo
        return self.airframe.thrust_expo if mistaken is None else mistaken

    @property
    def hover_throttle(self) -> float:
        """Fraction of the full thrust that carries the weight, as the firmware counts thrust [1]."""
        hover = self.airframe.hover_throttle
        if self.firmware_expo == self.airframe.thrust_expo:
            return hover
        return float(
            thrust_of_throttle(throttle_for_thrust(hover, self.airframe.thrust_expo), self.firmware_expo)
        )


class Channel(NamedTuple):
    """A recorded quantity and how many columns it has (0: one per rotor)."""

    name: str
    columns: int


CORE: Final = (
    Channel("gyro_filtered", 3),
    Channel("setpoint", 3),
    Channel("command", 3),
    Channel("throttle", 1),
    Channel("limited", 1),
    Channel("attitude", 4),
    Channel("voltage", 1),
    Channel("voltage_filtered", 1),
)
EXTRA: Final = (
    Channel("rate", 3),
    Channel("gyro", 3),
    Channel("acceleration", 3),
    Channel("velocity", 3),
    Channel("height", 1),
    Channel("torque", 3),
    Channel("achieved", 3),
    Channel("actuator", 0),
    Channel("thrust_fraction", 0),
    Channel("rotor_speed", 0),
    Channel("proportional", 3),
    Channel("integral", 3),
    Channel("derivative", 3),
    Channel("slope", 3),
    Channel("scale", 3),
)
#: Of flights that hold positions: values of both directions, and the attitude's target.
NAVIGATION: Final = (
    Channel("position_control", len(POSITION_VALUES) * len(DIRECTIONS)),
    Channel("attitude_target", 3),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Record:
    """What happened, sampled at the beginning of every control period.

    Attributes
    ----------
    time_s : ndarray, shape (n_steps,)
    channels : mapping of str to ndarray, shape (n_steps, n_columns) or (n_flights, n_steps, n_columns)
        By the names of `CORE`, `EXTRA` and, where positions are held, `NAVIGATION`. ``command`` is exactly
        what enters the mixer, ``achieved`` what it made of it; ``gyro`` is unfiltered, ``torque`` [N m] and
        ``rate`` [rad/s] are true.
    setups : tuple of Setup
    """

    time_s: FloatArray
    channels: dict[str, FloatArray]
    setups: tuple[Setup, ...]


def fly(setup: Setup) -> Record:
    """Fly once and record everything.

    With the channels of `CORE` and `EXTRA`, each of shape (n_steps, n_columns).
    """
    channels = CORE + EXTRA + (() if setup.position is None else NAVIGATION)
    values = _fly((setup,), channels)
    return Record(time_s=_times(setup), channels=_by_name(values, (setup,), channels), setups=(setup,))


def fly_many(setups: Sequence[Setup]) -> Record:
    """Fly many at once, recording the `CORE` channels in single precision.

    The flights may differ in everything but frame, schedule, autopilot and
    control rate. 200 flights of 60 s at 400 Hz take about 1 GB meanwhile.

    Returns
    -------
    Record
        With the channels of `CORE`, each of shape (n_flights, n_steps, n_columns).

    Raises
    ------
    SimulationError
        If they differ in what must be the same.
    """
    first = setups[0]
    for other in setups:
        shared = (
            other.schedule == first.schedule
            and other.autopilot == first.autopilot
            and other.loop_hz == first.loop_hz
            and other.delay_steps == first.delay_steps
            and other.tuning == first.tuning
            and other.position is None
            and other.airframe.n_rotors == first.airframe.n_rotors
        )
        if not shared:
            raise SimulationError(
                "Flights of one batch have the same number of rotors, schedule, autopilot, delay, tuning, "
                "loop rate."
            )
    values = _fly(tuple(setups), CORE)
    if len(setups) == 1:
        values = values[:, :, np.newaxis]
    by_flight = np.moveaxis(values, 2, 0)
    return Record(time_s=_times(first), channels=_by_name(by_flight, setups, CORE), setups=tuple(setups))


def _times(setup: Setup) -> FloatArray:
    """Beginning of every control period [s]."""
    return np.arange(n_steps(setup)) / setup.loop_hz


def n_steps(setup: Setup) -> int:
    """Return the number of control periods of the flight."""
    return round(setup.schedule.end_s * setup.loop_hz)


def _by_name(
    values: FloatArray, setups: Sequence[Setup], channels: tuple[Channel, ...]
) -> dict[str, FloatArray]:
    """Cut the record's last axis into its channels."""
    named, begin = {}, 0
    for channel in channels:
        end = begin + (channel.columns or setups[0].airframe.n_rotors)
        named[channel.name] = values[..., begin:end]
        begin = end
    return named


class Controller(NamedTuple):
    """Constants of the control loop, as components."""

    law: RateLaw
    gains: Gains
    later_gains: Gains
    mixer: Mixer
    expo: Component
    propeller_expo: Component
    speed_max: Component
    compensates_voltage: bool
    curve: OutputCurve
    actuation: Actuation


def _fly(setups: tuple[Setup, ...], channels: tuple[Channel, ...]) -> FloatArray:
    """Run the loop; rows of shape (n_columns,) or (n_columns, n_flights)."""
    first = setups[0]
    n, width = n_steps(first), sum(c.columns or first.airframe.n_rotors for c in channels)
    rows = _periods(setups, full=channels != CORE)
    if len(setups) == 1:
        # Numpy takes twice as long to find out that all are floats.
        packed, row_of = bytearray(8 * n * width), Struct(f"{width}d")
        for k, row in enumerate(rows):
            row_of.pack_into(packed, k * row_of.size, *row)
        return np.frombuffer(packed, dtype=np.float64).reshape(n, width)
    values = np.empty((n, width, len(setups)), dtype=np.float32)
    for k, row in enumerate(rows):
        for column, value in enumerate(row):
            values[k, column] = value
    return values  # type: ignore[return-value]


class Decision(NamedTuple):
    """The controller's outputs of one control period."""

    setpoint: Triple
    command: Triple
    throttle: Component
    limited: Component
    achieved: Triple
    thrust: tuple[Component, ...]
    actuators: tuple[Component, ...]
    targets: tuple[Component, ...]


class PlanRow(NamedTuple):
    """What the flight plan commands in one control period."""

    height: float
    climb: float
    attitude: Quadruple
    feedforward: Triple
    injected: Triple


def _periods(setups: tuple[Setup, ...], *, full: bool) -> Iterator[tuple[Component, ...]]:
    """Yield one record row per control period."""
    first = setups[0]
    ops = arithmetic(len(setups))
    body, controller, battery, gyro = _body(setups), _controller(setups), _Battery(setups), _Gyro(setups)
    phases, n_rotors = setups[0].schedule, setups[0].airframe.n_rotors
    # Collect what acts on the vehicles from outside, wind excepted.
    frames = [s.airframe for s in setups]
    surroundings = Surroundings(
        [s.effects for s in setups],
        vector([np.diagonal(frame.inertia_kg_m2) for frame in frames]),
        stacked([frame.mass_kg for frame in frames]),
        1.0 / setups[0].loop_hz,
    )
    faults = MotorFaults([s.effects for s in setups], n_rotors, phases.manoeuvre_s, phases.land_s)
    zero = stacked([0.0 for _ in setups])
    nothing, still = (zero, zero, zero), (zero,) * first.airframe.n_rotors
    idle = Decision(nothing, nothing, zero, zero, nothing, still, still, still)
    state = at_rest(first.airframe.n_rotors, zero)
    rates, previous = reset_rates(idle.command, idle.command, zero), None
    height_integral, decision = zero, idle
    change = round(change_s(first) * first.loop_hz)
    queue = [idle.targets] * first.delay_steps
    navigator = None
    if first.position is not None:
        begin_s = first.schedule.manoeuvre_s
        navigator = Navigator(first.position, first.loop_hz, _times(first), begin_s)
    battery_period = round(BATTERY_PERIOD_S * first.loop_hz)
    for k, (active, plan, noise, wind, disturbed) in enumerate(_inputs(setups)):
        if k % battery_period == 0:
            battery.update(state.wrench.thrust, ops)
        raw, filtered = gyro.read(state.rate, noise, state.speeds)
        navigated: tuple[Component, ...] = ()
        if navigator is not None:
            flown = navigator.fly(k, state.velocity)
            roll, pitch, yaw = (sum(both) for both in zip(plan.feedforward, flown.forward, strict=True))
            plan = plan._replace(attitude=flown.attitude, feedforward=(roll, pitch, yaw))
            navigated = flown.row
        if active:
            lift = plan.height - state.height
            height_integral = ops.higher(ops.lower(height_integral + 0.5 * body.step_s * lift, 2.0), -2.0)
            gains = controller.gains if k < change else controller.later_gains
            setpoint = rate_setpoint(state.attitude, plan.attitude, plan.feedforward, gains)
            if previous is None:
                rates = reset_rates(setpoint, filtered, zero)
            # The attitude controller runs behind the rate controller, which has its set-point a loop later.
            command, rates = torque_command(
                controller.law,
                previous or setpoint,
                filtered,
                rates,
                gains,
                limited=decision.limited,
                ops=ops,
            )
            previous = setpoint
            throttle = altitude_throttle(
                lift,
                plan.climb + state.velocity[2],
                height_integral,
                hover=controller.mixer.hover,
                attitude=state.attitude,
                ops=ops,
            )
            command = (
                command[0] + plan.injected[0],
                command[1] + plan.injected[1],
                command[2] + plan.injected[2],
            )
            decision = _decide(setpoint, command, throttle, controller, battery, ops)
            if controller.actuation.present:
                decision = _mistaken(decision, controller, battery, k / first.loop_hz, ops)
            if faults.present:
                decision = decision._replace(targets=faults.speeds(decision.targets, k / first.loop_hz, ops))
        else:
            rates, previous = reset_rates(idle.command, idle.command, zero), None
            height_integral, decision = zero, idle
        row = _row(state, decision, rates, raw, filtered, battery, full=full)
        yield (*row, *navigated) if full else row
        queue.append(decision.targets)
        external = surroundings.act(state.attitude, state.acceleration, disturbed)
        state = advance(state, queue.pop(0), wind, body, external)


def _row(
    state: State,
    decision: Decision,
    rates: RateMemory,
    raw: Triple,
    filtered: Triple,
    battery: _Battery,
    *,
    full: bool,
) -> tuple[Component, ...]:
    """Return the values of the `CORE` channels, and of `EXTRA` behind them if `full`."""
    core = (
        *filtered,
        *decision.setpoint,
        *decision.command,
        decision.throttle,
        decision.limited,
        *state.attitude,
        battery.ratio,
        battery.filtered,
    )
    if not full:
        return core
    roll, pitch, yaw = rates
    return (
        *core,
        *state.rate,
        *raw,
        *state.acceleration,
        *state.velocity,
        state.height,
        *state.wrench.torque,
        *decision.achieved,
        *decision.actuators,
        *decision.thrust,
        *state.speeds,
        *(roll.proportional, pitch.proportional, yaw.proportional),
        *(roll.integral, pitch.integral, yaw.integral),
        *(roll.derivative, pitch.derivative, yaw.derivative),
        *(roll.slope, pitch.slope, yaw.slope),
        *(roll.scale, pitch.scale, yaw.scale),
    )


class _Gyro:
    """The gyro with its noise and resolution, and the autopilot's low-pass."""

    def __init__(self, setups: tuple[Setup, ...]) -> None:
        first = setups[0]
        self._biquad = butterworth(first.gyro_filter_hz, first.loop_hz)
        self._quantum = stacked([s.noise.gyro_resolution_rad_s for s in setups])
        # The estimator has found nine tenths of the bias before take-off.
        self._bias = vector([0.1 * np.array(s.noise.gyro_bias_rad_s) for s in setups])
        self._scale = vector([1.0 + np.array(s.noise.gyro_scale) for s in setups])
        self._cross = tuple(stacked([s.noise.gyro_cross[place] for s in setups]) for place in range(6))
        self._mode = FlexibleMode([s.effects for s in setups], first.loop_hz)
        zero = 0.0 * self._quantum
        self._memory = ((zero, zero, zero), (zero, zero, zero))
        self._vibration = RotorVibration(
            [s.effects for s in setups],
            [s.noise.rotor_line_rad_s for s in setups],
            first.airframe.n_rotors,
            first.loop_hz,
        )
        self._loop_hz, self._notch = first.loop_hz, first.tuning.notch
        self._notched = [self._memory] * (0 if self._notch is None else self._notch.n_harmonics)

    def read(self, rate: Triple, noise: Triple, speeds: tuple[Component, ...]) -> tuple[Triple, Triple]:
        """Return the sample and what the filter makes of it."""
        quantum, bias, scale = self._quantum, self._bias, self._scale
        (pq, pr, qp, qr, rp, rq), (p, q, r) = self._cross, self._mode.seen(rate)
        if self._vibration.present:
            roll, pitch, yaw = self._vibration.rates(speeds)
            p, q, r = p + roll, q + pitch, r + yaw
        sample = (
            ((scale[0] * p + pq * q + pr * r + bias[0] + noise[0]) / quantum + 0.5) // 1.0 * quantum,
            ((scale[1] * q + qp * p + qr * r + bias[1] + noise[1]) / quantum + 0.5) // 1.0 * quantum,
            ((scale[2] * r + rp * p + rq * q + bias[2] + noise[2]) / quantum + 0.5) // 1.0 * quantum,
        )
        filtered = sample
        if self._notch is not None:
            speed_hz = sum(speeds) / (2.0 * math.pi * len(speeds))
            for place, memory in enumerate(self._notched):
                biquad = self._notch.biquad(place + 1, speed_hz, self._loop_hz)
                filtered, self._notched[place] = filter_rates(filtered, memory, biquad)
        filtered, self._memory = filter_rates(filtered, self._memory, self._biquad)
        return sample, filtered


def _decide(
    setpoint: Triple,
    command: Triple,
    throttle: Component,
    controller: Controller,
    battery: _Battery,
    ops: Arithmetic,
) -> Decision:
    """Mix the command and turn it into rotor speeds, on the way that the autopilot goes."""
    gain = 1.0 / battery.lift if controller.compensates_voltage else 1.0
    scaled = (command[0] * gain, command[1] * gain, command[2] * gain)
    base = controller.curve.throttle(throttle) if controller.curve.present else throttle * gain
    mixed = mix(scaled, base, controller.mixer, ops)
    roll, pitch, yaw = mixed.torque
    actuators = _actuators(mixed.thrust, controller, battery, ops)
    return Decision(
        setpoint,
        command,
        throttle,
        mixed.limited,
        (roll / gain, pitch / gain, yaw / gain),
        mixed.thrust,
        actuators,
        _speeds(actuators, controller, battery),
    )


def _actuators(
    thrusts: tuple[Component, ...], controller: Controller, battery: _Battery, ops: Arithmetic
) -> tuple[Component, ...]:
    """Return the actuator outputs that the firmware takes for these fractions of the full thrust (0 to 1)."""
    outputs = []
    for thrust in thrusts:
        if controller.compensates_voltage:
            value = throttle_for_thrust(battery.lift * thrust, controller.expo) / battery.filtered
        elif controller.curve.present:
            value = controller.curve.output(thrust, battery.ratio, ops)
        else:
            value = throttle_for_thrust(thrust, controller.expo)
        outputs.append(ops.lower(value, 1.0))
    return tuple(outputs)


def _speeds(
    actuators: tuple[Component, ...], controller: Controller, battery: _Battery
) -> tuple[Component, ...]:
    """Return the rotor speeds at rest that the outputs lead to [rad/s]."""
    expo = controller.propeller_expo
    speeds = [
        controller.speed_max * thrust_of_throttle(value * battery.ratio, expo) ** 0.5 for value in actuators
    ]
    return tuple(speeds)


def _mistaken(
    decision: Decision, controller: Controller, battery: _Battery, time_s: float, ops: Arithmetic
) -> Decision:
    """Let the rotors do something else than what the log takes for achieved."""
    gain = 1.0 / battery.lift if controller.compensates_voltage else 1.0
    roll, pitch, yaw = controller.actuation.error(decision.achieved, time_s, ops)
    mixer = controller.mixer
    moved = tuple(
        thrust + gain * (r * roll + p * pitch + y * yaw)
        for thrust, r, p, y in zip(decision.thrust, mixer.roll, mixer.pitch, mixer.yaw, strict=True)
    )
    followed = controller.actuation.followed(moved, ops)
    thrusts = tuple(ops.higher(ops.lower(thrust, 1.0), 0.0) for thrust in followed)
    return decision._replace(
        targets=_speeds(_actuators(thrusts, controller, battery, ops), controller, battery)
    )


class _Battery:
    """The pack's voltage over its full one, and the autopilot's filtered view of it."""

    def __init__(self, setups: tuple[Setup, ...]) -> None:
        packs = [s.airframe.battery for s in setups]
        self._weight = stacked([s.airframe.mass_kg * GRAVITY_M_S2 for s in setups])
        self._current = stacked([pack.hover_current_a for pack in packs])
        self._drop = stacked([pack.resistance_ohm / pack.full_v for pack in packs])
        self._fall = stacked([pack.sag / pack.capacity_a_s for pack in packs])
        self._expo = stacked([s.firmware_expo for s in setups])
        self._used = self._current * 0.0
        self.ratio = self.filtered = self.lift = self._used + 1.0

    def update(self, thrust: Component, ops: Arithmetic) -> None:
        """Draw the current of this thrust for one period."""
        current = self._current * (thrust / self._weight) ** 1.5
        self._used = self._used + current * BATTERY_PERIOD_S
        self.ratio = ops.higher(1.0 - self._fall * self._used - self._drop * current, 0.5)
        # A 0.5 Hz low-pass, as AP_Motors_Thrust_Linearization filters the voltage.
        self.filtered = self.filtered + 0.24 * (self.ratio - self.filtered)
        self.lift = thrust_of_throttle(self.filtered, self._expo)


def _body(setups: tuple[Setup, ...]) -> Body:
    """Collect the plants' constants."""
    frames = [s.airframe for s in setups]
    step_s = 1.0 / setups[0].loop_hz
    inertia = np.array([frame.inertia_kg_m2 for frame in frames])
    torques = []
    for s in setups:
        # L, M, N per newton of each rotor about the centre of mass, wherever that is; (3, n_rotors).
        frame, (forward, right) = s.airframe, s.effects.mass_offset
        reach = float(np.hypot(*frame.position_m[:, :2].T).max())
        position = frame.position_m - reach * np.array([forward, right, 0.0])
        torques.append(torque_matrix(position, frame.spin, frame.torque_to_thrust_m))
    arms = np.array(torques)
    return Body(
        step_s=step_s,
        mass=stacked([frame.mass_kg for frame in frames]),
        inertia=inertia_terms(inertia[0] if len(frames) == 1 else inertia),
        damping=vector([frame.rate_damping_n_m_s for frame in frames]),
        thrust_per_speed2=tuple(
            stacked([float(f.rotor_thrust_n[i]) / f.rotor_speed_max_rad_s**2 for f in frames])
            for i in range(frames[0].n_rotors)
        ),
        arms=tuple(vector(list(arms[:, :, i])) for i in range(frames[0].n_rotors)),
        decay_up=_decay([frame.lag_up_s for frame in frames], step_s),
        decay_down=_decay([s.airframe.lag_down_s * s.effects.spin_down_ratio for s in setups], step_s),
        rotor_inertia=tuple(
            stacked([float(frame.spin[i]) * frame.rotor_inertia_kg_m2 for frame in frames])
            for i in range(frames[0].n_rotors)
        ),
        drag=stacked([frame.drag_n_s_m for frame in frames]),
        drag_area=stacked([frame.drag_area_m2 for frame in frames]),
        drag_height=stacked([frame.drag_height_m for frame in frames]),
    )


def hover_rad_s_of(airframe: SimulatedAirframe) -> float:
    """Return the speed of whole rotors that carry the weight [rad/s]."""
    return float(airframe.rotor_speed_max_rad_s * airframe.hover_throttle**0.5)


def _decay(lags_s: Sequence[float], step_s: float) -> tuple[Component, Component]:
    """Return what is left of a gap after half and after the whole step; nothing without lag."""
    half = [math.exp(-0.5 * step_s / lag) if lag > 0.0 else 0.0 for lag in lags_s]
    return stacked(half), stacked([value * value for value in half])


def mixer_factors(airframe: SimulatedAirframe, autopilot: str) -> FloatArray:
    """Return motor command per unit of roll, pitch, yaw and throttle, shape (n_rotors, 4)."""
    if autopilot == "px4":
        effectiveness = np.vstack([airframe.torque_per_thrust, -np.ones(airframe.n_rotors)])
        return normalised_allocation(airframe.max_thrust_n * effectiveness)
    factors = frame_geometry(airframe.frame_class, airframe.frame_type).mixer
    if autopilot == "betaflight":
        factors = np.sign(factors)
    return np.column_stack([factors, np.ones(airframe.n_rotors)])


def torque_gain(airframe: SimulatedAirframe, autopilot: str) -> FloatArray:
    """Return N m per unit torque command with a full battery, shape (3, 3), at rest of the curve."""
    factors = mixer_factors(airframe, autopilot)[:, :3]
    return airframe.max_thrust_n * airframe.torque_per_thrust @ factors


def controller_gains(setup: Setup) -> Gains:
    """Tune the loops to the vehicle, as an autotune would.

    The rate loop's crossover is set by everything that delays it; the
    derivative makes up for part of the motors' lag.
    """
    frame = setup.airframe
    gain = np.diagonal(np.linalg.solve(frame.inertia_kg_m2, torque_gain(frame, setup.autopilot)))
    lag = 0.5 * (frame.lag_up_s + frame.lag_down_s)
    waiting = math.sqrt(2.0) / (2.0 * math.pi * setup.gyro_filter_hz)
    waiting += (1.5 + setup.delay_steps) / setup.loop_hz
    crossover = np.array([1.0, 1.0, 0.4]) * min(0.4 / (waiting + 0.5 * lag), 25.0)
    proportional = crossover / gain * np.array(setup.tuning.axis_gain)
    lead_s = np.array([0.6, 0.6, 0.0]) * lag
    tuning = setup.tuning
    of_p, of_i, of_d, of_angle = np.array(tuning.single_gain)
    return Gains(
        attitude=vector([of_angle * np.minimum(0.25 * crossover, (6.0, 6.0, 2.5))]),
        proportional=vector([of_p * proportional]),
        integral=vector([of_i * 0.25 * crossover * proportional]),
        derivative=vector([of_d * lead_s * proportional]),
        derivative_weight=vector(
            [np.array([_weight(tuning.of_derivative_hz(axis), setup.loop_hz) for axis in range(3)])]
        ),
        target_weight=_weight(tuning.target_hz, setup.loop_hz),
        error_weight=_weight(tuning.error_hz, setup.loop_hz),
        slew_limit=tuning.slew_limit,
        step_s=1.0 / setup.loop_hz,
    ).scaled(tuning.gain)


def final_gains(setup: Setup) -> Gains:
    """Return the gains at the end of the flight."""
    later, first = setup.tuning.later_gain, setup.tuning.gain
    gains = controller_gains(setup)
    return gains if later is None else gains.scaled(later / first)


def before_change(setup: Setup) -> Tuning:
    """Return the tuning of the flight as if its gains were never changed."""
    return replace(setup.tuning, later_gain=None)


def change_s(setup: Setup) -> float:
    """Return when `Tuning.later_gain` takes over: in the middle of the manoeuvre [s]."""
    return 0.5 * (setup.schedule.manoeuvre_s + setup.schedule.land_s)


def _weight(cutoff_hz: float, loop_hz: float) -> float:
    """Return the weight of a new value in a first-order filter, 1 without one."""
    return 1.0 / (1.0 + loop_hz / (2.0 * math.pi * cutoff_hz)) if cutoff_hz > 0.0 else 1.0


def _together(gains: Sequence[Gains]) -> Gains:
    """Put the gains of all flights beside each other."""
    return gains[0]._replace(
        attitude=vector([np.array(g.attitude) for g in gains]),
        proportional=vector([np.array(g.proportional) for g in gains]),
        integral=vector([np.array(g.integral) for g in gains]),
        derivative=vector([np.array(g.derivative) for g in gains]),
    )


def _controller(setups: tuple[Setup, ...]) -> Controller:
    """Collect what the control loop needs."""
    first = setups[0]
    gains = _together([controller_gains(s) for s in setups])
    factors = np.array([mixer_factors(s.airframe, s.autopilot) for s in setups])
    roll, pitch, yaw, throttle = (
        tuple(stacked([float(f[motor, axis]) for f in factors]) for motor in range(factors.shape[1]))
        for axis in range(4)
    )
    return Controller(
        law=rate_law(first.autopilot),
        gains=gains,
        later_gains=_together([final_gains(s) for s in setups]),
        mixer=Mixer(
            roll=roll,
            pitch=pitch,
            yaw=yaw,
            throttle=throttle,
            hover=stacked([s.hover_throttle for s in setups]),
        ),
        expo=stacked([s.firmware_expo for s in setups]),
        propeller_expo=stacked([s.airframe.thrust_expo for s in setups]),
        speed_max=stacked([s.airframe.rotor_speed_max_rad_s for s in setups]),
        compensates_voltage=first.autopilot == "ardupilot",
        curve=output_curve([s.effects for s in setups], wanted=first.autopilot == "betaflight"),
        actuation=Actuation([s.effects for s in setups]),
    )


def _inputs(setups: tuple[Setup, ...]) -> Iterator[tuple[bool, PlanRow, Triple, Triple, Triple]]:
    """Yield for every control period: motors run, what is commanded, gyro noise, wind, disturbing torque."""
    first = setups[0]
    time_s, phases = _times(first), first.schedule
    active = (time_s >= phases.take_off_s) & (time_s < phases.disarm_s)
    # Commanded height: climb, hold, come down, and press on below the ground until disarmed.
    climb_end = 0.5 * (phases.take_off_s + phases.manoeuvre_s)
    height = np.interp(
        time_s,
        [phases.take_off_s, climb_end, phases.land_s, phases.touch_down_s, phases.disarm_s],
        [0.0, phases.height_m, phases.height_m, 0.0, -3.0],
    )
    rows = zip(
        active.tolist(),
        height.tolist(),
        np.gradient(height, time_s).tolist(),
        _rows(setups, lambda s: _plan(s)[0]),
        _rows(setups, lambda s: _plan(s)[1]),
        _rows(setups, lambda s: _plan(s)[2]),
        _rows(setups, _gyro_noise),
        _rows(setups, _wind),
        _rows(setups, _disturbance),
        strict=True,
    )
    for run, above, climb, attitude, feedforward, injected, noise, wind, disturbed in rows:
        yield run, PlanRow(above, climb, attitude, feedforward, injected), noise, wind, disturbed


def _rows(setups: tuple[Setup, ...], series: Callable[[Setup], FloatArray]) -> Any:
    """Rows of floats for one flight, of (n_columns, n_flights) in single precision for many."""
    one = series(setups[0])
    if len(setups) == 1:
        return one.tolist()
    rows = np.empty((*one.shape, len(setups)), dtype=np.float32)
    for flight, setup in enumerate(setups):
        rows[..., flight] = series(setup)
    return rows


def _plan(setup: Setup) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Commanded attitude, rates to add, torque to add, over the whole flight."""
    from scipy.signal import lfilter

    n, reference = n_steps(setup), setup.reference
    begin = round(setup.schedule.manoeuvre_s * setup.loop_hz)
    rows = slice(begin, begin + reference.tilt_rad.shape[0])
    euler, rate, torque = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    euler[rows, :2] = reference.tilt_rad
    euler[rows, 2] = reference.yaw_rate_rad_s
    euler[:, 2] = np.cumsum(euler[:, 2]) / setup.loop_hz
    # The autopilot shapes the pilot's steps (ATC_INPUT_TC): two lags of 0.1 s.
    weight = 1.0 / (1.0 + 0.1 * setup.loop_hz)
    shaping = np.polymul([1.0, weight - 1.0], [1.0, weight - 1.0])
    euler = np.asarray(lfilter([weight * weight], shaping, euler, axis=0), dtype=np.float64)
    rate[rows], torque[rows] = reference.rate_rad_s, reference.torque
    slopes = np.asarray(np.gradient(euler, 1.0 / setup.loop_hz, axis=0), dtype=np.float64)
    return quaternion_from_euler(euler), rate + body_rates(euler, slopes), torque


def _gyro_noise(setup: Setup) -> FloatArray:
    """White noise of the gyro over its sampled bandwidth, and what rings [rad/s], shape (n_steps, 3)."""
    rng = generator(setup, "gyro")
    sigma = setup.noise.gyro_rad_s_per_rthz * math.sqrt(0.5 * setup.loop_hz)
    white = sigma * rng.standard_normal((n_steps(setup), 3))
    if not setup.noise.frame_line_rad_s:
        return white
    return white + ringing(
        setup.noise.frame_line_hz,
        setup.noise.frame_line_rad_s,
        n_steps(setup),
        setup.loop_hz,
        generator(setup, "frame line"),
    )


def _wind(setup: Setup) -> FloatArray:
    """Wind in NED [m/s], shape (n_steps, 3)."""
    return dryden_wind(setup.wind, n_steps(setup), 1.0 / setup.loop_hz, generator(setup, "wind"))


def _disturbance(setup: Setup) -> FloatArray:
    """Torque of the disturbances [N m], shape (n_steps, 3)."""
    inertia, step_s = setup.airframe.inertia_kg_m2, 1.0 / setup.loop_hz
    return disturbance(setup.effects, inertia, n_steps(setup), step_s, generator(setup, "disturbance"))


def generator(setup: Setup, purpose: str) -> np.random.Generator:
    """Return an own stream of random numbers for each purpose, so that none shifts another."""
    return np.random.default_rng([setup.seed, *purpose.encode()])
