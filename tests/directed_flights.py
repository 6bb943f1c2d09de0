"""Flights of a vehicle that is known, with gains of which the right direction is known with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from quadid_logs.autopilots import named
from quadid_logs.control.closed_loop import vehicles
from quadid_logs.control.command_units import per_command
from quadid_logs.control.findings import find_in_loop
from quadid_logs.control.scaled_loop import scaled_loops
from quadid_logs.data.closed_loop import AxisLoop, ClosedLoop, LoopMargins, Plant
from quadid_logs.data.controller import Replay
from quadid_logs.data.diagnosis import AxisVerdict, Diagnosis
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import AxisTuning, Tuning
from quadid_logs.diagnose import with_findings
from quadid_logs.report.tune_view import TuneAxisView, tune_view
from quadid_logs.simulator.true_loop import true_plant
from quadid_logs.simulator.truth import flight_truth
from quadid_logs.tuning import tuning_of
from quadid_logs.vocabulary import AXES
from tests.tuned_flights import flown, recorded

AUTOPILOTS = ("ardupilot", "px4", "betaflight")
#: Of the flown gains: far too high, low, and too low for the angle loop around them. Gains that are only just
#: too high are shaped anew; Betaflight's rate loop, which has no angle loop, bears more.
FACTORS = dict.fromkeys(AUTOPILOTS, (7.0, 1.0, 0.4)) | {"betaflight": (10.0, 1.0, 0.4)}
#: Gains that are low for the simulated vehicle.
SETTINGS = {
    "looptime": 125.0, "pid_process_denom": 2.0, "gyro_lpf1_static_hz": 100.0, "dterm_lpf1_static_hz": 75.0,
    "p_roll": 80.0, "i_roll": 30.0, "d_roll": 100.0,
    "p_pitch": 80.0, "i_pitch": 30.0, "d_pitch": 100.0,
    "p_yaw": 250.0, "i_yaw": 20.0, "d_yaw": 0.0,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One axis of a flight, and what is recommended for it."""

    autopilot: str
    axis: str
    result: Result
    tuning: Tuning
    view: TuneAxisView

    @property
    def found(self) -> AxisTuning:
        return self.tuning.axes[self.axis]

    @property
    def name(self) -> str:
        return f"{self.autopilot} {self.axis}: {self.found.direction}"

    @property
    def true_now(self) -> LoopMargins:
        """The margins that the simulated vehicle has as it flew."""
        return self.true_with({})

    @property
    def true_next(self) -> LoopMargins:
        """Those that it will have with the gains of the file."""
        return self.true_with({name: one.next for name, one in self.found.changes.items()})

    def true_with(self, changes: Mapping[str, float]) -> LoopMargins:
        """The margins that the simulated vehicle has with some parameters changed."""
        log = self.result.log
        controllers = named(log.autopilot).controllers(log, {**log.parameters, **changes})
        assert controllers is not None
        controller = controllers.axes[self.axis]
        plant = vehicle(self.autopilot, AXES.index(self.axis), controller.period_s)
        return scaled_loops(controller, plant, 1e9).margins()


def flyer(autopilot: str) -> str:
    """Return the autopilot that the simulator flew: it has no Betaflight."""
    return "ardupilot" if autopilot == "betaflight" else autopilot


def vehicle(autopilot: str, axis: int, hold_s: float) -> Plant:
    """Return the true vehicle, as late as it was with the loop that flew it."""
    record = recorded(flyer(autopilot))[0]
    truth = flight_truth((record,), scenario="", boot_s=0.0)
    setup = record.setup
    plant = true_plant(setup, truth, axis)
    return plant._replace(delay_s=plant.delay_s + 0.5 * (1.0 / setup.loop_hz - hold_s))


@cache
def as_logged(autopilot: str) -> Result:
    """Return the analysis of a flight; Betaflight's is that of the same vehicle under other settings."""
    result = flown(flyer(autopilot))
    if result.log.autopilot == autopilot:
        return result
    log = replace(
        result.log,
        autopilot=autopilot,
        firmware="Betaflight v4.5.1",
        parameters=SETTINGS,
        parameter_changes=(),
        controller_terms=(),
        modes=(),
    )
    return replace(result, log=log)


