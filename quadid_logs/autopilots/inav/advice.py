"""What to log with INAV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

from quadid_logs.autopilots.betaflight.advice import command_line
from quadid_logs.autopilots.generic.advice import Advice, Setting, Version


class InavAdvice(Advice):
    """Blackbox rate, and the text of the command line."""

    hover_mode = "Angle or Acro mode"
    parameter_suffix = ".txt"

    def _logging(
        self,
        log_format: str,  # noqa: ARG002
        parameters: Mapping[str, float],  # noqa: ARG002
        version: Version | None,  # noqa: ARG002
    ) -> str:
        """Say how to log fast."""
        return (
            "On the command line, set blackbox_rate_num = 1 and blackbox_rate_denom = 2. Keep gyro and "
            "motors among the logged fields, save, and fly again."
        )

    def parameter_text(
        self,
        comment: str,
        settings: Sequence[Setting],
        parameters: Mapping[str, float] = MappingProxyType({}),  # noqa: ARG002
    ) -> str:
        """Return lines for the command line."""
        return command_line(comment, settings)


ADVICE: Final = InavAdvice()
