"""The data sets: flights with a known truth, and flights of one vehicle repeated.

Each is the same aligned series for every method: body rates and torques on one clock, gap-free segments.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from quadid_logs.align import cut
from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import FlightLog
from quadid_logs.data.settings import Settings
from quadid_logs.errors import QuadidError
from quadid_logs.load import prepare, read_log
from quadid_logs.simulator import simulate
from quadid_logs.vocabulary import RATE_SYMBOLS

Kind = Literal["simulated", "firmware", "flown"]

#: (scenario, autopilot, rate [Hz]) of our own simulator.
SIMULATED: Final = (
    ("sysid-quad-x", "ardupilot", 400.0),
    ("sysid-quad-x", "px4", 250.0),
    ("doublets", "px4", 250.0),
    ("steps-3211", "ardupilot", 400.0),
    ("pilot-sticks", "ardupilot", 400.0),
    ("products-of-inertia", "ardupilot", 400.0),
    ("slow-motors", "ardupilot", 400.0),
    ("noisy-gyro", "ardupilot", 400.0),
    ("wind", "px4", 250.0),
    ("hexa-x", "ardupilot", 400.0),
    ("octa-coax", "ardupilot", 400.0),
    ("sysid-quad-x", "ardupilot", 100.0),
)
_SEED: Final = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Where a data set is from: a log, or a scenario of the simulator.

    ``vehicle`` names the flights that are of one vehicle in one state, "" where the truth is known.
    """

    name: str
    kind: Kind
    path: Path | None = None
    scenario: tuple[str, str, float] | None = None
    vehicle: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """B11, B22, B33 [rad/s^2 per unit of torque] and the damping about each axis [1/s], shape (3,) each."""

    effectiveness: FloatArray
    damping: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DataSet:
    """An aligned flight; its truth, None where it is not known."""

    source: Source
    log: FlightLog
    data: FlightData
    truth: Truth | None

    @property
    def n_samples(self) -> int:
        """Rows of all segments."""
        return sum(segment.n_samples for segment in self.data.segments)

    @property
    def rms(self) -> tuple[float, ...]:
        """Root mean square of p, q, r, L, M, N over all rows."""
        return tuple(float(value) for value in np.sqrt(np.mean(self.series()[:, 1:] ** 2, axis=0)))

    def series(self) -> FloatArray:
        """Return time [s], p, q, r [rad/s], L, M, N over all segments, shape (n_samples, 7)."""
        return np.concatenate(
            [np.column_stack([each.time_s, each.body_rate_rad_s, each.torque]) for each in self.data.segments]
        )


def sources(corpus: Path, *, short: bool = False) -> list[Source]:
    """Return every data set that can be had.

    Parameters
    ----------
    corpus : Path
        The folder of logs; where it is not there, its data sets are left out.
    short : bool
        Two simulated flights only.

    Returns
    -------
    list of Source
    """
    simulated = [
        Source(
            name=f"{scenario}, {autopilot}, {hz:g} Hz", kind="simulated", scenario=(scenario, autopilot, hz)
        )
        for scenario, autopilot, hz in SIMULATED
    ]
    if short:
        return simulated[:2]
    return [*_firmware(corpus), *simulated, *_flown(corpus)]


def _firmware(corpus: Path) -> Iterator[Source]:
    """Yield the logs that state a truth."""
    for path in sorted((corpus / "firmware").glob("*.truth.json")):
        stem = path.name.removesuffix(".truth.json")
        logs = (path.with_name(stem + suffix) for suffix in (".BIN", ".ulg", ".bbl"))
        log = next((each for each in logs if each.is_file()), None)
        if log is not None and firmware_truth(json.loads(path.read_text())) is not None:
            yield Source(name=log.name, kind="firmware", path=log)


def _flown(corpus: Path) -> Iterator[Source]:
    """Yield the flights of the sets that are known to be of one vehicle."""
    from study.repeat import flown_sets

    if not (corpus / "flown").is_dir():
        return
    for vehicle, logs in flown_sets(corpus):
        for log in logs:
            yield Source(name=f"{vehicle}: {log.name}", kind="flown", path=log, vehicle=vehicle)


def load(source: Source) -> DataSet | None:
    """Read and align a data set.

    Parameters
    ----------
    source : Source

    Returns
    -------
    DataSet or None
        None where no flight is in the log, or it cannot be read.
    """
    truth = None
    if source.scenario is not None:
        log, truth = _simulated(*source.scenario)
    else:
        assert source.path is not None
        try:
            log = read_log(source.path)
        except QuadidError:
            return None
        if source.kind == "firmware":
            stated = source.path.with_name(source.path.name.rsplit(".", 1)[0] + ".truth.json")
            truth = firmware_truth(json.loads(stated.read_text()))
    prepared = prepare(log)
    data = cut(prepared, Settings().align)
    if not data.segments or data.input is None:
        return None
    return DataSet(source=source, log=prepared.log, data=data, truth=truth)


def _simulated(scenario: str, autopilot: str, rate_hz: float) -> tuple[FlightLog, Truth]:
    """Fly a scenario."""
    flight = simulate(scenario, seed=_SEED, autopilot=autopilot, rate_hz=rate_hz)
    # PX4's placeholder: the torque stays on the scale of the command.
    parameters = {
        name: 6.5 if name.startswith("CA_ROTOR") and name.endswith("_CT") else value
        for name, value in flight.log.parameters.items()
    }
    model = flight.truth["models"]["damped"]
    rates = [model["regressors"].index(name) for name in RATE_SYMBOLS]
    truth = Truth(
        effectiveness=np.diag(np.array(model["B"])), damping=np.diag(np.array(model["A"])[:, rates])
    )
    return replace(flight.log, parameters=parameters), truth


def firmware_truth(stated: dict[str, Any]) -> Truth | None:
    """Return the truth at the mean throttle of the manoeuvre; at hover where only that is stated.

    Parameters
    ----------
    stated : dict
        A ``*.truth.json`` of the corpus.

    Returns
    -------
    Truth or None
        None where it states no linear model. The damping is NaN where it states none (Betaflight).
    """
    if "B_rad_s2_per_torque_setpoint" in stated:
        diagonal = _diagonal(stated["B_rad_s2_per_torque_setpoint"])
    elif "at_segment_mean" in stated:
        diagonal = _diagonal(stated["at_segment_mean"]["B_rad_s2_per_unit"])
    elif "at_hover" in stated:
        diagonal = _diagonal(stated["at_hover"]["B_rad_s2_per_unit"]["M"])
    elif "B_roll_pitch_yaw_ls_flight" in stated.get("linear_model", {}):
        # Magnitudes: rates and sums are turned alike on reading. Over the flight, for its throttle moves.
        diagonal = np.array(stated["linear_model"]["B_roll_pitch_yaw_ls_flight"])
    else:
        return None
    damping = (stated.get("at_segment_mean") or stated.get("at_hover") or stated).get("A_1_s")
    return Truth(
        effectiveness=diagonal, damping=np.full(3, np.nan) if damping is None else _diagonal(damping)
    )


def _diagonal(rows: Sequence[Sequence[float]]) -> FloatArray:
    """Return what an axis does to itself: a matrix of three rows may have further columns."""
    return np.array([rows[axis][axis] for axis in range(3)])
