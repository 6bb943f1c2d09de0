"""Everything that `analyze` found out, as one object: what a report is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from quadid_logs.data.diagnosis import Diagnosis
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """The chain's objects, one per stage, and the seconds that each stage took."""

    log: FlightLog
    data: FlightData
    identification: Identification
    diagnosis: Diagnosis
    settings: Settings
    vehicle: Vehicle | None = None
    timings_s: Mapping[str, float] = field(default_factory=dict)
