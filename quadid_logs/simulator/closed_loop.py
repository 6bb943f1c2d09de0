"""Fly: the closed loop of plant, sensors and autopilot."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from struct import Struct
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.ardupilot.frames import frame_geometry
from quadid_logs.data.log import POSITION_VALUES
from quadid_logs.maths.frames import normalised_allocation, torque_matrix
from quadid_logs.maths.rotational_dynamics import Quadruple, Triple, inertia_terms
from quadid_logs.maths.rotations import body_rates, quaternion_from_euler
from quadid_logs.simulator.airframes import SimulatedAirframe
from quadid_logs.simulator.control import (
    ZERO,
    Gains,
    Mixer,
    RateLaw,
    RateMemory,
    TrackingNotch,
    altitude_throttle,
    butterworth,
    filter_rates,
    higher,
    lower,
    mix,
    rate_law,
    rate_setpoint,
    reset_rates,
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
from quadid_logs.simulator.whole_gains import WholeGains
from quadid_logs.simulator.wind import Wind, dryden_wind
from quadid_logs.vocabulary import GRAVITY_M_S2

SPIN_MIN: Final = 0.15
SPIN_MAX: Final = 0.95
BATTERY_PERIOD_S: Final = 0.1
#: Without a controller of the heading a pilot looks after it [1/s].
_PILOT_HOLDS_1_S: Final = 1.0
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


CHANNELS: Final = (
    Channel("gyro_filtered", 3),
    Channel("setpoint", 3),
    Channel("command", 3),
    Channel("throttle", 1),
    Channel("limited", 1),
    Channel("attitude", 4),
    Channel("voltage", 1),
    Channel("voltage_filtered", 1),
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
    channels : mapping of str to ndarray, shape (n_steps, n_columns)
        By the names of `CHANNELS` and, where positions are held, `NAVIGATION`. ``command`` is exactly
        what enters the mixer, ``achieved`` what it made of it; ``gyro`` is unfiltered, ``torque`` [N m] and
        ``rate`` [rad/s] are true.
    setup : Setup
    """

    time_s: FloatArray
    channels: dict[str, FloatArray]
    setup: Setup


def fly(setup: Setup) -> Record:
    """Fly and record everything."""
    channels = CHANNELS + (() if setup.position is None else NAVIGATION)
    widths = [channel.columns or setup.airframe.n_rotors for channel in channels]
    values = np.split(_fly(setup, sum(widths)), np.cumsum(widths)[:-1], axis=1)
    named = {channel.name: columns for channel, columns in zip(channels, values, strict=True)}
    return Record(time_s=_times(setup), channels=named, setup=setup)


def _fly(setup: Setup, width: int) -> FloatArray:
    """Run the loop; return its rows, shape (n_steps, width)."""
    n = n_steps(setup)
    # Numpy takes twice as long to find out that all are floats.
    packed, row_of = bytearray(8 * n * width), Struct(f"{width}d")
    for k, row in enumerate(_periods(setup)):
        row_of.pack_into(packed, k * row_of.size, *row)
    return np.frombuffer(packed).reshape(n, width)


def _times(setup: Setup) -> FloatArray:
    """Beginning of every control period [s]."""
    return np.arange(n_steps(setup)) / setup.loop_hz


def n_steps(setup: Setup) -> int:
    """Return the number of control periods of the flight."""
    return round(setup.schedule.end_s * setup.loop_hz)


class Controller(NamedTuple):
    """Constants of the control loop."""

    law: RateLaw
    gains: Gains
    later_gains: Gains
    mixer: Mixer
    expo: float
    propeller_expo: float
    speed_max: float
    compensates_voltage: bool
    curve: OutputCurve
    actuation: Actuation


class Decision(NamedTuple):
    """The controller's outputs of one control period."""

    setpoint: Triple
    command: Triple
    throttle: float
    limited: float
    achieved: Triple
    thrust: tuple[float, ...]
    actuators: tuple[float, ...]
    targets: tuple[float, ...]


