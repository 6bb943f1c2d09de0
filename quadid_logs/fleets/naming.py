"""Which vehicle a log belongs to, of which model it is, and when it flew."""

from __future__ import annotations

import datetime
import math
import re
import time
from dataclasses import dataclass
from pathlib import PurePosixPath

from quadid_logs.autopilots import known, named
from quadid_logs.data.log import FlightLog
from quadid_logs.errors import SettingsError
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.vocabulary import MULTIROTOR

UNKNOWN = "unknown"
#: The file's time of modification, mostly that of its last copy: no evidence of when the log flew.
MODIFICATION = "modification"
#: Part of an id that is unique: the processor's, in words of hexadecimal digits.
_UNIQUE = re.compile(r"[0-9A-Fa-f]{16,}")
#: Clocks of computers differ by less than a day; a flight that is yet to come was dated by a clock that
#: nobody set, as an autopilot's without a receiver.
_DAY_S = 86_400.0
#: So many digits tell contents of the same name apart.
_SHORT = 8
_EMPTY = re.compile(r"[0 ]*")
_DATE = re.compile(
    r"(?<!\d)(20\d\d)(?P<dash>[-_.]?)(\d\d|(?<=[-_.])\d)(?P=dash)(\d\d|(?<=[-_.])\d)(?!\d)"
    r"(?:[-_.T /]{1,3}(\d\d)[-_.:h]?(\d\d)[-_.:m]?(\d\d)(?!\d))?"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class NamingRules:
    """Regular expressions, searched in the path or URL: the first group, or all that matches, is the name."""

    vehicle_from: str = ""
    model_from: str = ""

    def __post_init__(self) -> None:
        for option, pattern in (("--vehicle-from", self.vehicle_from), ("--model-from", self.model_from)):
            try:
                re.compile(pattern)
            except re.error as error:
                raise SettingsError(
                    f"{option} {pattern!r} is no regular expression: {error}.",
                    hint=r"An example: '/(quad-\d+)/'.",
                ) from error


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Name of the vehicle and what it was taken from, and the model it is compared within. Untrusted text."""

    vehicle: str
    vehicle_from: str
    model: str


def identify_unread(file: LogFile, rules: NamingRules) -> Identity:
    """Name the vehicle of a file that nothing could be read from."""
    vehicle = _match(rules.vehicle_from, file.url)
    return Identity(
        vehicle=vehicle or UNKNOWN,
        vehicle_from="path" if vehicle else "",
        model=_match(rules.model_from, file.url) or UNKNOWN,
    )


def identify_vehicle(log: FlightLog, file: LogFile, rules: NamingRules, sha256: str = "") -> Identity:
    """Name vehicle and model.

    The vehicle's name is, in this order: what ``vehicle_from`` finds in the
    path, the autopilot's unique hardware id, the craft name that the pilot
    gave it, its serial number (BRD_SERIAL_NUM), its MAVLink id where somebody
    set one, the folder. All but the first two may be those of several vehicles,
    so that autopilot, type, frame and airframe are part of the name. A log with
    nothing of that is a vehicle by itself: two of them may be two vehicles.
    The model is what ``model_from`` finds, otherwise autopilot and frame.

    Parameters
    ----------
    file : LogFile
        Where it lies.
    sha256 : str
        Of its content.
    """
    vehicle, taken_from = _vehicle(log, file, rules, sha256)
    kind = log.frame or (log.vehicle_type if log.vehicle_type != "unknown" else "vehicle of unknown type")
    described = f"{log.autopilot} {kind}"
    return Identity(
        vehicle=vehicle, vehicle_from=taken_from, model=_match(rules.model_from, file.url) or described
    )


def craft_name(log: FlightLog) -> str:
    """Return what the pilot called the vehicle, "" where the log does not say.

    Untrusted text. What tells the systems of a MAVLink log apart is a number, and no name.
    """
    return "" if log.systems else log.vehicle_name.strip()


def _vehicle(log: FlightLog, file: LogFile, rules: NamingRules, sha256: str) -> tuple[str, str]:
    """Return the first name that distinguishes vehicles."""
    if name := _match(rules.vehicle_from, file.url):
        return name, "path"
    words = log.hardware_id.replace("-", "").split()
    if _UNIQUE.search("".join(words[1:] or words)) and not _EMPTY.fullmatch("".join(words)):
        return log.hardware_id, "hardware id"
    if craft := craft_name(log):
        return f"{craft} ({_build(log)})", "craft name"
    for parameter in (name for autopilot in known() for name in autopilot.serial_parameters):
        if serial := log.parameters.get(parameter, 0.0):
            return f"serial {serial:.0f} ({_build(log)})", parameter
    for parameter in (name for autopilot in known() for name in autopilot.system_parameters):
        number = log.parameters.get(parameter, 1.0)
        if math.isfinite(number) and number != 1.0:
            return f"system {number:.0f} ({_build(log)})", parameter
    path = PurePosixPath(file.url.replace("\\", "/"))
    if path.parent.name:
        return f"{path.parent.name} ({_build(log)})", "folder"
    content = f", {sha256[:_SHORT]}" if sha256 else ""
    return f"{path.name or UNKNOWN}{content} ({_build(log)})", ""


def _build(log: FlightLog) -> str:
    """Say how a vehicle is built: two that differ in this are not one vehicle, whatever they are called."""
    airframe = next(
        (number for name in named(log.autopilot).airframe_parameters if (number := log.parameters.get(name))),
        math.nan,
    )
    called = f"airframe {airframe:.0f}" if math.isfinite(airframe) else ""
    parts = (
        log.autopilot,
        log.vehicle_type if log.vehicle_type not in ("unknown", MULTIROTOR if log.frame else "") else "",
        log.frame,
        # A frame that is not known otherwise is called by its number.
        "" if called in log.frame.split(", ") else called,
    )
    return " ".join(filter(None, parts))


def _match(pattern: str, url: str) -> str:
    """Return what a rule finds in a path, "" if nothing."""
    found = re.search(pattern, url) if pattern else None
    if found is None:
        return ""
    return next((group for group in found.groups() if group), found[0])


def clock_zero(log: FlightLog, start_s: float, file: LogFile) -> tuple[float, str]:
    """Return the UTC at zero of the log's clock and what says so.

    The date in a file's name is the local one of whoever wrote it; it is taken
    as UTC, which keeps the order of one vehicle's flights.

    Parameters
    ----------
    start_s : float
        Where the log begins on its clock [s].
    file : LogFile
        Where it lies.

    Returns
    -------
    zero_s : float
        UTC [s since 1970], NaN if nothing says it.
    taken_from : str
        "receiver", "file name", "modification", or "".
    """
    # NaN is not before anything either.
    if log.has_time and log.utc_offset_s + start_s < time.time() + _DAY_S:
        return log.utc_offset_s, "receiver"
    if date := _date_in(file.url):
        return date - start_s, "file name"
    if file.modified_s > 0.0:
        return file.modified_s - start_s, MODIFICATION
    return math.nan, ""


def number_in(url: str) -> int | None:
    """Return the number that the autopilot gave a log, where the last part of its path holds one.

    Returns
    -------
    int or None
        None where there is none, and where a date stands there.

    Examples
    --------
    >>> number_in("/logs/00000012.BIN"), number_in("/logs/2026-05-01/log_3.ulg"), number_in("/logs/a.bin")
    (12, 3, None)
    """
    stem = PurePosixPath(url.replace("\\", "/")).stem
    digits = [] if _date_in(stem) else re.findall(r"\d{1,12}", stem)
    return int(digits[-1]) if digits else None


def _date_in(url: str) -> float | None:
    """Find the last date in a path, with or without a time of day."""
    for match in reversed(list(_DATE.finditer(url))):
        try:
            parts = [int(part) for part in match.group(1, 3, 4, 5, 6, 7) if part]
            return datetime.datetime(*parts, tzinfo=datetime.UTC).timestamp()  # type: ignore[misc,arg-type]
        except ValueError:
            continue
    return None
