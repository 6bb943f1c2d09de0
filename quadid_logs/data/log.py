"""What a reader hands on: the log's signals under canonical names, in file order."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple, TypeAlias

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.torque import TorqueModel
from quadid_logs.errors import ShapeError
from quadid_logs.vocabulary import MULTIROTOR, SIGNALS

#: Whole numbers below are exact in single precision.
_EXACT: Final = 2.0**24
#: As autopilots write it after their name: "V4.5.7 (2a3dc4b7)", "v1.15.0-beta", "V3.4-rc2".
_VERSION: Final = re.compile(r"\b[Vv](\d{1,4})\.(\d{1,4})(?:\.(\d{1,4}))?")


def version_in(firmware: str) -> tuple[int, ...] | None:
    """Return the numbers of a firmware's version.

    Parameters
    ----------
    firmware : str
        Name and version as shown.

    Returns
    -------
    tuple of int or None
        Most significant first; None where the text does not say.

    Examples
    --------
    >>> version_in("v1.15.0-beta"), version_in("master")
    ((1, 15, 0), None)
    """
    match = _VERSION.search(firmware)
    return tuple(int(number) for number in match.groups() if number) if match else None


def whole_number(value: float | None, otherwise: int = 0) -> int:
    """Return a parameter that counts or names something.

    Parameters
    ----------
    value : float or None
    otherwise : int
        For a parameter that is missing or, in a damaged log, no number of up to 32 bits.

    Returns
    -------
    int

    Examples
    --------
    >>> whole_number(12.0), whole_number(float("nan")), whole_number(None, 4)
    (12, 0, 4)
    """
    return int(value) if value is not None and abs(value) < 2.0**32 else otherwise


def own_bits(value: float | None) -> int | None:
    """Return a mask of bits, None where single precision, in which a log holds it, may have lost some.

    Parameters
    ----------
    value : float or None

    Returns
    -------
    int or None
        Of a mask with its highest bit set a negative number, as the vehicle holds it.

    Examples
    --------
    >>> own_bits(407551.0), own_bits(-22530.0), own_bits(2.0**24), own_bits(float("nan"))
    (407551, -22530, None, None)
    """
    if value is None or not abs(value) < _EXACT or value != int(value):
        return None
    return int(value)


class Notch(NamedTuple):
    """A notch of second order: its centre, one over its Q, and the gain that it leaves at the centre."""

    frequency_hz: float
    inverse_q: float
    depth: float


#: Where notches that move together stood at instants of a flight, of which each counts alike.
Places: TypeAlias = tuple[tuple[Notch, ...], ...]


class GyroFilter(NamedTuple):
    """The filters that the autopilot's parameters put between the gyro and the logged body rates.

    ``low_pass_hz`` is the cut-off of a low-pass of second order, NaN where there is
    none or it is not known. Each of ``tracked`` is a group of notches that moved in flight.
    """

    low_pass_hz: float = float("nan")
    notches: tuple[Notch, ...] = ()
    tracked: tuple[Places, ...] = ()


#: Where nothing is known of the filters.
NO_GYRO_FILTER: Final = GyroFilter()


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The rows of one message: when and where in the file; shared by all signals that are built from them.

    Attributes
    ----------
    time_s : ndarray, shape (n_samples,)
        When the values were *sampled*, on the log's main clock [s].
    position : ndarray of int64, shape (n_samples,)
        Byte offset of the row in the file (row number for a table).
    """

    time_s: FloatArray
    position: IntArray

    def __post_init__(self) -> None:
        if self.time_s.ndim != 1 or self.time_s.shape != self.position.shape:
            raise ShapeError(
                f"{self.time_s.shape} times and {self.position.shape} positions do not belong together."
            )
        _freeze(self, "time_s", "position")

    @property
    def n_samples(self) -> int:
        """Number of rows."""
        return int(self.time_s.shape[0])

    def __repr__(self) -> str:
        ends = f" from {self.time_s[0]:.4g} to {self.time_s[-1]:.4g} s" if self.n_samples else ""
        return f"<{type(self).__name__}: {self.n_samples}{ends}>"


