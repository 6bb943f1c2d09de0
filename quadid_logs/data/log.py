"""Results of a reader: the log's signals by canonical name, in file order."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple, TypeAlias

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.data.torque import TorqueModel
from quadid_logs.errors import ShapeError
from quadid_logs.vocabulary import MULTIROTOR, SIGNALS

#: Smaller whole numbers are exact in single precision.
_EXACT: Final = 2.0**24
#: As autopilots write it after their name: "V4.5.7 (2a3dc4b7)", "v1.15.0-beta", "V3.4-rc2".
_VERSION: Final = re.compile(r"\b[Vv](\d{1,4})\.(\d{1,4})(?:\.(\d{1,4}))?")


def version_in(firmware: str) -> tuple[int, ...] | None:
    """Return the numbers of a firmware version.

    Parameters
    ----------
    firmware : str
        Name and version as logged.

    Returns
    -------
    tuple of int or None
        Numbers, the most significant first; None if the text has no version.

    Examples
    --------
    >>> version_in("v1.15.0-beta"), version_in("master")
    ((1, 15, 0), None)
    """
    match = _VERSION.search(firmware)
    return tuple(int(number) for number in match.groups() if number) if match else None


def whole_number(value: float | None, otherwise: int = 0) -> int:
    """Return a parameter as a whole number.

    Parameters
    ----------
    value : float or None
    otherwise : int
        Result for a missing parameter, or for a value of a damaged log that does not fit into 32 bits.

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
    """Return a bit mask from its logged value, None if single precision may have lost bits.

    Parameters
    ----------
    value : float or None
        The value as logged, in single precision.

    Returns
    -------
    int or None
        The mask; negative if its highest bit is set, as in the vehicle.

    Examples
    --------
    >>> own_bits(407551.0), own_bits(-22530.0), own_bits(2.0**24), own_bits(float("nan"))
    (407551, -22530, None, None)
    """
    if value is None or not abs(value) < _EXACT or value != int(value):
        return None
    return int(value)


class Notch(NamedTuple):
    """A second-order notch filter: centre frequency [Hz], 1/Q, and gain at the centre."""

    frequency_hz: float
    inverse_q: float
    depth: float


#: Positions of notches that move together, at instants of a flight with equal weight.
Places: TypeAlias = tuple[tuple[Notch, ...], ...]


class GyroFilter(NamedTuple):
    """The filters between the gyro and the logged body rates, from the autopilot's parameters.

    ``low_pass_hz`` is the cut-off of a second-order low-pass filter [Hz], NaN if there is none or it is not
    known. ``notches`` have a fixed frequency. ``tracked`` holds groups of notches that moved in flight.
    """

    low_pass_hz: float = float("nan")
    notches: tuple[Notch, ...] = ()
    tracked: tuple[Places, ...] = ()


#: For logs with unknown filters.
NO_GYRO_FILTER: Final = GyroFilter()


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The rows of one message: time and position in the file, shared by all signals of the message.

    Attributes
    ----------
    time_s : ndarray, shape (n_samples,)
        Times at which the values were *sampled*, on the log's main clock [s].
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
    """Replace arrays by read-only views."""
    for name in names:
        view = getattr(owner, name).view()
        view.flags.writeable = False
        object.__setattr__(owner, name, view)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Signal:
    """One source of one canonical signal, exactly as logged.

    Nothing is sorted, merged or dropped. Rows are in file order; times may decrease, repeat or be outliers.
    `align` handles these cases. It needs the positions of the rows to distinguish a reboot from a row out of
    order.

    Attributes
    ----------
    name : str
        Canonical name, a key of `vocabulary.SIGNALS`.
    rows : Rows
        Times and positions; one object for all signals of a message.
    values : ndarray, shape (n_samples, n_columns)
        Values in the unit, frame and sign of `vocabulary.SIGNALS`.
    source : str
        The vendor's message and fields, as shown in the report.
    reason : str
        Reason for the rank of this source in the order of preference.
    nominal_rate_hz : float
        Sample rate according to the log's settings [Hz], NaN if not known.
    gyro_filter : GyroFilter
        For body rates: their filters before logging.
    achieved : bool
        For a torque: whether it is the achieved torque, including saturation, and not the commanded torque.
    raw : bool
        For body rates: whether they were logged before all filters of the autopilot.
    normalised : bool
        For a torque command: whether 1 is the end of its range.
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
    normalised: bool = True

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
        """Sample time of each value [s]; shape (n_samples,)."""
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
    """The change of a parameter at `time_s` [s]. Untrusted: escape the name before showing."""

    time_s: float
    position: int
    name: str
    value: float
    before: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControllerTerms:
    """Logged internal values of one axis' rate controller, in addition to set-point, rate and output.

    Attributes
    ----------
    axis : str
        One of `vocabulary.AXES`.
    rows : Rows
        Rows of the message with the values.
    values : mapping of str to ndarray, shape (n_samples,)
        "P", "I", "D", "FF": terms of the output [1]; "scale": the factor on P and D; "limited": 1 while the
        integrator was stopped; "derivative": the angular acceleration that D acts on [rad/s^2];
        "rate_forward": a rate about the vertical, added to that of the attitude controller [rad/s].
    """

    axis: str
    rows: Rows
    values: Mapping[str, FloatArray]


#: Possible keys of `PositionRows.values`.
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
    """Logged values of the position and velocity controllers along one direction.

    Attributes
    ----------
    direction : str
        "north", "east" or "down".
    rows : Rows
        Rows of the message with the values.
    values : mapping of str to ndarray, shape (n_samples,)
        "position_target", "position" [m]; "velocity_forward" (a set-point added to the output of the position
        controller), "velocity_target", "velocity" [m/s]; "acceleration_forward", "acceleration_target"
        [m/s^2], as far as they are logged. NaN without a command.
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
    """One vehicle or component with messages in the file."""

    system_id: int
    component_id: int
    autopilot: str
    vehicle_type: str
    n_messages: int
    chosen: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageCount:
    """Number and rate [Hz] of one type of message, as listed by `info`."""

    name: str
    count: int
    rate_hz: float = float("nan")