class PlanRow(NamedTuple):
    """What the flight plan commands in one control period."""

    height: float
    climb: float
    attitude: Quadruple
    feedforward: Triple
    injected: Triple


def _periods(setup: Setup) -> Iterator[tuple[float, ...]]:
    """Yield one record row per control period."""
    body, controller, battery, gyro = _body(setup), _controller(setup), _Battery(setup), _Gyro(setup)
    frame, phases = setup.airframe, setup.schedule
    # What acts on the vehicle from outside, wind excepted.
    inertia = vector(np.diagonal(frame.inertia_kg_m2))
    surroundings = Surroundings(setup.effects, inertia, frame.mass_kg, 1.0 / setup.loop_hz)
    faults = MotorFaults(setup.effects, frame.n_rotors, phases.manoeuvre_s, phases.land_s)
    still = (0.0,) * frame.n_rotors
    idle = Decision(ZERO, ZERO, 0.0, 0.0, ZERO, still, still, still)
    state = at_rest(frame.n_rotors)
    rates = reset_rates(idle.command, idle.command)
    n_late, logs_used, given = setpoint_loops(setup), setup.autopilot == "betaflight", deque[Triple]()
    height_integral, decision = 0.0, idle
    change = round(change_s(setup) * setup.loop_hz)
    queue = [idle.targets] * setup.delay_steps
    navigator = None
    if setup.position is not None:
        navigator = Navigator(setup.position, setup.loop_hz, _times(setup), phases.manoeuvre_s)
    battery_period = round(BATTERY_PERIOD_S * setup.loop_hz)
    for k, (active, plan, noise, wind, disturbed) in enumerate(_inputs(setup)):
        if k % battery_period == 0:
            battery.update(state.wrench.thrust)
        raw, filtered = gyro.read(state.rate, noise, state.speeds)
        navigated: tuple[float, ...] = ()
        if navigator is not None:
            flown = navigator.fly(k, state.velocity)
            roll, pitch, yaw = (sum(both) for both in zip(plan.feedforward, flown.forward, strict=True))
            plan = plan._replace(attitude=flown.attitude, feedforward=(roll, pitch, yaw))
            navigated = flown.row
        if active:
            lift = plan.height - state.height
            height_integral = higher(lower(height_integral + 0.5 * body.step_s * lift, 2.0), -2.0)
            gains = controller.gains if k < change else controller.later_gains
            setpoint = rate_setpoint(state.attitude, plan.attitude, plan.feedforward, gains)
            if not given:
                rates = reset_rates(setpoint, filtered)
                given.extend([setpoint] * n_late)
            used = given.popleft()
            given.append(setpoint)
            command, rates = torque_command(
                controller.law, used, filtered, rates, gains, limited=decision.limited
            )
            throttle = altitude_throttle(
                lift,
                plan.climb + state.velocity[2],
                height_integral,
                hover=controller.mixer.hover,
                attitude=state.attitude,
            )
            command = (
                command[0] + plan.injected[0],
                command[1] + plan.injected[1],
                command[2] + plan.injected[2],
            )
            told = used if logs_used else setpoint
            decision = _decide(told, command, throttle, controller, battery)
            if controller.actuation.present:
                decision = _mistaken(decision, controller, battery, k / setup.loop_hz)
            if faults.present:
                decision = decision._replace(targets=faults.speeds(decision.targets, k / setup.loop_hz))
        else:
            rates = reset_rates(idle.command, idle.command)
            given.clear()
            height_integral, decision = 0.0, idle
        yield (*_row(state, decision, rates, raw, filtered, battery), *navigated)
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
) -> tuple[float, ...]:
    """Return the values of the `CHANNELS`."""
    roll, pitch, yaw = rates
    return (
        *filtered,
        *decision.setpoint,
        *decision.command,
        decision.throttle,
        decision.limited,
        *state.attitude,
        battery.ratio,
        battery.filtered,
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

    def __init__(self, setup: Setup) -> None:
        noise, loop_hz = setup.noise, setup.loop_hz
        self._biquad = butterworth(setup.gyro_filter_hz, loop_hz)
        self._quantum = noise.gyro_resolution_rad_s
        # The estimator has found nine tenths of the bias before take-off.
        self._bias = vector(0.1 * np.array(noise.gyro_bias_rad_s))
        self._scale = vector(1.0 + np.array(noise.gyro_scale))
        self._cross = noise.gyro_cross
        self._mode = FlexibleMode(setup.effects, loop_hz)
        self._memory = (ZERO, ZERO)
        self._vibration = RotorVibration(
            setup.effects, noise.rotor_line_rad_s, setup.airframe.n_rotors, loop_hz
        )
        self._loop_hz, self._notch = loop_hz, setup.tuning.notch
        self._notched = [self._memory] * (0 if self._notch is None else self._notch.n_harmonics)

    def read(self, rate: Triple, noise: Triple, speeds: tuple[float, ...]) -> tuple[Triple, Triple]:
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
    setpoint: Triple, command: Triple, throttle: float, controller: Controller, battery: _Battery
) -> Decision:
    """Mix the command and turn it into rotor speeds, on the way that the autopilot goes."""
    gain = 1.0 / battery.lift if controller.compensates_voltage else 1.0
    scaled = (command[0] * gain, command[1] * gain, command[2] * gain)
    base = controller.curve.throttle(throttle) if controller.curve.present else throttle * gain
    mixed = mix(scaled, base, controller.mixer)
    roll, pitch, yaw = mixed.torque
    actuators = _actuators(mixed.thrust, controller, battery)
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


