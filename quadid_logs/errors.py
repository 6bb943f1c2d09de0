"""Every exception that quadid_logs raises on purpose.

::

    QuadidError
    ├── LogError                 the input file
    │   ├── LogNotFoundError     no such file, or not a regular readable file
    │   ├── UnknownFormatError   the content is not a recognised flight log
    │   ├── EmptyLogError        the right format, but nothing usable inside
    │   └── SeveralLogsError     several logs in one file, and none was selected
    ├── LinkError                the vehicle or the connection to it
    ├── SettingsError            an invalid setting or option (also ValueError)
    ├── VehicleFileError         the vehicle TOML is malformed
    ├── PromiseFileError         promise.json is malformed or missing
    ├── OutputError              the result cannot be written (exists, read-only, disk full)
    ├── SimulationError          a scenario that cannot be simulated
    └── ShapeError               arrays with shapes that do not match (also ValueError)

Bad *data* never raise an exception: they become a finding in the report. An exception reports an invalid call
or file, and its ``hint`` says what to do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence


class QuadidError(Exception):
    """Base of all errors of this package.

    Parameters
    ----------
    message : str
        What was expected and what was found.
    hint : str, optional
        What the user can do about it.

    Examples
    --------
    >>> from quadid_logs import QuadidError, read_log
    >>> try:
    ...     read_log("not-there.bin")
    ... except QuadidError as error:
    ...     print(error)
    There is no file not-there.bin. Check the path.
    """

    def __init__(self, message: str, *, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint

    def __str__(self) -> str:
        message = str(self.args[0]) if self.args else ""
        return f"{message} {self.hint}".strip()


class LogError(QuadidError):
    """The input file cannot be used."""


class LogNotFoundError(LogError):
    """There is no readable regular file at the path."""


class UnknownFormatError(LogError):
    """The content of the file is not a recognised flight log."""


class EmptyLogError(LogError):
    """The file has a known format but holds no usable message."""


class SeveralLogsError(LogError):
    """The file holds several logs, and none was selected.

    Parameters
    ----------
    message : str
        What was expected and what was found.
    hint : str
        What the user can do about it.
    logs : sequence of str
        One line of text for each log.
    durations_s : mapping of int to float
        Length of each log [s], by number.
    """

    def __init__(
        self, message: str, *, hint: str, logs: Sequence[str], durations_s: Mapping[int, float]
    ) -> None:
        super().__init__(message, hint=hint)
        self.logs = tuple(logs)
        self.durations_s = dict(durations_s)

    @property
    def longest(self) -> int:
        """Number of the longest log."""
        return max(self.durations_s, key=self.durations_s.__getitem__)


class LinkError(QuadidError):
    """The vehicle cannot be reached, refuses a request, or sends invalid data."""


class SettingsError(QuadidError, ValueError):
    """An option or setting is out of range or contradicts another."""


class PromiseFileError(QuadidError):
    """A promise file cannot be used."""


class VehicleFileError(QuadidError):
    """The vehicle file is malformed or lacks a needed value."""


class OutputError(QuadidError):
    """A result cannot be written."""


class SimulationError(QuadidError):
    """A scenario cannot be simulated with the given values."""


class ShapeError(QuadidError, ValueError):
    """Arrays do not have the shapes that the function needs."""