@dataclass(frozen=True, slots=True, weakref_slot=True, kw_only=True, eq=False)
class FlightLog:
    """A log file as read: the input of all later stages.

    Attributes
    ----------
    path : str
        Path as given by the user.
    format : str
        Name of a registered format.
    dialect : str
        Variant of the format ("sdlog2"), "" for the standard format.
    autopilot : str
        Name of a registered autopilot; "other" if the log names none.
    firmware, frame, vehicle_name : str
        Texts of the log. Untrusted: escape before showing.
    vehicle_type : str
        One of `vocabulary.VEHICLE_TYPES`.
    signals : mapping of str to tuple of Signal
        All sources by canonical name, the preferred source first.
    parameters : mapping of str to float
        The last value of each parameter.
    parameter_changes : tuple of ParameterChange
        Changes in file order.
    controller_terms : tuple of ControllerTerms
        Values by axis and message.
    position_control : tuple of PositionRows
        Values by direction.
    n_bytes : int
        Size of the file [bytes].
    lost : tuple of LostBytes
        Unreadable bytes, including a header cut off at the end of the file.
    checksum_wrong : bool
        Whether the checksum of the file is wrong: some byte of it changed after logging.
    n_dropped : int
        Number of messages that the autopilot reports as not written.
    has_time : bool
        False if the rows of the log have no time.
    is_nominal_time : bool
        Whether the times are those at which the firmware should have logged. They are suitable for display
        only.
    utc_offset_s : float
        UTC [s since 1970] minus the log's clock; NaN if the log has no date.
    remarks : tuple of str
        Decisions and assumptions of the reader, in plain words.
    followed : mapping of str to ndarray, shape (n_instants, n_columns)
        Quantities that the autopilot's notches may follow, by the autopilot's names, at instants of the
        flight with equal weight.
    swept_axes : tuple of str
        Axes swept by a system-identification mode of the autopilot; empty if the log names none.
    n_cells : int
        Number of battery cells according to the parameters; 0 if not given.
    torque : TorqueModel, optional
        The model from logged outputs to torque; None if not yet determined.
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
        """Numbers of the firmware version, the most significant first; None if not logged."""
        return version_in(self.firmware)

    @property
    def may_be_multirotor(self) -> bool:
        """Whether the vehicle is a multirotor, or of unknown type."""
        return self.vehicle_type in (MULTIROTOR, "unknown")

    @property
    def corrupt_bytes(self) -> int:
        """Total number of lost bytes."""
        return sum(part.n_bytes for part in self.lost)

    def __repr__(self) -> str:
        signals = ", ".join(f"{name} ({len(sources)})" for name, sources in self.signals.items())
        return f"<{type(self).__name__} {self.path!a}: {self.format} of {self.autopilot}; {signals}>"

    def parameters_at(self, position: int) -> dict[str, float]:
        """Return the parameters at a position of the file.

        Parameters
        ----------
        position : int
            Byte offset in the file.

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
        """Return the sources of a canonical signal, the preferred source first."""
        return tuple(self.signals.get(name, ()))