def _freeze(owner: object, *names: str) -> None:
    """Replace arrays by views that cannot be written to."""
    for name in names:
        view = getattr(owner, name).view()
        view.flags.writeable = False
        object.__setattr__(owner, name, view)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signal:
    """One source of one canonical signal, exactly as logged.

    Nothing is sorted, merged or dropped: rows stand in file order, times may
    fall, repeat or be outliers. `align` deals with that, and needs the rows'
    positions to tell a reboot from an out-of-order row.

    Attributes
    ----------
    name : str
        Canonical name, a key of `vocabulary.SIGNALS`.
    rows : Rows
        Times and positions; one object for all signals of a message.
    values : ndarray, shape (n_samples, n_columns)
        In the unit, frame and sign that the vocabulary fixes.
    source : str
        The vendor's message and fields, for the reader of the report.
    reason : str
        Why this source has its place in the order of preference.
    nominal_rate_hz : float
        The rate that the log's settings promise, NaN where they do not say.
    gyro_filter : GyroFilter
        Of body rates: what they passed before they were logged.
    achieved : bool
        Of a torque: what the actuators did, saturation included, not what was commanded.
    raw : bool
        Of body rates: before every filter of the autopilot.
    """

    name: str
    rows: Rows
    values: FloatArray
    source: str
    reason: str = ""
    nominal_rate_hz: float = float("nan")
    gyro_filter: GyroFilter = NO_GYRO_FILTER
    achieved: bool = False
    raw: bool = False

    def __post_init__(self) -> None:
        if self.name not in SIGNALS:
            raise ShapeError(f"{self.name!r} is not a canonical signal name.")
        columns = len(SIGNALS[self.name].columns)
        if self.values.ndim != 2 or (columns and self.values.shape[1] != columns):
            raise ShapeError(f"{self.name} needs {columns or 'some'} columns, found {self.values.shape}.")
        if self.values.shape[0] != self.rows.n_samples:
            raise ShapeError(
                f"{self.name}: {self.values.shape} values do not fit {self.rows.n_samples} rows."
            )
        _freeze(self, "values")

    def __repr__(self) -> str:
        n_rows, n_columns = self.values.shape
        return f"<{type(self).__name__} {self.name}: {self.source!a}, {n_rows} rows of {n_columns}>"

    @property
    def time_s(self) -> FloatArray:
        """When each value was sampled [s]; shape (n_samples,)."""
        return self.rows.time_s

    @property
    def position(self) -> IntArray:
        """Byte offset of each row in the file; shape (n_samples,)."""
        return self.rows.position

    @property
    def n_samples(self) -> int:
        """Number of rows."""
        return self.rows.n_samples


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeChange:
    """The flight mode from `time_s` [s] on."""

    time_s: float
    position: int
    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterChange:
    """A parameter got another value at `time_s` [s]. Untrusted: escape the name before showing."""

    time_s: float
    position: int
    name: str
    value: float
    before: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControllerTerms:
    """What the log holds of one axis' rate controller beside its set-point, rate and output.

    Attributes
    ----------
    axis : str
        One of `vocabulary.AXES`.
    rows : Rows
        Of the message that they are logged in.
    values : mapping of str to ndarray, shape (n_samples,)
        "P", "I", "D", "FF": terms of the output [1]; "scale": the factor on P and D; "limited": 1 where the
        integrator was stopped; "derivative": the angular acceleration that D acts on [rad/s^2];
        "rate_forward": a rate about the vertical that is added to the attitude controller's [rad/s].
    """

    axis: str
    rows: Rows
    values: Mapping[str, FloatArray]


