"""What to log, set and fly where nothing is known of the autopilot; what is known of one builds on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar, Final

from quadid_logs.sentences import listed

__all__ = ["ADVICE", "Advice", "GainLine", "Setting", "Version"]

#: Name and value of a parameter.
Setting = tuple[str, float]
#: Why, name, and value as text that restores it exactly.
GainLine = tuple[str, str, str]
#: Of the firmware, most significant number first.
Version = tuple[int, ...]

_NOTHING: Final[Mapping[str, str]] = MappingProxyType({})
_STICKS: Final[Mapping[str, str]] = MappingProxyType(
    {"roll": "left-right", "pitch": "forward-back", "yaw": "rudder left-right"}
)


class Advice:
    """What to log, set and fly; every autopilot's has these members.

    Attributes
    ----------
    remedies : mapping of str to str
        By the code of a finding: what to do on this autopilot, in place of the catalogue's advice.
    excitation_parameters : tuple of str
        Parameters that describe an excitation run, as evidence.
    logging_settings : tuple of (name, value)
        What makes it log rates and torque fast enough; empty where no flight can be planned.
    logging_note, gyro_filter_parameter, hover_mode, parameter_suffix : str
        For the card and the parameter files of a planned flight.
    gain_loading : str
        How a file of gains is loaded, with {} for its name.
    """

    remedies: ClassVar[Mapping[str, str]] = _NOTHING
    excitation_parameters: ClassVar[tuple[str, ...]] = ()
    logging_settings: ClassVar[tuple[Setting, ...]] = ()
    logging_note: ClassVar[str] = ""
    gyro_filter_parameter: ClassVar[str] = "the gyro filter"
    hover_mode: ClassVar[str] = "a mode that levels itself"
    parameter_suffix: ClassVar[str] = ".txt"
    gain_loading: ClassVar[str] = "Load {} at the ground station"

    def logging(self, log_format: str, parameters: Mapping[str, float], version: Version | None) -> str:
        """Say what to set so that rates and torque are logged at the loop rate.

        Parameters
        ----------
        log_format : str
            As in `FlightLog.format`.
        parameters : mapping of str to float
            Of the log; what is set there is kept and added to.
        version : tuple of int, or None
            Of the firmware, None where the log does not say: taken for a recent one.

        Returns
        -------
        str
        """
        if log_format == "table":
            return "Export the table with at least 100 rows per second."
        return self._onboard(log_format) + self._logging(log_format, parameters, version)

    def _onboard(self, log_format: str) -> str:
        """Say of a telemetry log that the vehicle's own is to be used."""
        if log_format != "tlog":
            return ""
        return (
            "A telemetry log is too slow for this and lacks the torque: use the log on the vehicle's card. "
        )

    def _logging(
        self,
        log_format: str,  # noqa: ARG002
        parameters: Mapping[str, float],  # noqa: ARG002
        version: Version | None,  # noqa: ARG002
    ) -> str:
        """Say what to set on this autopilot."""
        return "Log body rates and the rate controller's outputs at 100 Hz or more."

    def excitation(self, axes: Sequence[str], version: Version | None) -> str:  # noqa: ARG002
        """Say what to fly so that axes are excited enough.

        Parameters
        ----------
        axes : sequence of str
            Of "roll", "pitch" and "yaw", at least one.
        version : tuple of int, or None

        Returns
        -------
        str
        """
        return (
            f"In calm air, fly quick {listed([_STICKS[axis] for axis in axes])} stick doublets (half a "
            f"second each way, a third of full stick) for 30 s{' each' if len(axes) > 1 else ''}."
        )

    def sweep_magnitudes(self, version: Version | None) -> Mapping[str, float]:  # noqa: ARG002
        """Return the amplitude of the sweep that the autopilot can inject, by axis.

        Parameters
        ----------
        version : tuple of int, or None

        Returns
        -------
        mapping of str to float
            Fraction of the mixer's range; empty where the autopilot injects none.
        """
        return {}

    def sweep_settings(self, axis: str, sweep: Mapping[str, float]) -> tuple[Setting, ...]:
        """Return the parameters of an axis' sweep.

        Parameters
        ----------
        axis : str
        sweep : mapping of str to float
            magnitude [1], start_hz, stop_hz, fade_in_s, record_s, fade_out_s.

        Returns
        -------
        tuple of (name, value)
        """
        raise NotImplementedError

    def sweep_comment(self, axis: str) -> str:
        """Return the first line of the parameter file of an axis' sweep."""
        raise NotImplementedError

    def version_notes(self, version: Version | None) -> tuple[str, ...]:  # noqa: ARG002
        """Return what a firmware of this version cannot do of what a plan asks for."""
        return ()

    def parameter_text(self, comment: str, settings: Sequence[Setting]) -> str:
        """Return a file of parameters as the autopilot's ground station loads it.

        Parameters
        ----------
        comment : str
        settings : sequence of (name, value)

        Returns
        -------
        str
        """
        return "\n".join((f"# {comment}", *(f"{name} {value:g}" for name, value in settings))) + "\n"

    def gain_text(
        self, heading: Sequence[str], gains: Sequence[GainLine], parameters: Mapping[str, float]
    ) -> str:
        """Return a file of gains as the autopilot's ground station loads it.

        Parameters
        ----------
        heading : sequence of str
            Comments before the first gain.
        gains : sequence of (comment, name, value)
        parameters : mapping of str to float
            Of the log, which number the vehicle.

        Returns
        -------
        str
        """
        raise NotImplementedError

    def beside_gains(
        self,
        parameters: Mapping[str, float],  # noqa: ARG002
        *,
        back: bool = False,  # noqa: ARG002
    ) -> tuple[GainLine, ...]:
        """Return what has to be set beside gains so that they hold.

        Parameters
        ----------
        parameters : mapping of str to float
            Of the log.
        back : bool
            For the way back to what flew.

        Returns
        -------
        tuple of (comment, name, value)
        """
        return ()

    def steps(self, axes: Sequence[str], sweeps: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
        """Return how to fly a plan from take-off to landing, in order.

        Parameters
        ----------
        axes : sequence of str
        sweeps : mapping of str to mapping
            By axis, as for `sweep_settings`; empty where the pilot flies doublets.

        Returns
        -------
        tuple of str
        """
        if sweeps:
            raise NotImplementedError
        return (
            f"Take off in {self.hover_mode} and hover.",
            *(
                f"{axis.capitalize()}: quick {_STICKS[axis]} doublets, half a second each way, a third of "
                "full stick, a second of rest between them, for 30 s."
                for axis in axes
            ),
            "Land.",
        )


class UnknownAutopilotAdvice(Advice):
    """What holds for tables, and for telemetry of an autopilot that is not known here."""

    remedies = MappingProxyType(
        {
            "QL309": "Nothing to do for a table: its torque is used as it is given. How commands are mixed "
            "to motors is not known here, so that rotors of a vehicle file are only drawn.",
            "QL510": "To get inertias, give the torque in N m (columns L_n_m, M_n_m and N_n_m of a table).",
        }
    )


ADVICE: Final = UnknownAutopilotAdvice()
