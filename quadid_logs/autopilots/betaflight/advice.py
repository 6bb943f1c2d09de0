"""What to log, set and fly with Betaflight, by the version of the firmware."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from quadid_logs.autopilots.generic.advice import Advice, Setting, Version

#: The chirp flight mode is in builds since then, where it was chosen (USE_CHIRP).
_CHIRP_SINCE: Final[Version] = (2025, 12)


class BetaflightAdvice(Advice):
    """Blackbox rate, chirp mode, and the text of the command line."""

    gyro_filter_parameter = "gyro_lpf1_static_hz"
    hover_mode = "Angle or Acro mode"
    parameter_suffix = ".txt"

    def _logging(
        self,
        log_format: str,  # noqa: ARG002
        parameters: Mapping[str, float],  # noqa: ARG002
        version: Version | None,  # noqa: ARG002
    ) -> str:
        """Say how to log fast, with the speed of the rotors."""
        return (
            "On the command line set blackbox_sample_rate = 1/4 (1 kHz with a PID loop of 4 kHz) and "
            "blackbox_mode = NORMAL, leave gyro, PID, set-points, motors and RPM among the logged fields, "
            "turn on bidirectional DShot, save, and fly again."
        )

    def excitation(self, axes: Sequence[str], version: Version | None) -> str:
        """Chirp mode where the firmware has it, else doublets by stick."""
        if version is not None and version < _CHIRP_SINCE:
            return super().excitation(axes, version)
        return (
            f"In calm air, hover and switch on the CHIRP mode for 20 s for {' and '.join(axes)} (each time "
            "it is switched on it moves the next axis), with debug_mode = CHIRP; a build without CHIRP: "
            f"{super().excitation(axes, version)}"
        )

    def parameter_text(self, comment: str, settings: Sequence[Setting]) -> str:
        """Return lines for the command line."""
        lines = (f"set {name} = {value:g}" for name, value in settings)
        return "\n".join((f"# {comment}", *lines, "save")) + "\n"


ADVICE: Final = BetaflightAdvice()
