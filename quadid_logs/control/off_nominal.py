"""Vehicles otherwise than they flew: another battery, load, air or propeller.

A motor at the fraction y of its full voltage turns its propeller at the fraction x of its full speed. With
thrust c x^2 and torque q x^2, both 1 as flown, y = f(x^2) + a (1 - e) (q - 1) x^2. f undoes the thrust curve
(1 - e) y + e y^2. What bends that curve away from a square is, as far as the part a, that the motor's current
drops voltage in proportion to the torque (y = e x + (1 - e) q x^2 of a motor is a curve of that expo within
some hundredths); the rest is the speed controller's. From this one equation follow

- hovering: c x^2 is the weight, so that x goes with the root of mass over c;
- the slope of thrust by voltage, 2 c x / y'(x), times that of the voltage by the command, which is the
  firmware's (`ThrustLaw`): over the inertia it is the effectiveness;
- the lag of a rotor, J / y'(x): what holds its speed is the slope of voltage by speed;
- the lead of the yaw torque, J / (2 k q x), of accelerating rotors over their drag;
- the damping by rotors in their own inflow, which goes with density, speed and the cube of the diameter D.

c and q go with the density, with D^4 and D^5, the rotor's inertia J with D^5 (propellers of one shape and
material). Sources: W. Johnson, *Helicopter Theory*, 2.2 (thrust and torque coefficients); R. W. Beard, T. W.
McLain, *Small Unmanned Aircraft*, supplement on motors and propellers (the motor's equation).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.scaled_loop import ScaledLoops, spare
from quadid_logs.data.closed_loop import Estimated, Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.off_nominal import Condition, ConditionKind, ConditionMargins, Ranges, ThrustLaw
from quadid_logs.data.tuning import Limits
from quadid_logs.maths.even_draws import Drawn, even_normal, even_uniform
from quadid_logs.maths.normal import ENDS_95, NORMAL_95

#: Voltage of a lithium-polymer cell that is full, and where pilots are warned to land (docs/health.md) [V].
FULL_V: Final = 4.2
EMPTY_V: Final = 3.5
#: Expo of propellers as measured on stands (docs/method.md), where the flight does not tell it.
_EXPOS: Final = (0.2, 0.8)
#: Part of full thrust that carries a multirotor, where the throttle was not logged: from two to five times
#: its weight.
_HOVERS: Final = (0.2, 0.5)
_SEED: Final = 3
_N_CURVE: Final = 2001
#: The estimate, and so many of the drawn vehicles: the 2.5 % quantile is known to a quarter of a standard
#: deviation.
N_PLANTS: Final = 201
#: What no flight tells from the vehicle that flew.
_SAME: Final = 0.005
#: Of full throttle: no multirotor hovers on less.
_LEAST: Final = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownPoint:
    """Where a vehicle flew, as far as its log tells.

    Attributes
    ----------
    law : ThrustLaw
    command : float
        Mean command of thrust, 0 where it was not logged.
    expo : float
        Of the propellers' thrust curve; NaN where nothing tells it.
    expo_half_width : float
        Of its 95 % interval.
    voltage_v : float
        Mean of the battery's; NaN where it was not logged.
    highest_v, lowest_v : float
        Between which it flew.
    n_cells : int
        0 where the voltage does not tell.
    """

    law: ThrustLaw
    command: float = 0.0
    expo: float = float("nan")
    expo_half_width: float = 0.0
    voltage_v: float = float("nan")
    highest_v: float = float("nan")
    lowest_v: float = float("nan")
    n_cells: int = 0


class Factors(NamedTuple):
    """On effectiveness, damping, lag and lead of vehicles, each (n_plants,)."""

    effectiveness: FloatArray
    damping: FloatArray
    lag: FloatArray
    lead: FloatArray


def conditions(point: FlownPoint, ranges: Ranges) -> Iterator[Condition]:
    """Yield what may be otherwise, one thing at a time.

    Yields
    ------
    Condition
        None that is as flown. The battery only where its voltage was logged.
    """
    kinds = ConditionKind
    # The battery full and empty; where its cells are not known, as far as it was flown.
    if point.voltage_v > 0.0:
        full_v = max(FULL_V * point.n_cells, point.highest_v)
        empty_v = min(EMPTY_V * point.n_cells or np.inf, point.lowest_v)
        for kind, volts in ((kinds.BATTERY_FULL, full_v), (kinds.BATTERY_EMPTY, empty_v)):
            if _differs(volts / point.voltage_v):
                yield Condition(kind, voltage=volts / point.voltage_v, voltage_v=volts)
    for kind, mass in zip((kinds.LIGHTER, kinds.HEAVIER), ranges.mass, strict=True):
        if _differs(mass):
            yield Condition(kind, mass=mass, inertia=mass)
    if ranges.mass[1] > 1.0 and _differs(ranges.mass[1]):
        yield Condition(kinds.PAYLOAD, mass=ranges.mass[1])
    for kind, density in zip((kinds.THIN_AIR, kinds.DENSE_AIR), ranges.density, strict=True):
        if _differs(density):
            yield Condition(kind, density=density)
    sizes = (kinds.SMALLER_PROPELLER, kinds.LARGER_PROPELLER)
    for kind, propeller in zip(sizes, ranges.propeller, strict=True):
        if _differs(propeller):
            yield Condition(kind, propeller=propeller)


def _differs(factor: float) -> bool:
    return abs(factor - 1.0) > _SAME


class _Motors(NamedTuple):
    """Vehicles in hover: expo, part of full speed, part of a full battery's voltage; each (n_plants,).

    ``share`` is what the motors themselves make of the curve, and of the change of lag and damping: speed
    controllers make the rest, and may hold a lag where it is.
    """

    expo: FloatArray
    speed: FloatArray
    full: float
    share: FloatArray


def _motors(point: FlownPoint, n_plants: int) -> _Motors:
    """Return what moves the estimate, then what moves vehicles that the log allows."""
    middle, reach = 0.5 * sum(_EXPOS), 0.5 * (_EXPOS[1] - _EXPOS[0])
    even, normal = np.zeros((3, n_plants)), np.zeros(n_plants)
    even[:, 1:] = 2.0 * even_uniform(Drawn.MOTORS, n_plants - 1, _SEED).T - 1.0
    normal[1:] = even_normal(Drawn.MOTORS, n_plants - 1, _SEED)[:, 0] / NORMAL_95
    expo = middle + reach * even[0]
    if np.isfinite(point.expo):
        expo = point.expo + point.expo_half_width * normal
    expo = np.clip(expo, 0.0, 1.0)
    full = 1.0
    if point.n_cells and point.voltage_v > 0.0:
        full = point.voltage_v / (FULL_V * point.n_cells)
    low, high = (np.sqrt(one) for one in _HOVERS)
    speed = 0.5 * (low + high) + 0.5 * (high - low) * even[1]
    if point.command > 0.0:
        law = point.law
        before, behind = (
            law.before(point.voltage_v, point.n_cells),
            law.behind(point.voltage_v, point.n_cells),
        )
        output = behind * law.output(np.array([min(before * point.command, 1.0)]))[0]
        voltage = float(np.clip(output * full, _LEAST, 1.0))
        speed = np.sqrt((1.0 - expo) * voltage + expo * voltage**2)
    return _Motors(expo, speed, full, 0.5 + 0.5 * even[2])


class _At(NamedTuple):
    """Slope of thrust by command, damping torque, lag and lead at a point; each (n_plants,)."""

    slope: FloatArray
    damping: FloatArray
    lag: FloatArray
    lead: FloatArray


def _at(point: FlownPoint, motors: _Motors, condition: Condition) -> _At:
    law, D = point.law, condition.propeller
    c, q, J = condition.density * D**4, condition.density * D**5, D**5
    x = motors.speed * np.sqrt(condition.mass / c)
    full = motors.full * condition.voltage
    volts = point.voltage_v * condition.voltage
    before = law.before(volts, point.n_cells) / (condition.density if law.for_density else 1.0)
    behind = law.behind(volts, point.n_cells)
    # Slope of the thrust curve where it gives x^2, and what the load takes beyond that of the flown one.
    curve = np.sqrt((1.0 - motors.expo) ** 2 + 4.0 * motors.expo * x**2)
    load = motors.share * (1.0 - motors.expo) * (q - 1.0)
    voltage = 2.0 * x**2 / (1.0 - motors.expo + curve) + load * x**2
    stiffness = 2.0 * x / curve + 2.0 * load * x
    by_voltage = 2.0 * c * x / stiffness
    # The slope of the firmware's curve where it gives this output.
    command = np.linspace(0.0, 1.0, _N_CURVE)
    output = np.maximum.accumulate(law.output(command))
    by_command = np.interp(voltage / (full * behind), output, np.gradient(output, command))
    return _At(
        slope=by_voltage * full * behind * before * by_command,
        damping=condition.density * D**3 * x,
        lag=J / stiffness,
        lead=J / (q * x),
    )


def factors(point: FlownPoint, condition: Condition, n_plants: int, *, by_drag: bool = False) -> Factors:
    """Return by what a condition multiplies the numbers of vehicles.

    Parameters
    ----------
    point : FlownPoint
    condition : Condition
    n_plants : int
    by_drag : bool
        The torque is the drag of the rotors, which goes with one more power of their diameter than thrust.

    Returns
    -------
    Factors
        Of the estimate, then of vehicles that differ in what the log does not tell of their motors.
    """
    return _factors(point, _motors(point, n_plants), condition, by_drag=by_drag)


def _factors(point: FlownPoint, motors: _Motors, condition: Condition, *, by_drag: bool) -> Factors:
    flown = _at(point, motors, Condition(condition.kind))
    other = _at(point, motors, condition)
    arm = condition.propeller if by_drag else 1.0
    return Factors(
        effectiveness=arm * other.slope / flown.slope / condition.inertia,
        damping=(other.damping / flown.damping) ** motors.share / condition.inertia,
        lag=(other.lag / flown.lag) ** motors.share,
        lead=other.lead / flown.lead,
    )


def changed(plants: Plant, by: Factors) -> Plant:
    """Return vehicles with other numbers; the frame's modes stay where they are."""
    return plants._replace(
        effectiveness=plants.effectiveness * by.effectiveness,
        damping=plants.damping * by.damping,
        lag_s=plants.lag_s * by.lag,
        lead_s=plants.lead_s * by.lead,
    )


