"""A pilot who flies what the live figures ask for: `python -m study.live_pilot`.

The pilot looks at the screen every few seconds and flies doublets on the axis that is named there.
Vehicles are the coverage study's, without structural effects.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.containers.tail import LogTail
from quadid_logs.live import LiveEstimate, LiveFigures
from quadid_logs.simulator import Setup, fly, plan_flights
from quadid_logs.simulator.effects import Effects
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.manoeuvres import Reference, hover
from quadid_logs.simulator.truth import flight_truth
from quadid_logs.vocabulary import AXES
from quadid_logs.writers import write_log
from study.draw import draw_flight

#: The pilot looks at the screen that often, and takes that long to follow it [s].
_LOOK_S: Final = 4.0
_REACTION_S: Final = 1.0
#: Roll, pitch, yaw: rate of a doublet [rad/s], and length of its pulse [s]; a pilot repeats neither exactly.
_RATE_RAD_S: Final = (1.2, 1.2, 0.6)
_PULSE_S: Final = (0.25, 0.25, 0.5)
_UNSTEADY: Final = 0.2
#: The longest that is flown [s].
FLIGHT_S: Final = 60.0
_SUFFIX: Final = {"ardupilot": ".bin", "px4": ".ulg"}


def _doublets(
    reference: Reference, loop_hz: float, begin_s: float, axis: int, rng: np.random.Generator
) -> None:
    """Command doublets on an axis from a time on, a rest of three pulses between them."""
    rate: FloatArray = reference.rate_rad_s
    rate[round(begin_s * loop_hz) :] = 0.0
    at_s = begin_s
    while at_s < rate.shape[0] / loop_hz:
        level, pulse_s = (
            value * (1.0 + _UNSTEADY * rng.uniform(-1.0, 1.0))
            for value in (_RATE_RAD_S[axis], _PULSE_S[axis])
        )
        edges = [round((at_s + k * pulse_s) * loop_hz) for k in range(3)]
        rate[edges[0] : edges[1], axis] = level
        rate[edges[1] : edges[2], axis] = -level
        at_s += 5.0 * pulse_s


def fly_by_hints(seed: int, number: int, target: float = 0.05) -> dict[str, Any]:
    """Fly one vehicle as the live figures ask, until they say that it is enough.

    Parameters
    ----------
    seed, number : int
        Of the vehicle, as in the coverage study.
    target : float
        Relative half width of the 95 % interval that is wanted.

    Returns
    -------
    dict
        ``enough_s`` from take-off, None where it was not enough in time; by axis the last relative
        half width, and by how much the effectiveness is off; ``update_s``: the longest update [s].
    """
    drawn = draw_flight(seed, number)
    scenario = dataclasses.replace(drawn.scenario, effects=Effects(), manoeuvre=hover)
    rate_hz = 250.0
    (setup,) = plan_flights(
        scenario, seed=seed + number, duration_s=FLIGHT_S + 10.0, rate_hz=rate_hz, autopilot=drawn.autopilot
    )
    logging = dataclasses.replace(scenario.logging, rate_hz=rate_hz)
    rng = np.random.default_rng([seed, number, *b"live pilot"])
    begin_s = setup.schedule.manoeuvre_s
    looks = np.arange(begin_s + 0.5 * _LOOK_S, setup.schedule.take_off_s + FLIGHT_S, _LOOK_S)
    axis: str | None = None
    flown: list[str] = []
    screen = _Screen(setup, logging, target)
    for look_s in looks:
        figures = screen.at(float(look_s))
        if figures.is_enough:
            break
        wanted = figures.next_axis
        name = wanted.axis if wanted is not None and not figures.missing else None
        if name is not None and name != axis:
            axis = name
            flown.append(name)
            start_s = float(look_s) + _REACTION_S - begin_s
            _doublets(setup.reference, setup.loop_hz, start_s, AXES.index(name), rng)
            screen = _Screen(setup, logging, target)
    truth = np.diag(np.array(screen.truth["models"]["damped"]["B"]))
    if figures.unit == "N m":
        truth = truth / np.diag(np.array(screen.truth["torque_n_m_per_command"]))
    return {
        "number": number,
        "autopilot": drawn.autopilot,
        "frame": drawn.settings["frame"],
        "wind_m_s": drawn.settings["wind_m_s"],
        "enough_s": float(look_s) - setup.schedule.take_off_s if figures.is_enough else None,
        "flown": flown,
        "half_width": {one.axis: one.half_width for one in figures.axes},
        "error": {
            one.axis: float(one.effectiveness / b - 1.0) for one, b in zip(figures.axes, truth, strict=True)
        },
        "update_s": screen.update_s,
    }


class _Screen:
    """What the pilot sees of a flight, second by second."""

    def __init__(self, setup: Setup, logging: Logging, target: float) -> None:
        records = (fly(setup),)
        self.truth = flight_truth(records, scenario="live", boot_s=logging.boot_s)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "flight").with_suffix(_SUFFIX[setup.autopilot])
            write_log(log_flights(records, logging), path)
            self._content = path.read_bytes()
        self._boot_s = logging.boot_s
        self._live, self._clock, self._n_read = LiveEstimate(target), LogTail(1.0), 0
        self.update_s = 0.0

    def at(self, look_s: float) -> LiveFigures:
        """Return the figures at a time from the first control period [s]."""
        second_s = min(look_s, 1.0)
        while self._n_read < len(self._content) and not self._now_s() >= look_s:
            second_s = min(second_s + 1.0, look_s)
            begin_s = time.process_time()
            self._read(second_s)
            figures = self._live.figures()
            self.update_s = max(self.update_s, time.process_time() - begin_s)
        return figures

    def _now_s(self) -> float:
        return self._clock.end_s - self._boot_s

    def _read(self, second_s: float) -> None:
        """Take what came until a second of the flight."""
        while self._n_read < len(self._content) and not self._now_s() >= second_s:
            part = self._content[self._n_read : self._n_read + 8192]
            self._n_read += len(part)
            self._clock.append(part)
            self._live.append(part)


def main(arguments: list[str]) -> None:
    """Fly some vehicles and print how it went.

    Parameters
    ----------
    arguments : list of str
        Of the command line.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=20)
    parser.add_argument("--seed", type=int, default=20261124)
    options = parser.parse_args(arguments)
    enough = []
    for number in range(options.vehicles):
        row = fly_by_hints(options.seed, number)
        enough.append(row["enough_s"] is not None)
        print(json.dumps(row), flush=True)
    print(f"{sum(enough)} of {len(enough)} vehicles reach +-5 % on all axes in {FLIGHT_S:g} s")


if __name__ == "__main__":
    main(sys.argv[1:])