def with_gains(
    autopilot: str,
    factors: Mapping[str, float],
    *,
    integral: float = 1.0,
    values: Mapping[str, float] | None = None,
    axes: Sequence[str] = AXES,
    **loop: object,
) -> Result:
    """Return the flight of the same vehicle with other gains, which replay as if they had flown.

    ``factors`` are on all gains of an axis, ``integral`` is on I beside the others; ``values`` stand instead.
    The loop is known of some ``axes`` only, and the frame is stiff.
    """
    now = as_logged(autopilot)
    model, tunable = now.identification.recommended, named(autopilot).tunable(now.log.parameters)
    assert model is not None
    assert tunable is not None
    parameters = dict(now.log.parameters)
    for axis, factor in factors.items():
        names = tunable.axes[axis]
        parameters |= {name: names.written(factor * parameters[name]) for name in names.scaled}
        parameters[names.integral] *= integral
    parameters |= values or {}
    log = replace(now.log, parameters=parameters)
    controllers = named(autopilot).controllers(log, parameters)
    assert controllers is not None
    closed_axes, per_unit = {}, per_command(now.data, model)
    for axis in axes:
        controller = controllers.axes[axis]
        known = vehicles(*per_unit, AXES.index(axis), controller, frames=False)
        assert known is not None
        known_hz = known.supported.known_hz
        margins = scaled_loops(controller, known.plants, known_hz).margins()
        replayed = Replay(relative_rms={}, agrees=True)
        fields = {"margins": margins, "replay": replayed, "known_hz": known_hz, **loop}
        closed_axes[axis] = AxisLoop(plants=known.plants, **fields)  # type: ignore[arg-type]
    closed = ClosedLoop(controllers=controllers, axes=closed_axes)
    usable = AxisVerdict(verdict="usable", reasons=(), sentence="")
    before = Diagnosis(findings=(), axes=dict.fromkeys(AXES, usable))
    diagnosis = with_findings(before, find_in_loop(closed), autopilot)
    return replace(now, log=log, closed_loop=closed, diagnosis=diagnosis)


def cases_of(autopilot: str, result: Result, tuning: Tuning) -> list[Case]:
    """Return the axes of one flight."""
    views = tune_view(result, tuning).axes
    return [Case(autopilot=autopilot, axis=one.axis, result=result, tuning=tuning, view=one) for one in views]


#: How the gains of a flight stand: far too high, low and too low, on one axis each, the high ones on the axis
#: that is named; where the first of these flights is sent, all axes or that one alone; of a contradicted
#: model; with too much I on roll.
GAINS = (*AXES, "at target", "one at target", "contradicted", "uneven")
#: Of these only one axis is known.
OF_ONE_AXIS = ("one at target", "uneven")
#: Of these in a quick run: one far too high of each autopilot, and all kinds of one.
QUICK = {
    "ardupilot": ("pitch", "one at target", "contradicted", "uneven"),
    "px4": ("yaw",),
    "betaflight": ("roll",),
}


@cache
def walked(autopilot: str, gains: str) -> tuple[Case, ...]:
    """Return the axes of a flight whose gains stand so: to be lowered, raised, kept or refused."""
    if gains == "uneven":
        result = with_gains(autopilot, {"roll": 1.0}, integral=5.0, axes=("roll",))
        return tuple(cases_of(autopilot, result, tuning_of(result))[:1])
    if gains in ("at target", "one at target"):
        axis = QUICK[autopilot][0]
        first = walked(autopilot, axis)
        targets = {name: one.target for each in first for name, one in each.found.gains.items()}
        if gains == "one at target":
            result = with_gains(autopilot, {}, values=targets, axes=(axis,))
            return tuple(one for one in cases_of(autopilot, result, tuning_of(result)) if one.axis == axis)
        result = with_gains(autopilot, {}, values=targets)
    elif gains == "contradicted":
        result = with_gains(autopilot, {}, contradicted=True)
    else:
        high = AXES.index(gains)
        factors = {AXES[(high + place) % 3]: factor for place, factor in enumerate(FACTORS[autopilot])}
        result = with_gains(autopilot, factors)
    return tuple(cases_of(autopilot, result, tuning_of(result)))