def _actuators(thrusts: tuple[float, ...], controller: Controller, battery: _Battery) -> tuple[float, ...]:
    """Return the actuator outputs that the firmware takes for these fractions of the full thrust (0 to 1)."""
    outputs = []
    for thrust in thrusts:
        if controller.compensates_voltage:
            value = throttle_for_thrust(battery.lift * thrust, controller.expo) / battery.filtered
        elif controller.curve.present:
            value = controller.curve.output(thrust, battery.ratio)
        else:
            value = throttle_for_thrust(thrust, controller.expo)
        outputs.append(lower(value, 1.0))
    return tuple(outputs)


def _speeds(actuators: tuple[float, ...], controller: Controller, battery: _Battery) -> tuple[float, ...]:
    """Return the rotor speeds at rest that the outputs lead to [rad/s]."""
    expo = controller.propeller_expo
    speeds = [
        controller.speed_max * thrust_of_throttle(value * battery.ratio, expo) ** 0.5 for value in actuators
    ]
    return tuple(speeds)


def _mistaken(decision: Decision, controller: Controller, battery: _Battery, time_s: float) -> Decision:
    """Let the rotors do something else than what the log takes for achieved."""
    gain = 1.0 / battery.lift if controller.compensates_voltage else 1.0
    roll, pitch, yaw = controller.actuation.error(decision.achieved, time_s)
    mixer = controller.mixer
    moved = tuple(
        thrust + gain * (r * roll + p * pitch + y * yaw)
        for thrust, r, p, y in zip(decision.thrust, mixer.roll, mixer.pitch, mixer.yaw, strict=True)
    )
    followed = controller.actuation.followed(moved)
    thrusts = tuple(higher(lower(thrust, 1.0), 0.0) for thrust in followed)
    return decision._replace(targets=_speeds(_actuators(thrusts, controller, battery), controller, battery))


class _Battery:
    """The pack's voltage over its full one, and the autopilot's filtered view of it."""

    def __init__(self, setup: Setup) -> None:
        pack = setup.airframe.battery
        self._weight = setup.airframe.mass_kg * GRAVITY_M_S2
        self._current = pack.hover_current_a
        self._drop = pack.resistance_ohm / pack.full_v
        self._fall = pack.sag / pack.capacity_a_s
        self._expo = setup.firmware_expo
        self._used = 0.0
        self.ratio = self.filtered = self.lift = 1.0

    def update(self, thrust: float) -> None:
        """Draw the current of this thrust for one period."""
        current = self._current * (thrust / self._weight) ** 1.5
        self._used = self._used + current * BATTERY_PERIOD_S
        self.ratio = higher(1.0 - self._fall * self._used - self._drop * current, 0.5)
        # A 0.5 Hz low-pass, as AP_Motors_Thrust_Linearization filters the voltage.
        self.filtered = self.filtered + 0.24 * (self.ratio - self.filtered)
        self.lift = thrust_of_throttle(self.filtered, self._expo)