class OffNominal(NamedTuple):
    """The conditions of one axis, with what each makes of the vehicles that its flight allows.

    ``by_drag``: the rotors turn this axis by their drag, not by their thrust.
    """

    point: FlownPoint
    conditions: tuple[Condition, ...]
    by_drag: bool = False

    def corners(self, loops: ScaledLoops) -> tuple[ScaledLoops, ...]:
        """Return the loops in the conditions between which all others lie.

        Returns
        -------
        tuple of ScaledLoops
            With the most and the least effectiveness, and with the longest lag, of the estimate.
        """
        loops = loops.first(N_PLANTS)
        each = self._each(loops)
        if not each:
            return ()
        gains = [float(one.effectiveness[0]) for one in each]
        lags = [float(one.lag[0]) for one in each]
        numbers = dict.fromkeys((int(np.argmax(gains)), int(np.argmin(gains)), int(np.argmax(lags))))
        return tuple(loops.around(changed(loops.plants, each[number]) for number in numbers))

    def _each(self, loops: ScaledLoops) -> list[Factors]:
        # The same vehicles in all conditions.
        motors = _motors(self.point, loops.plants.effectiveness.size)
        return [_factors(self.point, motors, one, by_drag=self.by_drag) for one in self.conditions]

    def margins(
        self, loops: ScaledLoops, following: AxisController | None, limits: Limits
    ) -> tuple[ConditionMargins, ...]:
        """Return the margins in each condition.

        Parameters
        ----------
        loops : ScaledLoops
            With the flown gains.
        following : AxisController or None
            With the next gains, None where there are none.
        limits : Limits

        Returns
        -------
        tuple of ConditionMargins
            That with the least spare is marked.
        """
        loops = loops.first(N_PLANTS)
        told, each = [], self._each(loops)
        around = loops.around(changed(loops.plants, by) for by in each)
        for condition, by, one in zip(self.conditions, each, around, strict=True):
            now = one.margins()
            then = None if following is None else one.of(following).margins()
            told.append(
                ConditionMargins(
                    condition=condition,
                    effectiveness=_estimated(by.effectiveness),
                    lag=_estimated(by.lag),
                    now=now,
                    next=then,
                    spare=spare(now if then is None else then, limits),
                )
            )
        least = min((one.spare for one in told), default=np.inf)
        return tuple(replace(one, worst=one.spare == least) for one in told)


def _estimated(values: FloatArray) -> Estimated:
    low, high = np.quantile(values, ENDS_95)
    return Estimated(float(values[0]), (float(low), float(high)))
