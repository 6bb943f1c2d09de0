"""What an autopilot is to this package, and which ones there are.

One folder per autopilot holds all that is known of it: how its logs look, what its messages and
parameters mean, how it mixes, what to set and fly. The folder's ``AUTOPILOT`` is the way in, and nothing
outside the folders knows a vendor's name. Importing this module imports no folder. An installed package adds
one by an entry point of the group `GROUP` that names its `Autopilot`, a running program by `register`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

from quadid_logs.data.log import FlightLog
from quadid_logs.errors import SettingsError
from quadid_logs.vocabulary import AXES

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from quadid_logs.actuation.airframe import Airframe, Unknown
    from quadid_logs.actuation.motors import Rebuilt
    from quadid_logs.align.series import CleanLog
    from quadid_logs.autopilots.generic.advice import Advice
    from quadid_logs.data.controller import FlownControllers, ReplayInput
    from quadid_logs.data.health import Line
    from quadid_logs.data.off_nominal import ThrustLaw
    from quadid_logs.data.outer_loops import AttitudeRows, OuterControllers, ShaperRows
    from quadid_logs.data.tuning import FilterChoices, Tunable

__all__ = ["Autopilot", "LogFormat", "entry", "formats", "known", "named", "register"]

#: Of the entry points by which installed packages add autopilots.
GROUP: Final = "quadid_logs.autopilots"
#: In the order in which their formats are asked; the last one answers for logs that name no autopilot.
_FOLDERS: Final = ("px4", "ardupilot", "inav", "cleanflight", "betaflight", "crazyflie", "generic")


class Reader(Protocol):
    """Reads a file of one format."""

    def __call__(self, path: str | Path, *, system: int = 0) -> FlightLog:
        """Return the log; `system` is the MAVLink system to read, 0 chooses: a file may hold several."""


class NumberedReader(Protocol):
    """Reads one log of a file that can hold several."""

    def __call__(self, path: str | Path, *, system: int = 0, number: int = 0) -> FlightLog:
        """Return log `number`, counted from 1; 0 takes the only one."""


class LogFormat(NamedTuple):
    """A kind of log file.

    Attributes
    ----------
    name : str
        As in `FlightLog.format`: formats with the same framing have one name.
    title : str
        For people.
    is_mine : callable
        Tells from the first 64 kB whether a file is of this kind.
    read : Reader
    suffixes : tuple of str
        How such files mostly end; only for people and for listing folders.
    shared_suffixes : tuple of str
        How they end, too, as many other files do: in a folder the content decides.
    dialect : str
        As in `FlightLog.dialect`.
    strict : bool
        False where `is_mine` takes much for its own, as formats of text do: asked after the strict ones.
    read_numbered : NumberedReader, optional
        Where a file of this kind can hold several logs.
    """

    name: str
    title: str
    is_mine: Callable[[bytes], bool]
    read: Reader
    suffixes: tuple[str, ...] = ()
    dialect: str = ""
    strict: bool = True
    read_numbered: NumberedReader | None = None
    shared_suffixes: tuple[str, ...] = ()


class Autopilot:
    """An autopilot; what a subclass does not override is not known of it.

    Attributes
    ----------
    name : str
        As in `FlightLog.autopilot`.
    title : str
        For people.
    serial_parameters, system_parameters : tuple of str
        Parameters in which people number their vehicles: a serial number (0: none), a system on the radio
        link (1: the default).
    airframe_parameters : tuple of str
        Parameters that number the airframe, beyond what its frame is called (0: none).
    """

    name: str = "other"
    title: str = "not stated"
    serial_parameters: tuple[str, ...] = ()
    system_parameters: tuple[str, ...] = ()
    airframe_parameters: tuple[str, ...] = ()

    def formats(self) -> tuple[LogFormat, ...]:
        """Return the formats of its logs, those with the surest marks first."""
        return ()

    def find_airframe(self, log: FlightLog) -> Airframe | Unknown:
        """Tell the frame, its motors and outputs from a log's parameters."""
        from quadid_logs.actuation.airframe import Unknown

        return Unknown(remark="The log names neither autopilot nor frame.")

    def rebuild(self, log: CleanLog, airframe: Airframe) -> Rebuilt:
        """Rebuild what the motors did from commands and outputs."""
        from quadid_logs.actuation.motors import Rebuilt

        return Rebuilt()

    def loop_rate_hz(self, parameters: Mapping[str, float]) -> float:
        """Return the rate of the rate controller's loop [Hz], 0 where the parameters do not say."""
        return 0.0

    def angle_gains(self, mode: str, parameters: Mapping[str, float]) -> tuple[float, float, float] | None:
        """Return the gains from angles of roll, pitch, yaw to rate set-points in a flight mode [1/s].

        Zeros where the sticks command rates. None where set-points answer position or speed, where the
        autopilot itself flies, and where the mode or its gains are not known.
        """
        return None

    def stick_gains(self, mode: str, parameters: Mapping[str, float]) -> tuple[float, float] | None:
        """Return the rate set-points of roll and pitch that full sticks make of a level vehicle [rad/s].

        Of flight modes in which sticks are logged that ask for angles; None of others.
        """
        return None

    def controllers(
        self,
        log: FlightLog,
        parameters: Mapping[str, float],
        *,
        period_s: float | None = None,
        axes: Sequence[str] = AXES,
    ) -> FlownControllers | None:
        """Return the rate and angle controllers that these parameters make; None where they are not known.

        ``period_s`` is that of the rate loop where it is known better than by the log's rows; ``axes`` are
        those wanted: a search changes the parameters of one hundreds of times.
        """
        return None

    def replay_inputs(
        self, log: FlightLog, controllers: FlownControllers, intervals: Sequence[tuple[float, float]]
    ) -> Mapping[str, ReplayInput]:
        """Return by axis the rows and the law to replay them with; nothing where too little was logged.

        ``intervals`` are flights, (start_s, end_s) on the log's own clock; none for the whole log.
        """
        return {}

    def outer_controllers(self, parameters: Mapping[str, float]) -> OuterControllers | None:
        """Return the controllers around the rate loop by these parameters; None where they are not known."""
        return None

    def attitude_rows(
        self, log: FlightLog, parameters: Mapping[str, float], intervals: Sequence[tuple[float, float]]
    ) -> AttitudeRows | None:
        """Return what the attitude controller's law makes, beside what was logged; None without either.

        ``intervals`` as of `replay_inputs`.
        """
        return None

    def shaper_rows(
        self, log: FlightLog, parameters: Mapping[str, float], intervals: Sequence[tuple[float, float]]
    ) -> ShaperRows | None:
        """Return wanted angles, and what an input shaper makes of them; None where either is missing.

        ``intervals`` as of `replay_inputs`.
        """
        return None

    def tunable(
        self, parameters: Mapping[str, float], version: tuple[int, ...] | None = None
    ) -> Tunable | None:
        """Return the gains that may be changed, in the ranges of a version; None where none are known."""
        return None

    def thrust_law(self, log: FlightLog, parameters: Mapping[str, float]) -> ThrustLaw:
        """Return what the firmware makes of a command of thrust; the command itself where nothing says so."""
        from quadid_logs.data.off_nominal import AS_COMMANDED

        return AS_COMMANDED

    def filter_choices(
        self, log: FlightLog, parameters: Mapping[str, float], lines: Sequence[Line]
    ) -> FilterChoices:
        """Return what of the filters may be set.

        ``parameters`` flew: what is not among them, this version does not have. ``lines`` are those of the
        gyro's spectrum about all axes.
        """
        from quadid_logs.data.tuning import FilterChoices

        return FilterChoices()

    @property
    def advice(self) -> Advice:
        """What to log, set and fly."""
        from quadid_logs.autopilots.generic.advice import ADVICE

        return ADVICE


