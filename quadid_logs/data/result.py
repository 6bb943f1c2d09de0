"""Everything that `analyze` found, as one object: what a report is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePath

from quadid_logs.data.closed_loop import ClosedLoop
from quadid_logs.data.diagnosis import Diagnosis
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class PooledLog:
    """One of several logs behind one model: its path and the seconds of it that were used."""

    path: str
    used_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """The chain's objects, one per stage, and the seconds that each stage took.

    ``pooled`` names the logs where the model is that of several; ``log`` is
    then the first that flew. ``closed_loop`` is None where no controller is known.

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
    vehicle: Vehicle | None = None
    pooled: tuple[PooledLog, ...] = ()
    timings_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the log, with the number of others where several were pooled."""
        own = PurePath(self.log.path).name
        return f"{own} and {len(self.pooled) - 1} more" if self.pooled else own
