"""The loop that the simulator really flew: what margins are held against."""

from __future__ import annotations

from typing import Any

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots.discrete import butterworth, derivative, first_order, gain, integrator, unit
from quadid_logs.data.closed_loop import Modes, Plant
from quadid_logs.data.controller import AxisController, DiscreteFilter
from quadid_logs.simulator.closed_loop import Setup, final_gains, setpoint_loops, torque_gain
from quadid_logs.simulator.effects import high_pass
from quadid_logs.vocabulary import AXES


def true_controller(setup: Setup, axis: int, rotors_hz: float | None = None) -> AxisController:
    """Return the controller that the simulator ran, made of the gains and weights that it flew with.

    Parameters
    ----------
    rotors_hz : float, optional
        Their speed, at which a notch stands that follows them; without it notches are left out.

    Returns
    -------
    AxisController
        The gyro is read, and filtered, once in each loop.
    """
    gains, tuning, period_s = final_gains(setup), setup.tuning, 1.0 / setup.loop_hz
    P, I, D = (float(each[axis]) for each in (gains.proportional, gains.integral, gains.derivative))  # noqa: E741
    slope = (derivative(period_s) * first_order(tuning.of_derivative_hz(axis), period_s)).scaled(D)
    ardupilot, betaflight = (setup.autopilot == name for name in ("ardupilot", "betaflight"))
    error = gain(P, period_s) + integrator(period_s, late=not (ardupilot or betaflight)).scaled(I)
    return AxisController(
        period_s=period_s,
        error=(error + slope) * first_order(tuning.error_hz, period_s) if ardupilot else error,
        target=first_order(tuning.target_hz, period_s) if ardupilot else unit(period_s),
        rate=None if ardupilot else slope,
        gyro=(
            *_flexible_mode(setup),
            *(() if rotors_hz is None else _notches(setup, rotors_hz)),
            butterworth(setup.gyro_filter_hz, period_s),
        ),
        # Betaflight holds no heading: its pilot does.
        angle_gain_per_s=None if betaflight and axis == AXES.index("yaw") else float(gains.attitude[axis]),
        angle_delay_steps=setpoint_loops(setup),
    )


def _flexible_mode(setup: Setup) -> tuple[DiscreteFilter, ...]:
    """Return what the gyro sees of the body's rate where a mode of the frame lies between them."""
    effects = setup.effects
    if not effects.flexible_mode_hz:
        return ()
    b0, b1, b2, a1, a2 = high_pass(effects.flexible_mode_hz, effects.flexible_mode_damping, setup.loop_hz)
    below = np.array([1.0, a1, a2])
    above = below - effects.flexible_mode_gain * np.array([b0, b1, b2])
    return (DiscreteFilter(above, below, 1.0 / setup.loop_hz),)


def _notches(setup: Setup, rotors_hz: float) -> tuple[DiscreteFilter, ...]:
    notch = setup.tuning.notch
    if notch is None:
        return ()
    found = []
    for harmonic in range(1, notch.n_harmonics + 1):
        b0, b1, b2, a1, a2 = (float(each) for each in notch.biquad(harmonic, rotors_hz, setup.loop_hz))
        found.append(DiscreteFilter(np.array([b0, b1, b2]), np.array([1.0, a1, a2]), 1.0 / setup.loop_hz))
    return tuple(found)


def true_plant(setup: Setup, truth: dict[str, Any], axis: int) -> Plant:
    """Return one axis of the simulated vehicle as its gyro shows it.

    Parameters
    ----------
    truth : dict
        As of `quadid_logs.simulator.truth.flight_truth`.
    """
    model = truth["models"]["damped"]
    seen = 1.0 + setup.noise.gyro_scale[axis]
    values = (
        model["B"][axis][axis] * seen,
        model["A"][axis][model["regressors"].index("pqr"[axis])],
        truth["actuator"]["lag_s"],
        setup.delay_steps / setup.loop_hz,
    )
    plant = Plant(*_each(values))
    # The controller holds the mode of the frame as it flew; one of no gain keeps the frequencies dense there.
    no_mode = Modes(*(np.array([value]) for value in (1.0, 1.0, 0.0)))
    lead_s = truth["actuator"]["yaw_lead_s"] if axis == AXES.index("yaw") else 0.0
    return plant._replace(lead_s=lead_s, modes=no_mode)


def nominal_plant(setup: Setup, axis: int) -> Plant:
    """Return one axis of the vehicle as it is built, at a full battery: what is known before any flight."""
    frame = setup.airframe
    gain = np.linalg.solve(frame.inertia_kg_m2, torque_gain(frame, setup.autopilot))[axis, axis]
    values = (
        gain,
        -frame.rate_damping_n_m_s[axis] / frame.inertia_kg_m2[axis, axis],
        0.5 * (frame.lag_up_s + frame.lag_down_s),
        setup.delay_steps / setup.loop_hz,
    )
    return Plant(*_each(values))


def _each(values: tuple[float, float, float, float]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return numbers of one vehicle as those of vehicles."""
    first, second, third, fourth = (np.array([value], dtype=np.float64) for value in values)
    return first, second, third, fourth
