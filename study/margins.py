"""Fly one drawn flight, close its loops, and hold every margin against that of the simulator's own loop."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from quadid_logs.align import cut
from quadid_logs.control.loop import close, integrators
from quadid_logs.control.margins import LoopFigures, figures_of, grid_hz
from quadid_logs.data.closed_loop import AxisLoop, Margins
from quadid_logs.data.settings import Settings
from quadid_logs.load import prepare
from quadid_logs.pipeline import judge
from quadid_logs.simulator.closed_loop import Setup, Tuning
from quadid_logs.simulator.effects import Effects
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.vocabulary import AXES
from study.draw import Drawn, draw_flight
from study.measure import setup_of, simulate_drawn
from study.structural import log_uniform

#: The figures that are held against the truth: of `Margins`, with the truth's name in `LoopFigures` and its
#: unit there in units of the first.
FIGURES: Final = {
    "phase_margin_deg": ("phase_margin_rad", np.degrees),
    "gain_margin_db": ("gain_margin", lambda factor: 20.0 * np.log10(factor)),
    "crossover_hz": ("crossover_hz", float),
    "delay_margin_s": ("delay_margin_s", float),
    "disk_margin": ("disk_margin", float),
}
#: Enough for held-out blocks; many flights tell more than long ones.
_DURATIONS_S: Final = (22.0, 32.0)
#: The controller steps by the stamps that it logs: what they jitter by here is rounding.
_JITTER_S: Final = 5e-6
#: The simulator reads its gyro once in a loop, autopilots many times: up to such cut-offs their filters
#: differ by half a degree at most where margins end.
_GYRO_FILTERS_HZ: Final = (15.0, 30.0)
#: PX4's D depends on how often the gyro is read, which only a loop that waits for its gyro tells: one that
#: may run faster by this factor, and whose every step is logged.
_WAITS: Final = 1.5
_PX4_RATE_HZ: Final = 400.0


def draw_loop(seed: int, number: int) -> Drawn:
    """Draw a flight of the coverage study without structural effects, tuned well or badly.

    Parameters
    ----------
    seed, number : int
        Of the study and of the flight.

    Returns
    -------
    Drawn
        Gains from half to twice those that suit the vehicle, filters from 12 to 60 Hz; air as rough as in
        the other study.
    """
    drawn = draw_flight(seed, number)
    rng = np.random.default_rng([seed, number, *b"margins"])
    rough = drawn.scenario.effects.disturbance_rad_s2
    tuning = Tuning(
        gain=log_uniform(rng, 0.5, 2.0),
        target_hz=log_uniform(rng, 12.0, 60.0),
        derivative_hz=log_uniform(rng, 12.0, 60.0),
        error_hz=log_uniform(rng, 12.0, 60.0) if rng.random() < 0.25 else 0.0,
    )
    logging = dataclasses.replace(drawn.scenario.logging, jitter_s=_JITTER_S)
    if drawn.autopilot == "px4":
        logging = dataclasses.replace(logging, rate_hz=_PX4_RATE_HZ)
    scenario = dataclasses.replace(
        drawn.scenario,
        duration_s=rng.uniform(*_DURATIONS_S),
        effects=Effects(disturbance_rad_s2=rough),
        gyro_filter_hz=log_uniform(rng, *_GYRO_FILTERS_HZ),
        logging=logging,
        tuning=tuning,
    )
    settings = drawn.settings | {
        "duration_s": scenario.duration_s,
        "gyro_filter_hz": scenario.gyro_filter_hz,
        "rate_hz": logging.rate_hz,
        "jitter_s": _JITTER_S,
        "structural": "",
        "gain": tuning.gain,
        "derivative_hz": tuning.derivative_hz,
    }
    return dataclasses.replace(drawn, settings=settings, scenario=scenario, clipped_fraction=0.0)


def measure_loops(drawn: Drawn) -> dict[str, Any]:
    """Return the margins of one flight's loops beside the true ones, ready for JSON.

    Parameters
    ----------
    drawn : Drawn

    Returns
    -------
    dict
        The flight's settings; in ``loops`` one entry for each axis and loop that the simulator has.
    """
    log, truth = simulate_drawn(drawn)
    setup = setup_of(drawn)
    if drawn.autopilot == "px4":
        waits = {"IMU_GYRO_RATEMAX": _WAITS * setup.loop_hz}
        log = dataclasses.replace(log, parameters=log.parameters | waits)
    prepared = prepare(log)
    settings = Settings()
    result = judge(prepared.log, cut(prepared, settings.align), settings, vehicle=None, timings_s={})
    found = {} if result.closed_loop is None else result.closed_loop.axes
    loops = []
    for number, axis in enumerate(AXES):
        one = found.get(axis, AxisLoop())
        shared = {
            "axis": axis,
            "verdict": result.diagnosis.axes[axis].verdict,
            "contradicted": one.contradicted,
            "known_hz": one.known_hz,
            "replay": "" if one.replay is None or one.replay.reason is None else one.replay.reason.value,
        }
        margins = {} if one.margins is None else {"rate": one.margins.rate, "full": one.margins.full}
        loops += [
            {**shared, "loop": loop, **_beside(margins.get(loop), true)}
            for loop, true in _true_figures(setup, truth, number)
        ]
    return {**drawn.settings, "seed": drawn.seed, "loops": loops}


def _true_figures(setup: Setup, truth: dict[str, Any], axis: int) -> Iterator[tuple[str, LoopFigures]]:
    """Yield the name and the figures of each loop of one axis."""
    controller, frequency_hz = true_controller(setup, axis), grid_hz(1.0 / setup.loop_hz)
    loop, n = close(controller, true_plant(setup, truth, axis), frequency_hz), integrators(controller)
    stable_alone = np.array([False])
    yield "rate", figures_of(frequency_hz, loop.rate, n, stable_alone)
    if loop.full is not None:
        yield "full", figures_of(frequency_hz, loop.full, n + 1, stable_alone)


def _beside(margins: Margins | None, true: LoopFigures) -> dict[str, Any]:
    """Put what was found beside the truth; what a loop does not have is None."""
    told: dict[str, Any] = {"true_stable": bool(true.stable[0])}
    if margins is not None:
        told |= {"stable": margins.stable, "extrapolated": margins.extrapolated}
    for name, (of_truth, in_unit) in FIGURES.items():
        value = float(in_unit(getattr(true, of_truth)[0]))
        estimate = None if margins is None else getattr(margins, name)
        told[name] = {
            "truth": value if np.isfinite(value) else None,
            "value": None if estimate is None else estimate.value,
            "low": None if estimate is None else estimate.ci95[0],
            "high": None if estimate is None else estimate.ci95[1],
        }
    return told