class _Entry:
    def __init__(self, place: str) -> None:
        self._module, self._name = place.split(":")

    def __get__(self, autopilot: Autopilot | None, owner: type[Autopilot]) -> Any:
        return getattr(importlib.import_module(self._module), self._name)


def entry(place: str) -> Any:
    """Return a member of an autopilot that stands in another module, imported when it is first used.

    Parameters
    ----------
    place : str
        Module and name, "px4_like.torque:rebuild". A function there takes what the method of `Autopilot`
        takes, without ``self``.

    Returns
    -------
    descriptor
        For the body of a subclass: ``rebuild = entry("px4_like.torque:rebuild")``.
    """
    return _Entry(place)


_registered: list[Autopilot] = []


def register(autopilot: Autopilot) -> None:
    """Add an autopilot to those of this package; its formats are asked first."""
    _registered.insert(0, autopilot)


def known() -> tuple[Autopilot, ...]:
    """Return every autopilot, in the order in which their formats are asked.

    Returns
    -------
    tuple of Autopilot
        Registered ones first, then those of installed packages.

    Raises
    ------
    SettingsError
        If the autopilot of an installed package cannot be loaded.
    """
    return (*_registered, *_installed(), *_own())


@cache
def _installed() -> tuple[Autopilot, ...]:
    """Return the autopilots that other packages bring along."""
    from importlib.metadata import entry_points

    return tuple(map(_loaded, sorted(entry_points(group=GROUP), key=lambda each: each.name)))


def _loaded(entry: EntryPoint) -> Autopilot:
    """Import an autopilot of another package, whatever that package does."""
    package = entry.dist.name if entry.dist else entry.value
    hint = f"Update or uninstall the package {package}."
    try:
        autopilot = entry.load()
    except Exception as error:
        raise SettingsError(
            f"The autopilot {entry.name} of {package} cannot be loaded: {error}.", hint=hint
        ) from error
    if not isinstance(autopilot, Autopilot):
        raise SettingsError(f"The entry point {entry.name} of {package} is not an Autopilot.", hint=hint)
    return autopilot


@cache
def _own() -> tuple[Autopilot, ...]:
    """Return the autopilots that have a folder here."""
    return tuple(importlib.import_module(f"{__name__}.{folder}").AUTOPILOT for folder in _FOLDERS)


def named(name: str) -> Autopilot:
    """Return the autopilot of a log.

    Parameters
    ----------
    name : str
        `FlightLog.autopilot`.

    Returns
    -------
    Autopilot
        For a name that nobody has, the one of logs that name no autopilot.
    """
    autopilots = known()
    return next((autopilot for autopilot in autopilots if autopilot.name == name), autopilots[-1])


def formats() -> tuple[LogFormat, ...]:
    """Return every log format, in the order in which they are to be asked.

    Those that are told by their first bytes before those that could be any text.
    """
    found = [one for autopilot in known() for one in autopilot.formats()]
    return tuple(sorted(found, key=lambda one: not one.strict))


def format_of(head: bytes) -> LogFormat | None:
    """Return the format of a file: the first of `formats` that takes it for its own.

    Parameters
    ----------
    head : bytes
        First bytes of the file.

    Returns
    -------
    LogFormat or None
        The readers of autopilots that come later are not even imported, which takes as long as a short log.
    """
    by_text: list[LogFormat] = []
    for autopilot in known():
        for one in autopilot.formats():
            if not one.strict:
                by_text.append(one)
            elif one.is_mine(head):
                return one
    return next((one for one in by_text if one.is_mine(head)), None)
