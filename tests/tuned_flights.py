"""Short simulated flights to tune from, logged at the loop's rate, so that the controller replays."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from quadid_logs.align import cut
from quadid_logs.autopilots import named
from quadid_logs.control import closed_loop
from quadid_logs.control.scaled_loop import scaled_loops
from quadid_logs.data.controller import Replay
from quadid_logs.data.log import FlightLog
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.load import prepare
from quadid_logs.pipeline import _closed_loop, judge
from quadid_logs.simulator import SCENARIOS, fly, plan_flights
from quadid_logs.simulator.closed_loop import Record
from quadid_logs.simulator.logger import log_flights
from tests.kept import SHELVES

#: Just fast enough for a loop of its own at that rate.
RATE_HZ = 270.0


SCENARIO = SCENARIOS["sysid-quad-x"]


@cache
def recorded(autopilot: str) -> tuple[Record, ...]:
    """Return a flight of 20 s."""
    setups = plan_flights(SCENARIO, seed=1, duration_s=20.0, rate_hz=RATE_HZ, autopilot=autopilot)
    return tuple(fly(one) for one in setups)


@cache
def flown(autopilot: str) -> Result:
    """Return what an analysis finds in a flight of 20 s of a frame that is known to be stiff."""
    return stiff(flown_with_frame(autopilot))


@cache
def flown_with_frame(autopilot: str) -> Result:
    """Return what an analysis finds in a flight of 20 s, made once for all test processes."""
    return SHELVES["tuned"].get(autopilot.encode(), lambda: _analyzed(autopilot))


def _analyzed(autopilot: str) -> Result:
    log = log_flights(recorded(autopilot), replace(SCENARIO.logging, rate_hz=RATE_HZ))
    prepared = prepare(log)
    settings = Settings()
    return judge(
        prepared.log, cut(prepared, settings.align), settings, vehicle=None, published=False, timings_s={}
    )


def stiff(result: Result) -> Result:
    """Return the result as if the frame could not bend: what may bend takes three times as many frequencies.

    And a search without the modes that are merely possible, beside that with them.
    """
    loop = result.closed_loop
    if loop is None:
        return result
    axes = {
        axis: replace(one, frame=None, plants=None if one.plants is None else one.plants._replace(modes=None))
        for axis, one in loop.axes.items()
    }
    return replace(result, closed_loop=replace(loop, axes=axes))


def of_axes(result: Result, *axes: str) -> Result:
    """Return the result as if the loops of these axes alone were known: others take no search for gains."""
    loop = result.closed_loop
    assert loop is not None
    return replace(result, closed_loop=replace(loop, axes={axis: loop.axes[axis] for axis in axes}))


def with_log(result: Result, log: FlightLog) -> Result:
    """Return the result as if that log had been read, of a stiff frame: its model is kept.

    The loops of the axes that have one are closed anew. What bends is not looked for: it would be left out.
    """
    assert result.closed_loop is not None
    verdicts = {axis: one for axis, one in result.diagnosis.axes.items() if axis in result.closed_loop.axes}
    diagnosis = replace(result.diagnosis, axes=verdicts)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(closed_loop, "frame_modes", lambda *_, **__: None)
        loop = _closed_loop(log, result.data, result.identification, diagnosis, result.settings)
    if loop is not None:
        loop = replace(loop, axes={axis: one for axis, one in loop.axes.items() if axis in verdicts})
    return stiff(replace(result, log=log, closed_loop=loop))


def with_parameters(result: Result, **values: float | None) -> Result:
    """Return the result of a log with other parameters; None takes one away."""
    parameters = {**result.log.parameters, **values}
    kept = {name: value for name, value in parameters.items() if value is not None}
    return with_log(result, replace(result.log, parameters=kept))


def as_flown(result: Result, **values: float) -> Result:
    """Return the result of the same vehicle with other parameters, which replay as if they had flown."""
    parameters = {**result.log.parameters, **values}
    controllers = named(result.log.autopilot).controllers(result.log, parameters)
    assert controllers is not None
    assert result.closed_loop is not None
    axes = {
        axis: replace(
            one,
            margins=scaled_loops(controllers.axes[axis], one.plants, one.known_hz).margins(),
            replay=Replay(relative_rms={}, agrees=True),
        )
        for axis, one in result.closed_loop.axes.items()
        if one.plants is not None
    }
    loop = replace(result.closed_loop, controllers=controllers, axes=axes)
    return replace(result, log=replace(result.log, parameters=parameters), closed_loop=loop)
