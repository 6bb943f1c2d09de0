"""Close the loop of every axis: the controller that flew around the identified vehicle."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Final, Literal, NamedTuple

import numpy as np

from quadid_logs.control.command_units import per_command
from quadid_logs.control.conditioning import conditioned
from quadid_logs.control.flexible_mode import Measured, frame_modes
from quadid_logs.control.frequency_response import (
    Confirmation,
    Lines,
    Response,
    better,
    confirm,
    lines_of,
    response,
)
from quadid_logs.control.loop import Loop, close, integrators, rate_loop
from quadid_logs.control.margins import fine_grid_hz, grid_hz, margins_of, phase_margin, unmodelled
from quadid_logs.control.posterior import draw
from quadid_logs.control.prediction import AxisModel, Chirp, predict
from quadid_logs.control.step import step_of
from quadid_logs.data.closed_loop import (
    AxisLoop,
    ClosedLoop,
    Estimated,
    FrameModes,
    LoopCurve,
    LoopMargins,
    MeasuredLoop,
    Plant,
)
from quadid_logs.data.controller import AxisController, FlownControllers, Replay
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Model
from quadid_logs.maths.band import ComplexArray, delay_response
from quadid_logs.maths.normal import ENDS_95
from quadid_logs.vocabulary import AXES, ON_AXIS

#: What of a loop is wanted: everything, or what the verdicts rest on.
LoopPart = Literal["whole", "verdict"]
#: An excitation that enters at the mixer moves the torque as the loop lets it; one that enters elsewhere, in
#: other units, is off by more than this factor.
_AT_MIXER: Final = 2.0
#: Below this [Hz], and denser than every so many, curves are not drawn.
_LOWEST_DRAWN_HZ = 0.1
_EVERY = 3
#: The broken loop is only drawn: its bands may overlap, so that one reaches the end of a sweep.
_BROKEN_PER_OCTAVE: Final = 6


def close_loop(
    data: FlightData,
    model: Model,
    controllers: FlownControllers,
    replays: Mapping[str, Replay],
    *,
    trusted: Collection[str] = AXES,
    low_hz: float,
    wanted: LoopPart = "whole",
) -> ClosedLoop:
    """Close the loop of every axis whose controller and effectiveness are known.

    Parameters
    ----------
    data : FlightData
        What the model was fitted to.
    model : Model
        The recommended one.
    controllers : FlownControllers
    replays : mapping of str to Replay
        By axis. A controller that does not replay is not the one that flew: nothing is said of its loop.
    trusted : collection of str
        The axes whose model may be used: of others nothing is said.
    low_hz : float
        Lower edge of the fitted band.
    wanted : {"whole", "verdict"}
        Everything, or only what the verdicts rest on: the replay, and the prediction of the flight.
    """
    data, model = per_command(data, model)
    axes = {}
    for number, axis in enumerate(AXES):
        controller, replay = controllers.axes.get(axis), replays.get(axis)
        if controller is None:
            continue
        found = AxisLoop()
        if axis in trusted and not disagrees(replay) and model.entries[ON_AXIS[axis]].identifiable:
            found = _axis(data, model, number, controller, low_hz, wanted)
        axes[axis] = replace(found, replay=replay)
    return ClosedLoop(controllers=controllers, axes=axes)


def close_loop_of_earlier(
    data: FlightData,
    model: Model,
    number: int,
    controller: AxisController,
    plants: Plant,
    known_hz: float,
) -> AxisLoop:
    """Close the loop of an axis around the vehicles of earlier flights, held against what this one measured.

    Parameters
    ----------
    data : FlightData
        Its torques in units of the controller's command.
    model : Model
        Of this flight, per unit of the controller's command. Nothing of this axis is taken from it but up to
        where flights are fitted, and by which rotors its torque acts.
    number : int
        Of the axis.
    controller : AxisController
        That flew.
    plants : Plant
        The estimate of earlier flights, then vehicles drawn around it.
    known_hz : float
        Up to where earlier flights support them.

    Returns
    -------
    AxisLoop
        ``contradicted``, and without plants, where the response that this flight shows around the crossover
        is not that of those vehicles.
    """
    lines = lines_of(data, number, controller.angle_delay_steps * controller.period_s, model.actuator)
    estimate = plants.at(slice(0, 1))
    found = _compared(plants, estimate, lines, controller, known_hz)
    if found.supported.contradicted:
        return AxisLoop(contradicted=True)
    known_hz = found.supported.known_hz
    frame = frame_modes(
        data,
        number,
        controller,
        estimate,
        fitted_hz=model.smoothing_hz,
        known_hz=known_hz,
        n=plants.effectiveness.size - 1,
        measured=found.measured,
    )
    seen = found.seen
    return AxisLoop(
        step=step_of(controller, plants, None if seen is None else seen.closed),
        measured=None if seen is None else _measured(seen, controller, estimate),
        known_hz=known_hz,
        frame=frame,
        plants=plants,
        by_earlier=True,
    )


def disagrees(replay: Replay | None) -> bool:
    """Say whether the log contradicts the controller; one that the log cannot be held against it does not."""
    if replay is None or replay.agrees:
        return False
    return replay.reason is None or not replay.reason.tells_nothing


def _axis(
    data: FlightData,
    model: Model,
    number: int,
    controller: AxisController,
    low_hz: float,
    wanted: LoopPart,
) -> AxisLoop:
    """Close the loop of one axis; nothing where the model tells too little."""
    known = vehicles(data, model, number, controller, frames=wanted == "whole")
    if known is None:
        return AxisLoop()
    seen, lines, known_hz = known.seen, known.lines, known.supported.known_hz
    entry = model.entries[ON_AXIS[AXES[number]]]
    # By the model as it was fitted: what the fit never saw is to judge it.
    prediction, fit, posterior = None, model.fit, model.posterior
    if seen and lines and fit and posterior and controller.predictable:
        covariance = posterior.covariance[number, 1:, 1:]
        axis = AxisModel(number, controller, known.fitted, covariance, seen.chirp, model.actuator)
        prediction = predict(data, axis, fit, lines, low_hz)
    effectiveness = Estimated(entry.value, entry.ci95)
    if wanted == "verdict":
        return AxisLoop(prediction=prediction, effectiveness=effectiveness)
    margins, curve = loop_around(controller, known.plants, known_hz)
    return AxisLoop(
        prediction=prediction,
        margins=margins,
        step=step_of(controller, known.plants, None if seen is None else seen.closed),
        curve=curve,
        measured=None if seen is None else _measured(seen, controller, known.plants.at(slice(0, 1))),
        effectiveness=effectiveness,
        contradicted=known.supported.contradicted,
        known_hz=known_hz,
        frame=known.frame,
        plants=known.plants,
    )


def loop_around(controller: AxisController, plants: Plant, known_hz: float) -> tuple[LoopMargins, LoopCurve]:
    """Return the margins of a controller around vehicles, and their open loop to draw.

    Parameters
    ----------
    controller : AxisController
    plants : Plant
        The estimate, then vehicles drawn around it.
    known_hz : float
        Up to where measurement supports the model.
    """
    loop = close(controller, plants, fine_grid_hz(controller.period_s))
    n, runs_away = integrators(controller), plants.damping > 0.0
    full = loop.full
    margins = LoopMargins(
        rate=margins_of(loop.frequency_hz, loop.rate, n, runs_away, known_hz),
        full=None if full is None else margins_of(loop.frequency_hz, full, n + 1, runs_away, known_hz),
    )
    return margins, _curve(loop, known_hz)


def open_loop(controller: AxisController, plants: Plant, known_hz: float) -> LoopCurve:
    """Return the open loop of a controller around vehicles, to draw.

    Parameters
    ----------
    controller : AxisController
    plants : Plant
        The estimate, then vehicles drawn around it.
    known_hz : float
        Up to where measurement supports the model.
    """
    return _curve(close(controller, plants, fine_grid_hz(controller.period_s)), known_hz)


class Vehicles(NamedTuple):
    """The vehicles that a flight allows about one axis, and what of them was measured.

    ``plants`` are the estimate, then vehicles drawn around it; ``fitted`` is the estimate as it was fitted,
    without what was measured above the band. ``lines``, ``seen`` and ``measured`` are None without
    set-points in the log.
    """

    plants: Plant
    fitted: Plant
    lines: Lines | None
    seen: Seen | None
    measured: Measured | None
    supported: Confirmation
    frame: FrameModes | None = None


def vehicles(
    data: FlightData,
    model: Model,
    number: int,
    controller: AxisController,
    *,
    frames: bool = True,
) -> Vehicles | None:
    """Return the vehicles that the fit and the response above its band allow.

    Parameters
    ----------
    data : FlightData
        Its torques in units of the controller's command.
    model : Model
        Its posterior per unit of the controller's command: see `command_units.per_command`.
    number : int
        Of the axis.
    controller : AxisController
    frames : bool
        Whether modes of the frame are looked for.

    Returns
    -------
    Vehicles or None
        None where the model tells too little.
    """
    plants = None if model.posterior is None else draw(model.posterior, number, controller.period_s)
    if plants is None:
        return None
    lines = lines_of(data, number, controller.angle_delay_steps * controller.period_s, model.actuator)
    fitted = plants.at(slice(0, 1))
    found = _compared(plants, fitted, lines, controller, model.smoothing_hz)
    if found.seen is not None and not found.supported.contradicted:
        plants = conditioned(
            plants,
            found.seen.ratio.up_to(found.supported.known_hz),
            controller.period_s,
            model.smoothing_hz,
            crosses_above=_crossover_hz(plants, controller) > model.smoothing_hz,
        )
        found = _compared(plants, fitted, lines, controller, model.smoothing_hz)
    if not frames:
        return found
    frame = frame_modes(
        data,
        number,
        controller,
        plants.at(slice(0, 1)),
        fitted_hz=model.smoothing_hz,
        known_hz=found.supported.known_hz,
        n=plants.effectiveness.size - 1,
        measured=found.measured,
    )
    modes = None if frame is None else frame.modes
    return found._replace(plants=found.plants._replace(modes=modes), frame=frame)


def _compared(
    plants: Plant, fitted: Plant, lines: Lines | None, controller: AxisController, fitted_hz: float
) -> Vehicles:
    """Hold the estimate against what was measured."""
    supported, seen, measured = Confirmation(fitted_hz, contradicted=False), None, None
    if lines is not None:
        crossover_hz = _crossover_hz(plants, controller)
        seen = _seen(lines, controller, plants.at(slice(0, 1)))
        allowed = plants.response(seen.ratio.frequency_hz, controller.period_s)
        measured = Measured(seen.ratio, allowed[1:] / allowed[:1])
        if np.isfinite(crossover_hz):
            supported = confirm(seen.ratio, crossover_hz, fitted_hz, measured.drawn)
    return Vehicles(plants, fitted, lines, seen, measured, supported)


def _crossover_hz(plants: Plant, controller: AxisController) -> float:
    """Return where the rate loop of the estimate has its least phase to spare [Hz]; NaN for nowhere."""
    frequency_hz = grid_hz(controller.period_s)
    return float(
        phase_margin(frequency_hz, rate_loop(controller, plants.at(slice(0, 1)), frequency_hz))[0][0]
    )


class Seen(NamedTuple):
    """What the log shows of one axis, relative to what is modelled.

    The vehicle by set-points or excitation, the closed rate loop by set-points, and the broken loop where
    the excitation enters at the mixer.
    """

    ratio: Response
    closed: Response
    chirp: Chirp
    broken: Response | None


def _whole(loop: Loop) -> ComplexArray:
    """Return the open loop of the estimate with all that is known to close it."""
    whole = loop.rate if loop.full is None else loop.full
    return np.asarray(whole[0], dtype=np.complex128)


def _seen(lines: Lines, controller: AxisController, estimate: Plant) -> Seen:
    """Measure the vehicle by every instrument that the log has, and the broken loop where it can be."""
    loop = close(controller, estimate, lines.frequency_hz)
    vehicle = loop.target_to_rate[0] / loop.target_to_torque[0]
    # Of what is modelled nothing is left to change over a band: no average over it is biased.
    expected = lines.acting * vehicle
    ratio, broken = response(lines.frequency_hz, lines.setpoint, expected, lines.rate), None
    if lines.chirp is not None:
        # An excitation that is part of this axis' torque moves it as 1 / (1 + L) says.
        by_mixer = lines.chirp / (1.0 + _whole(loop))
        moved = response(lines.frequency_hz, lines.chirp, by_mixer, lines.torque).known().gain.real
        if moved.size and 1.0 / _AT_MIXER < float(np.median(moved)) < _AT_MIXER:
            ratio = better(ratio, response(lines.frequency_hz, lines.chirp, expected, lines.rate))
            broken = response(
                lines.frequency_hz,
                lines.chirp,
                lines.torque * _whole(loop),
                lines.chirp - lines.torque,
                per_octave=_BROKEN_PER_OCTAVE,
            )
    delay_s = controller.angle_delay_steps * controller.period_s
    late = delay_response(np.asarray(2j * np.pi * lines.frequency_hz, dtype=np.complex128), delay_s)
    answered = lines.setpoint * late * loop.target_to_rate[0]
    closed = response(lines.frequency_hz, lines.setpoint, answered, lines.rate).known()
    return Seen(ratio.known(), closed, Chirp(at_mixer=broken is not None, delay_s=delay_s), broken)


def _measured(seen: Seen, controller: AxisController, estimate: Plant) -> MeasuredLoop:
    """Return the open loop that the log shows, where it is known."""
    direct = seen.broken is not None
    known = seen.ratio if seen.broken is None else seen.broken.known()
    modelled = _whole(close(controller, estimate, known.frequency_hz))
    return MeasuredLoop(
        frequency_hz=known.frequency_hz, response=modelled * known.gain, error=known.error, direct=direct
    )


def _curve(closed: Loop, known_hz: float) -> LoopCurve:
    """Return the open loop with its band, wider by what nobody measured."""
    frequency_hz, loop = closed.frequency_hz, closed.rate if closed.full is None else closed.full
    drawn = np.flatnonzero(frequency_hz >= _LOWEST_DRAWN_HZ)[::_EVERY]
    gain = np.abs(loop[:, drawn])
    # Phases on one turn of the circle, that in which the estimate crosses over below zero.
    estimate = np.unwrap(np.angle(loop[0, drawn]))
    crossover = int(np.argmin(np.abs(np.log(gain[0]))))
    turn = 2.0 * np.pi * np.ceil(estimate[crossover] / (2.0 * np.pi))
    phase = estimate - turn + np.angle(loop[:, drawn] / loop[0, drawn])
    gain_low, gain_high = np.quantile(gain, ENDS_95, axis=0)
    phase_low, phase_high = np.quantile(phase, ENDS_95, axis=0)
    return LoopCurve(
        frequency_hz=frequency_hz[drawn],
        response=loop[0, drawn],
        gain_low=gain_low,
        gain_high=gain_high,
        phase_low=phase_low + np.unwrap(np.angle(unmodelled(frequency_hz[drawn], known_hz))),
        phase_high=phase_high,
    )