#: What `PositionRows` may hold.
POSITION_VALUES: Final = (
    "position_target",
    "position",
    "velocity_forward",
    "velocity_target",
    "velocity",
    "acceleration_forward",
    "acceleration_target",
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PositionRows:
    """What the log holds of the controllers of position and velocity along one direction.

    Attributes
    ----------
    direction : str
        "north", "east" or "down".
    rows : Rows
        Of the message that they are logged in.
    values : mapping of str to ndarray, shape (n_samples,)
        "position_target", "position" [m]; "velocity_forward", the set-point that is added behind the position
        controller, "velocity_target", "velocity" [m/s]; "acceleration_forward", "acceleration_target"
        [m/s^2], as far as the log has them. NaN where nothing is commanded.
    """

    direction: str
    rows: Rows
    values: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class LogText:
    """A text message of the autopilot. Untrusted: escape before showing."""

    time_s: float
    position: int
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LostBytes:
    """Bytes of the file that could not be read as messages."""

    offset: int
    n_bytes: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedSystem:
    """One vehicle or component that speaks in the file."""

    system_id: int
    component_id: int
    autopilot: str
    vehicle_type: str
    n_messages: int
    chosen: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageCount:
    """How often a message type occurs: what `info` lists."""

    name: str
    count: int
    rate_hz: float = float("nan")


@dataclass(frozen=True, slots=True, weakref_slot=True, kw_only=True, eq=False)
class FlightLog:
    """Everything that the later stages may know about a log file.

    Attributes
    ----------
    path : str
        As given by the user.
    format : str
        The name of one of the registered formats.
    dialect : str
        A variant of the format, "" for the ordinary one ("sdlog2").
    autopilot : str
        The name of one of the registered autopilots, "other" where the log names none.
    firmware, frame, vehicle_name : str
        As the log states them; untrusted text.
    vehicle_type : str
        One of `vocabulary.VEHICLE_TYPES`.
    signals : mapping of str to tuple of Signal
        All sources found per canonical name, the preferred one first.
    parameters : mapping of str to float
        The last value of each parameter.
    parameter_changes : tuple of ParameterChange
        In file order.
    controller_terms : tuple of ControllerTerms
        By axis and message.
    position_control : tuple of PositionRows
        By direction.
    n_bytes : int
        Size of the file [bytes].
    lost : tuple of LostBytes
        What could not be read. A header cut off at the file's end counts too.
    checksum_wrong : bool
        By its own checksum the file is not what was logged, wherever that may be.
    n_dropped : int
        Messages that the autopilot itself reports as not written.
    has_time : bool
        False where the log's rows carry no time at all.
    is_nominal_time : bool
        Then their times are those at which the firmware should have logged: good enough to look at.
    utc_offset_s : float
        UTC [s since 1970] minus the log's clock, NaN where no receiver told the date.
    remarks : tuple of str
        What the reader had to decide or assume, in plain words.
    followed : mapping of str to ndarray, shape (n_instants, n_columns)
        What the notches of an autopilot may follow, by the autopilot's own names, at instants of the flight
        of which each counts alike.
    swept_axes : tuple of str
        Axes that a system-identification mode of the autopilot swept; empty where the log names none.
    n_cells : int
        Of the battery, as the parameters state it; 0 where they do not.
    torque : TorqueModel, optional
        How torque follows from the logged outputs; None where nobody looked.
    """

    path: str
    format: str
    autopilot: str
    n_bytes: int
    signals: Mapping[str, tuple[Signal, ...]]
    dialect: str = ""
    firmware: str = ""
    vehicle_type: str = "unknown"
    vehicle_name: str = ""
    frame: str = ""
    hardware_id: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)
    parameter_changes: tuple[ParameterChange, ...] = ()
    controller_terms: tuple[ControllerTerms, ...] = ()
    position_control: tuple[PositionRows, ...] = ()
    modes: tuple[ModeChange, ...] = ()
    texts: tuple[LogText, ...] = ()
    lost: tuple[LostBytes, ...] = ()
    checksum_wrong: bool = False
    n_dropped: int = 0
    systems: tuple[LoggedSystem, ...] = ()
    n_systems: int = 0
    counts: tuple[MessageCount, ...] = ()
    has_time: bool = True
    is_nominal_time: bool = False
    utc_offset_s: float = float("nan")
    remarks: tuple[str, ...] = ()
    followed: Mapping[str, FloatArray] = field(default_factory=dict)
    swept_axes: tuple[str, ...] = ()
    n_cells: int = 0
    torque: TorqueModel | None = None

    @property
    def version(self) -> tuple[int, ...] | None:
        """The numbers of the firmware's version, most significant first; None where the log does not say."""
        return version_in(self.firmware)

    @property
    def may_be_multirotor(self) -> bool:
        """Whether the vehicle is one, or the log does not say what it is."""
        return self.vehicle_type in (MULTIROTOR, "unknown")

    @property
    def corrupt_bytes(self) -> int:
        """Sum of all lost bytes."""
        return sum(part.n_bytes for part in self.lost)

    def __repr__(self) -> str:
        signals = ", ".join(f"{name} ({len(sources)})" for name, sources in self.signals.items())
        return f"<{type(self).__name__} {self.path!a}: {self.format} of {self.autopilot}; {signals}>"

    def parameters_at(self, position: int) -> dict[str, float]:
        """Return the parameters as they were at a place in the file.

        Parameters
        ----------
        position : int
            Byte offset.

        Returns
        -------
        dict of str to float
        """
        found = dict(self.parameters)
        for change in reversed(self.parameter_changes):
            if change.position > position:
                found[change.name] = change.before
        return found

    def candidates(self, name: str) -> tuple[Signal, ...]:
        """Return the sources of a canonical signal, the preferred one first."""
        return tuple(self.signals.get(name, ()))
