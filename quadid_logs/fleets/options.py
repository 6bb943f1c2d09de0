"""What holds for every log of a fleet."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

from quadid_logs.data.settings import IdentifySettings, Settings, in_band
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.fleets.naming import NamingRules


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How every log is analyzed and named.

    ``structure`` is one for all, because numbers of different structures
    cannot be compared; ``band_hz`` is a band for all [Hz], None lets each log
    decide. ``vehicle_file`` is the text of the vehicle file that `vehicle` was
    read from. With ``margins``, rows hold those of each loop. A file above
    ``max_bytes`` is not fetched, and a log that takes longer than ``timeout_s``
    is given up. A log of 1 GB takes half a minute; the limit leaves room for
    4 GB, slow machines and slow networks.
    """

    structure: str = "damped"
    band_hz: tuple[float, float] | None = None
    vehicle: Vehicle | None = None
    vehicle_file: str = ""
    rules: NamingRules = field(default_factory=NamingRules)
    reports: bool = False
    margins: bool = False
    max_bytes: int = 4_000_000_000
    timeout_s: float = 1800.0

    @property
    def settings(self) -> Settings:
        """The settings of each analysis."""
        return Settings(identify=in_band(self.band_hz, IdentifySettings(structure=self.structure)))

    def fingerprint(self) -> dict[str, str]:
        """Return what must be the same in all runs into one store, ready for JSON."""
        return {
            "structure": self.structure,
            "band": "" if self.band_hz is None else "{:g} {:g}".format(*self.band_hz),
            "vehicle_file_sha256": hashlib.sha256(self.vehicle_file.encode()).hexdigest()
            if self.vehicle_file
            else "",
            "vehicle_from": self.rules.vehicle_from,
            "model_from": self.rules.model_from,
            "margins": "yes" if self.margins else "",
        }
