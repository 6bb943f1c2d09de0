"""The result of `analyze` as one object: the content of the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import NamedTuple

from quadid_logs.data.closed_loop import AxisLoop, ClosedLoop
from quadid_logs.data.diagnosis import Diagnosis, Verdict
from quadid_logs.data.flight import FlightData
from quadid_logs.data.health import Health
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.vocabulary import ON_AXIS


@dataclass(frozen=True, slots=True, kw_only=True)
class PooledLog:
    """One log of a pooled analysis: its path and the length of its used data [s].

    ``same_as`` is the path of an earlier log with the same flights; such a log adds nothing.
    """

    path: str
    used_s: float
    same_as: str = ""


class EarlierFlight(NamedTuple):
    """An earlier log of the same vehicle: the axes that it narrows, and the axes that it contradicts."""

    path: str
    axes: tuple[str, ...]
    differ: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, weakref_slot=True, kw_only=True, eq=False)
class Result:
    """The outputs of all stages of the analysis, and the time that each stage took [s].

    ``pooled`` lists the logs of a pooled analysis; ``log`` is then the first log with a flight.
    ``closed_loop`` is None if the controller is not known. ``health`` holds the checks of the flight, None if
    they were not made. ``earlier`` lists the earlier flights that narrowed the intervals of the loops.

    Examples
    --------
    >>> from quadid_logs import analyze
    >>> result = analyze("sample_logs/default-logging.bin")
    >>> result.name, result.diagnosis.usable
    ('default-logging.bin', False)
    """

    log: FlightLog
    data: FlightData
    identification: Identification
    diagnosis: Diagnosis
    settings: Settings
    closed_loop: ClosedLoop | None = None
    health: Health | None = None
    vehicle: Vehicle | None = None
    pooled: tuple[PooledLog, ...] = ()
    earlier: tuple[EarlierFlight, ...] = ()
    timings_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the log, with the number of further logs in a pooled analysis."""
        own = PurePath(self.log.path).name
        return f"{own} and {len(self.pooled) - 1} more" if self.pooled else own

    @property
    def verdict(self) -> dict[str, Verdict]:
        """Verdict of each axis: "usable", "caution" or "refused"."""
        return {axis: found.verdict for axis, found in self.diagnosis.axes.items()}

    def loop_of(self, axis: str) -> AxisLoop | None:
        """Return the rate loop of an axis; None where it is not known.

        Parameters
        ----------
        axis : str
            roll, pitch or yaw.

        Returns
        -------
        AxisLoop or None
        """
        return None if self.closed_loop is None else self.closed_loop.axes.get(axis)

    def __repr__(self) -> str:
        model = self.identification.recommended
        structure = "no model" if model is None else f"structure {model.structure}"
        lines = [f"<{type(self).__name__} of {self.name!a}: {structure}"]
        for axis, verdict in self.verdict.items():
            gain = None if model is None or verdict == "refused" else model.entries.get(ON_AXIS[axis])
            lines.append(f"  {axis:<5}  {verdict:<7}  {'' if gain is None else gain}".rstrip())
        return "\n".join(lines) + ">"