def _body(setup: Setup) -> Body:
    """Collect the plant's constants."""
    frame, step_s = setup.airframe, 1.0 / setup.loop_hz
    # L, M, N per newton of each rotor about the centre of mass, wherever that is; (3, n_rotors).
    forward, right = setup.effects.mass_offset
    reach = float(np.hypot(*frame.position_m[:, :2].T).max())
    position = frame.position_m - reach * np.array([forward, right, 0.0])
    arms = torque_matrix(position, frame.spin, frame.torque_to_thrust_m)
    return Body(
        step_s=step_s,
        mass=frame.mass_kg,
        inertia=inertia_terms(frame.inertia_kg_m2),
        damping=vector(frame.rate_damping_n_m_s),
        thrust_per_speed2=tuple((frame.rotor_thrust_n / frame.rotor_speed_max_rad_s**2).tolist()),
        arms=tuple(vector(arm) for arm in arms.T),
        decay_up=_decay(frame.lag_up_s, step_s),
        decay_down=_decay(frame.lag_down_s * setup.effects.spin_down_ratio, step_s),
        rotor_inertia=tuple((frame.spin * frame.rotor_inertia_kg_m2).tolist()),
        drag=frame.drag_n_s_m,
        drag_area=frame.drag_area_m2,
        drag_height=frame.drag_height_m,
    )


def hover_rad_s_of(airframe: SimulatedAirframe) -> float:
    """Return the speed of whole rotors that carry the weight [rad/s]."""
    return float(airframe.rotor_speed_max_rad_s * airframe.hover_throttle**0.5)


def _decay(lag_s: float, step_s: float) -> tuple[float, float]:
    """Return what is left of a gap after half and after the whole step; nothing without lag."""
    half = math.exp(-0.5 * step_s / lag_s) if lag_s > 0.0 else 0.0
    return half, half * half


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
    gains = Gains(
        attitude=vector(of_angle * np.minimum(0.25 * crossover, (6.0, 6.0, 2.5))),
        proportional=vector(of_p * proportional),
        integral=vector(of_i * 0.25 * crossover * proportional),
        derivative=vector(of_d * lead_s * proportional),
        derivative_weight=vector(
            [_weight(tuning.of_derivative_hz(axis), setup.loop_hz) for axis in range(3)]
        ),
        target_weight=_weight(tuning.target_hz, setup.loop_hz),
        error_weight=_weight(tuning.error_hz, setup.loop_hz),
        slew_limit=tuning.slew_limit,
        step_s=1.0 / setup.loop_hz,
    )
    return _as_set(setup, gains.scaled(tuning.gain))


def _as_set(setup: Setup, gains: Gains) -> Gains:
    """Return the gains that come nearest of those that the firmware can be set to."""
    if setup.autopilot != "betaflight":
        return gains
    roll, pitch, yaw = gains.attitude
    gains = gains._replace(attitude=(roll, pitch, lower(yaw, _PILOT_HOLDS_1_S)))
    return WholeGains.near(gains).put_into(gains)


def final_gains(setup: Setup) -> Gains:
    """Return the gains at the end of the flight."""
    later, first = setup.tuning.later_gain, setup.tuning.gain
    gains = controller_gains(setup)
    return gains if later is None else _as_set(setup, gains.scaled(later / first))


def setpoint_loops(setup: Setup) -> int:
    """Return how many loops a rate set-point is old when the rate controller takes it.

    ArduPilot's and PX4's attitude controllers run behind the rate controller. Betaflight's runs before it, on
    angles that are 5 ms old in the mean (``TASK_ATTITUDE`` at 100 Hz) and pass three poles of 98 Hz
    (``pid.c``, ATTITUDE_CUTOFF_HZ).
    """
    return max(round(0.0099 * setup.loop_hz), 1) if setup.autopilot == "betaflight" else 1


