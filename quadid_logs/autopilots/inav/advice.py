"""What to log with INAV."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from quadid_logs.autopilots.generic.advice import Advice, Version


class InavAdvice(Advice):
    """Blackbox rate, and the text of the command line."""

    hover_mode = "Angle or Acro mode"
    last_line = "save"

    def _logging(self, log_format: str, parameters: Mapping[str, float], version: Version | None) -> str:
        """Say how to log fast."""
        return (
            "On the command line, set blackbox_rate_num = 1 and blackbox_rate_denom = 2. Keep gyro and "
            "motors among the logged fields, save, and fly again."
        )

    def parameter_line(self, name: str, value: str, parameters: Mapping[str, float]) -> str:
        """Return a line for the command line."""
        return f"set {name} = {value}"


ADVICE: Final = InavAdvice()
