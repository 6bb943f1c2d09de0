"""What to log and fly with a Crazyflie."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from quadid_logs.autopilots.generic.advice import Advice, Version


class CrazyflieAdvice(Advice):
    """Variables for the card."""

    def _logging(
        self,
        log_format: str,  # noqa: ARG002
        parameters: Mapping[str, float],  # noqa: ARG002
        version: Version | None,  # noqa: ARG002
    ) -> str:
        return "x."


ADVICE: Final = CrazyflieAdvice()
