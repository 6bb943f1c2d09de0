"""What to log, set and fly where nothing is known of the autopilot; what is known of one builds on it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Final

from quadid_logs.data.log import own_bits
from quadid_logs.sentences import listed
from quadid_logs.vocabulary import TABLE_FORMAT

__all__ = ["ADVICE", "Advice", "GainLine", "Setting", "Version", "digits"]

#: Name and value of a parameter.
Setting = tuple[str, float]
#: Why, name, and value as text that restores it exactly.
GainLine = tuple[str, str, str]
#: Of the firmware, most significant number first.
Version = tuple[int, ...]

_NOTHING: Final[Mapping[str, str]] = MappingProxyType({})
_NOTHING_SET: Final[Mapping[str, float]] = MappingProxyType({})
_STICKS: Final[Mapping[str, str]] = MappingProxyType(
    {"roll": "left-right", "pitch": "forward-back", "yaw": "rudder left-right"}
)


def digits(value: float) -> str:
    """Return a setting as text: a mask to its last bit.

    Examples
    --------
    >>> digits(1224703.0), digits(0.05)
    ('1224703', '0.05')
    """
    return f"{value:.10g}"


#: Instead of a sweep, where the firmware has none.
_QUICKER: Final = "Fly quicker manoeuvres, such as short stick flicks"
_BY_HAND: Final[Mapping[str, str]] = MappingProxyType(
    {
        "QL603": (
            "Do not rely on the margins of this axis. Quicker manoeuvres, such as short stick flicks, show "
            "more of the loop itself."
        ),
        "QL605": f"{_QUICKER}.",
        "QL614": f"{_QUICKER}, and tune from that flight.",
        "QL639": f"{_QUICKER}, for a narrower promise.",
    }
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
        Bits of masks: what makes it log rates and torque fast enough where the masks of the vehicle are
        not known; empty where nothing of that kind is set.
    plans_by_hand : bool
        A flight can be planned though it needs no file: what to log is typed in, as `logging` says. With
        `logging_settings` or `whole_files` it can be planned anyway.
    logging_bits : mapping of str to int
        By the name of a mask, the bits that it needs.
    logging_note, gyro_filter_parameter, hover_mode, parameter_suffix : str
        For the card and the parameter files of a planned flight.
    columns : tuple of str
        Comments at the head of every parameter file.
    last_line : str
        What ends a parameter file.
    live_note : str
        What to set, and which link it takes, to receive the log in flight; "" where that cannot be.
    excitation_entry : str
        Where the autopilot can be excited: "mixer", "rate" (a rate set-point), or "" for nowhere.
    excitation_by : str
        What excites it there, in words.
    excitation_most_hz : float
        Fastest excitation that reaches it.
    excitation_lead_lag_hz : (float, float) or None
        Pole and zero of what the autopilot shapes a sweep with.
    unknown_mask_note : str
        What to do with a file of `logging_settings` where other bits may be set on the vehicle.
    before_setting : str
        How all settings are kept before they are changed, where no file of the way back can be made.
    gain_loading : str
        How a file of gains is loaded, with {} for its name.
    room : str
        Where to fly a plan.
    not_set_by_hand : tuple of str
        Names, as patterns of the shell, of parameters that the autopilot measures, counts or repeats.
    """

    remedies: ClassVar[Mapping[str, str]] = _NOTHING
    excitation_parameters: ClassVar[tuple[str, ...]] = ()
    logging_settings: ClassVar[tuple[Setting, ...]] = ()
    plans_by_hand: ClassVar[bool] = False
    logging_bits: ClassVar[Mapping[str, int]] = MappingProxyType({})
    logging_note: ClassVar[str] = ""
    live_note: ClassVar[str] = ""
    excitation_entry: ClassVar[str] = ""
    excitation_by: ClassVar[str] = ""
    excitation_most_hz: ClassVar[float] = float("inf")
    excitation_lead_lag_hz: ClassVar[tuple[float, float] | None] = None
    unknown_mask_note: ClassVar[str] = ""
    before_setting: ClassVar[str] = ""
    gyro_filter_parameter: ClassVar[str] = "the gyro filter"
    hover_mode: ClassVar[str] = "a mode that levels itself"
    parameter_suffix: ClassVar[str] = ".txt"
    columns: ClassVar[tuple[str, ...]] = ()
    last_line: ClassVar[str] = ""
    gain_loading: ClassVar[str] = "Load {} at the ground station"
    room: ClassVar[str] = (
        "Choose calm air, a full battery, 10 m of free space on all sides, and a height of 10 m or more."
    )

    not_set_by_hand: ClassVar[tuple[str, ...]] = ()

    def remedy(self, code: str, version: Version | None) -> str:
        """Return what to do about a finding, in a version of this autopilot; "" for the catalogue's advice.

        Parameters
        ----------
        code : str
        version : tuple of int or None
            Of the firmware; None where the log does not say.
        """
        found = self.remedies.get(code, "")
        return found if found or self.excites(version) else _BY_HAND.get(code, "")

    def step_note(self, parameters: Mapping[str, float]) -> str:
        """Say what a computed step response leaves out of what the firmware does; "" for nothing.

        Parameters
        ----------
        parameters : mapping of str to float
            Of the log.
        """
        return ""

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
        """
        if log_format == TABLE_FORMAT:
            return "Export the table with at least 100 rows per second."
        slow = "A telemetry log is too slow for this: use the log on the vehicle's card. "
        return (slow if log_format == "tlog" else "") + self._logging(log_format, parameters, version)

    def _logging(self, log_format: str, parameters: Mapping[str, float], version: Version | None) -> str:
        """Say what to set on this autopilot."""
        return "Log the body rates and the rate controller's outputs at 100 Hz or more."

    def excitation(self, axes: Sequence[str], version: Version | None) -> str:
        """Say what to fly so that axes are excited enough.

        Parameters
        ----------
        axes : sequence of str
            Of "roll", "pitch" and "yaw", at least one.
        """
        return f"In calm air, {self._doublets(axes)}"

    def _doublets(self, axes: Sequence[str]) -> str:
        return (
            f"fly quick {listed([_STICKS[axis] for axis in axes])} stick doublets (half a "
            f"second each way, a third of full stick) for 30 s{' each' if len(axes) > 1 else ''}."
        )

    def logging_values(self, parameters: Mapping[str, float]) -> tuple[Setting, ...]:
        """Return the masks that make this vehicle log rates and torque fast enough.

        Parameters
        ----------
        parameters : mapping of str to float
            What is set on the vehicle; empty where that is not known.

        Returns
        -------
        tuple of (name, value)
            Its own bits and those that are missing. Without a mask that lacks none, and without one that
            the log does not hold exactly: that is set by hand, as `logging` says.
        """
        if not parameters:
            return self.logging_settings
        own = {name: own_bits(parameters.get(name)) for name in self.logging_bits}
        return tuple(
            (name, float(mask | self.logging_bits[name]))
            for name, mask in own.items()
            if mask is not None and mask | self.logging_bits[name] != mask
        )

    def sweep_magnitudes(self, version: Version | None) -> Mapping[str, float]:
        """Return the amplitude of the sweep that the autopilot can inject, by axis.

        Fraction of the mixer's range; empty where the autopilot injects none.
        """
        return {}

    def sweep_settings(self, axis: str, sweep: Mapping[str, float]) -> tuple[Setting, ...]:
        """Return the parameters of an axis' sweep.

        Parameters
        ----------
        sweep : mapping of str to float
            magnitude [1], start_hz, stop_hz, fade_in_s, record_s, fade_out_s.
        """
        raise NotImplementedError

    def sweep_comment(self, axis: str) -> str:
        """Return the first line of the parameter file of an axis' sweep."""
        raise NotImplementedError

    def sweep_off(self) -> tuple[Setting, ...]:
        """Return the parameters that take the sweep off the vehicle again."""
        return ()

    def whole_files(self, axes: Sequence[str]) -> dict[str, str]:
        """Return files of a plan that are no parameters, by name: what is logged, a script that flies."""
        return {}

    def excitation_files(
        self,
        excitations: Mapping[str, Mapping[str, float]],
        multisine: Mapping[str, Any],
        parameters: Mapping[str, float],
    ) -> dict[str, str]:
        """Return files by name that fly the excitation of a plan, or set it up and take it off again.

        Parameters
        ----------
        excitations : mapping of str to mapping
            By axis, the fields of `quadid_logs.control.excitation_design.AxisExcitation`.
        multisine : mapping
            Rate set-points of all axes at once: ``period_s``, ``periods``, and by axis ``lines`` of frequency
            [Hz] and phase [rad], ``scale_dps`` of each line and ``limit_dps`` of their sum.
        parameters : mapping of str to float
            Of the vehicle, where they are known.
        """
        return {}

    def live_files(self, parameters: Mapping[str, float]) -> dict[str, str]:
        """Return files by name that make the vehicle stream its log, and the way back.

        Parameters
        ----------
        parameters : mapping of str to float
            Of a log of the vehicle.
        """
        return {}

    def logging_needs_update(self, version: Version | None) -> bool:
        """Return whether `logging` says to update the firmware."""
        return False

    def controller_note(self, version: Version | None) -> str:
        """Say which firmware has a controller that is modelled, where this version is too old; else ""."""
        return ""

    def version_notes(self, version: Version | None) -> tuple[str, ...]:
        """Return what a firmware of this version cannot do of what a plan asks for."""
        return ()

    def parameter_text(
        self, comment: str, settings: Sequence[Setting], parameters: Mapping[str, float] = _NOTHING_SET
    ) -> str:
        """Return a file of parameters as the autopilot's ground station loads it.

        Parameters
        ----------
        parameters : mapping of str to float
            Of the log, which number the vehicle.
        """
        return self.file_text((comment,), [("", name, digits(value)) for name, value in settings], parameters)

    def gain_text(
        self, heading: Sequence[str], gains: Sequence[GainLine], parameters: Mapping[str, float]
    ) -> str:
        """Return a file of gains, as `parameter_text` one of parameters.

        Parameters
        ----------
        heading : sequence of str
            Comments before the first gain.
        """
        return self.file_text(heading, gains, parameters)

    def file_text(
        self,
        heading: Sequence[str],
        lines: Sequence[GainLine],
        parameters: Mapping[str, float],
    ) -> str:
        """Return a file with comments in lines of their own: some ground stations skip others."""
        written = [f"# {one}".rstrip() for one in (*heading, *self.columns)]
        for comment, name, value in lines:
            written += [f"# {comment}"] if comment else []
            written.append(self.parameter_line(name, value, parameters))
        return "\n".join(filter(None, (*written, self.last_line))) + "\n"

    def parameter_line(self, name: str, value: str, parameters: Mapping[str, float]) -> str:
        """Return the line of a file that sets a parameter."""
        return f"{name} {value}"

    def beside_gains(
        self, parameters: Mapping[str, float], changed: Collection[str] = (), *, back: bool = False
    ) -> tuple[GainLine, ...]:
        """Return what has to be set beside gains so that they hold.

        Parameters
        ----------
        back : bool
            For the way back to what flew.
        """
        return ()

    def steps_by_hand(
        self, axes: Sequence[str], sweeps: Mapping[str, Mapping[str, float]]
    ) -> tuple[str, ...]:
        """Return how to fly sweeps without the script that `steps` flies; empty where that flies none.

        Parameters
        ----------
        sweeps : mapping of str to mapping
            As for `steps`.
        """
        return ()

    def excites(self, version: Version | None) -> bool:
        """Say whether the firmware can move the axes by itself, or by the files of a plan.

        Parameters
        ----------
        version : tuple of int, or None
            None for a recent one.
        """
        return self.excitation_entry == "rate" or bool(
            self.excitation_entry and self.sweep_magnitudes(version)
        )

    @property
    def excitation_step(self) -> str:
        """What in a plan can take the place of doublets by stick, before landing; "" where nothing can."""
        return ""

    def steps(self, axes: Sequence[str], sweeps: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
        """Return how to fly a plan from take-off to landing, in order.

        Parameters
        ----------
        sweeps : mapping of str to mapping
            By axis, as for `sweep_settings`; empty where the pilot flies doublets.
        """
        if sweeps:
            raise NotImplementedError
        return (
            f"Take off in {self.hover_mode} and hover.",
            *(
                f"{axis.capitalize()}: fly quick {_STICKS[axis]} doublets for 30 s: half a second each way, "
                "a third of full stick, a second of rest between them."
                for axis in axes
            ),
            "Land.",
        )


class UnknownAutopilotAdvice(Advice):
    """What holds for tables, and for telemetry of an autopilot that is not known here."""

    remedies = MappingProxyType(
        {
            "QL309": (
                "Use the model per unit of the table's torque, which is taken as it is. A table does not "
                "say how commands are mixed to motors, so the rotors of a vehicle file are only drawn."
            ),
            "QL510": "To get inertias, give the torque in N m (columns L_n_m, M_n_m and N_n_m of a table).",
        }
    )


ADVICE: Final = UnknownAutopilotAdvice()
