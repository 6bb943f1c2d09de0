"""Lines of the gyro's spectrum, what they are called, and what filters cost: `python study/lines.py`.

Flights with rotors that shake the gyro and a part of the frame that rings, behind the filters that the
autopilots ship with, on all three in turn: is each line within half a hertz of a true one, and rightly named?
Then flights of the study of margins: the degrees that each filter is told to cost the rate loop, against the
loop that the simulator ran. Last, logs of firmware that hold the gyro before and behind its filters.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from quadid_logs.align import Prepared, cut
from quadid_logs.arrays import FloatArray
from quadid_logs.control.filters import filter_costs, rate_crossover
from quadid_logs.control.loop import on_rate
from quadid_logs.data.controller import AxisController
from quadid_logs.data.health import Health, LineSource
from quadid_logs.data.settings import AlignSettings, Settings
from quadid_logs.health import health_of
from quadid_logs.health.records import Record
from quadid_logs.health.spectra import periodograms
from quadid_logs.load import prepare
from quadid_logs.pipeline import judge
from quadid_logs.simulate import fly, plan_flights
from quadid_logs.simulate.closed_loop import Noise, Setup
from quadid_logs.simulate.closed_loop import Record as Flown
from quadid_logs.simulate.logger import Logging, log_flights
from quadid_logs.simulate.scenarios import SCENARIOS
from quadid_logs.simulate.true_loop import true_controller, true_plant
from quadid_logs.simulate.wind import Wind
from quadid_logs.vocabulary import AXES
from study.faults import AUTOPILOTS, CLEAN, ROUGH
from study.margins import draw_loop
from study.measure import setup_of, simulate_drawn
from study.structural import log_uniform

#: A line is found where a true one lies within this [Hz].
_NEAR_HZ: Final = 0.5
_RATE_HZ: Final = 400.0
#: A rotor's line lies where it turned for most of the flight [%].
_TURNED: Final = (5.0, 95.0)
#: Lines that are closer than this are one line: what a window of 4 s resolves, and what a rotor's moves.
_APART: Final = 0.1
"""As a part of the frequency."""
_FRAME_HZ: Final = (30.0, 170.0)
#: What a name may be: of a rotor by its speed where that is logged, by the throttle where it is not; what is
#: left unnamed is not named wrongly.
_RIGHT: Final = {
    "rotor": ("ROTOR", "FOLLOWS_THROTTLE"),
    "frame": ("FIXED", "UNKNOWN"),
}


def shaken(seed: int) -> tuple[Setup, str]:
    """Plan a flight of a vehicle that shakes."""
    rng = np.random.default_rng([seed, *b"lines"])
    name, wind = CLEAN[seed // len(AUTOPILOTS) % len(CLEAN)]
    plain = SCENARIOS[name]
    rotor_hz = _hover_hz(plain.airframe())
    frame_hz = rng.uniform(*_FRAME_HZ)
    while any(abs(frame_hz / (n * rotor_hz) - 1.0) < _APART for n in (1, 2)):
        frame_hz = rng.uniform(*_FRAME_HZ)
    noise = Noise(
        gyro_rad_s_per_rthz=1.0e-4 * log_uniform(rng, 1.0, 5.0),
        rotor_line_rad_s=log_uniform(rng, 0.02, 0.1),
        frame_line_rad_s=log_uniform(rng, 0.02, 0.1),
        frame_line_hz=frame_hz,
    )
    scenario = dataclasses.replace(
        plain,
        noise=noise,
        wind=Wind(speed_m_s=wind),
        effects=dataclasses.replace(plain.effects, disturbance_rad_s2=ROUGH),
    )
    (setup, *_) = plan_flights(
        scenario, seed=seed, duration_s=40.0, rate_hz=_RATE_HZ, autopilot=AUTOPILOTS[seed % len(AUTOPILOTS)]
    )
    return setup, name


def _hover_hz(airframe: Any) -> float:
    return float(airframe.rotor_speed_max_rad_s * np.sqrt(airframe.hover_throttle) / (2.0 * np.pi))


def measure_lines(seed: int) -> dict[str, Any]:
    """Fly once and return every line that was found, beside the true ones.

    Parameters
    ----------
    seed : int

    Returns
    -------
    dict
        Ready for JSON.
    """
    setup, name = shaken(seed)
    flown = fly(setup)
    prepared = prepare(log_flights((flown,), Logging(rate_hz=_RATE_HZ)))
    health = health_of(prepared, cut(prepared, AlignSettings()))
    speeds_hz = _speeds_hz(flown, prepared)
    return {
        "seed": seed, "autopilot": setup.autopilot, "flight": name, "frame_hz": setup.noise.frame_line_hz,
        "rotors_hz": np.percentile(speeds_hz, _TURNED, axis=0).T.tolist(), "lines": list(_lines(health)),
    }  # fmt: skip


def _lines(health: Health) -> Iterator[dict[str, Any]]:
    for axis, found in ({} if health.noise is None else health.noise.lines).items():
        for one in found:
            yield {
                "axis": axis, "hz": one.frequency_hz, "db": one.height_db, "source": one.source.name,
                "harmonic": one.harmonic,
            }  # fmt: skip


def _speeds_hz(flown: Flown, prepared: Prepared) -> FloatArray:
    """Return what the rotors turned at in flight, shape (n_samples, n_rotors)."""
    speeds_hz = flown.channels["rotor_speed"] / (2.0 * np.pi)
    return np.asarray(speeds_hz[speeds_hz.min(axis=1) > 0.5 * np.median(speeds_hz)])


def judged(flight: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield of each line that was found whether it is a true one, how far off it stands, and its name.

    Parameters
    ----------
    flight : dict
        Of `measure_lines`.
    """
    for line in flight["lines"]:
        off_rotors = min(max(low - line["hz"], line["hz"] - high, 0.0) for low, high in flight["rotors_hz"])
        off_frame = abs(line["hz"] - flight["frame_hz"])
        of = "rotor" if off_rotors < off_frame else "frame"
        yield {**line, "of": of, "off_hz": min(off_rotors, off_frame), "right": line["source"] in _RIGHT[of]}