def before_change(setup: Setup) -> Tuning:
    """Return the tuning of the flight as if its gains were never changed."""
    return replace(setup.tuning, later_gain=None)


def change_s(setup: Setup) -> float:
    """Return when `Tuning.later_gain` takes over: in the middle of the manoeuvre [s]."""
    return 0.5 * (setup.schedule.manoeuvre_s + setup.schedule.land_s)


def _weight(cutoff_hz: float, loop_hz: float) -> float:
    """Return the weight of a new value in a first-order filter, 1 without one."""
    return 1.0 / (1.0 + loop_hz / (2.0 * math.pi * cutoff_hz)) if cutoff_hz > 0.0 else 1.0


def _controller(setup: Setup) -> Controller:
    """Collect what the control loop needs."""
    roll, pitch, yaw, throttle = mixer_factors(setup.airframe, setup.autopilot).T.tolist()
    return Controller(
        law=rate_law(setup.autopilot),
        gains=controller_gains(setup),
        later_gains=final_gains(setup),
        mixer=Mixer(
            roll=tuple(roll),
            pitch=tuple(pitch),
            yaw=tuple(yaw),
            throttle=tuple(throttle),
            hover=setup.hover_throttle,
        ),
        expo=setup.firmware_expo,
        propeller_expo=setup.airframe.thrust_expo,
        speed_max=setup.airframe.rotor_speed_max_rad_s,
        compensates_voltage=setup.autopilot == "ardupilot",
        curve=output_curve(setup.effects, wanted=setup.autopilot == "betaflight"),
        actuation=Actuation(setup.effects),
    )


def _inputs(setup: Setup) -> Iterator[tuple[bool, PlanRow, Triple, Triple, Triple]]:
    """Yield for every control period: motors run, what is commanded, gyro noise, wind, disturbing torque."""
    time_s, phases = _times(setup), setup.schedule
    active = (time_s >= phases.take_off_s) & (time_s < phases.disarm_s)
    # Commanded height: climb, hold, come down, and press on below the ground until disarmed.
    climb_end = 0.5 * (phases.take_off_s + phases.manoeuvre_s)
    height = np.interp(
        time_s,
        [phases.take_off_s, climb_end, phases.land_s, phases.touch_down_s, phases.disarm_s],
        [0.0, phases.height_m, phases.height_m, 0.0, -3.0],
    )
    n, step_s = n_steps(setup), 1.0 / setup.loop_hz
    wind = dryden_wind(setup.wind, n, step_s, generator(setup, "wind"))
    torque = disturbance(
        setup.effects, setup.airframe.inertia_kg_m2, n, step_s, generator(setup, "disturbance")
    )
    above = (height, np.gradient(height, time_s), *_plan(setup))
    # White noise of the gyro over its sampled bandwidth, and what rings [rad/s], shape (n_steps, 3)
    rng = generator(setup, "gyro")
    sigma = setup.noise.gyro_rad_s_per_rthz * math.sqrt(0.5 * setup.loop_hz)
    white = sigma * rng.standard_normal((n_steps(setup), 3))
    if not setup.noise.frame_line_rad_s:
        gyro_noise = white
    else:
        gyro_noise = white + ringing(
            setup.noise.frame_line_hz,
            setup.noise.frame_line_rad_s,
            n_steps(setup),
            setup.loop_hz,
            generator(setup, "frame line"),
        )
    outside = (gyro_noise, wind, torque)
    rows = zip(*(series.tolist() for series in (active, *above, *outside)), strict=True)
    for run, *plan, noise, blown, disturbed in rows:
        yield run, PlanRow(*plan), noise, blown, disturbed


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


def generator(setup: Setup, purpose: str) -> np.random.Generator:
    """Return an own stream of random numbers for each purpose, so that none shifts another."""
    return np.random.default_rng([setup.seed, *purpose.encode()])
