"""What differs between the firmware that logs with Blackbox: its name, its fields, and their scales."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeAlias

from quadid_logs.arrays import BoolArray
from quadid_logs.autopilots.betaflight.header_names import with_later_names
from quadid_logs.autopilots.betaflight.law import named_gains
from quadid_logs.autopilots.betaflight.signals import SOURCES, Facts
from quadid_logs.autopilots.sources import Source
from quadid_logs.containers.blackbox import FrameTable, is_mine
from quadid_logs.containers.blackbox_header import Header
from quadid_logs.data.log import version_in

Version: TypeAlias = tuple[int, ...]

#: "Betaflight 2025.12.2 (79065c96b) STM32F7X2"; firmware of the same family writes its own name there.
_REVISION: Final = re.compile(r"\s*(\w{1,20})\s+(\d\S{0,30})(.{0,80})")
#: Until 2016 the revision was that of the source alone.
_SOURCE: Final = re.compile(r"\s*([0-9a-f]{6,40})\b")
_LINE: Final = re.compile(rb"H Firmware (type|revision):([^\n]{0,200})\n")
_NUMBER: Final = re.compile(r"-?\d{1,10}(?:\.\d{1,10})?$")


class Firmware(NamedTuple):
    """What a header calls its firmware.

    Attributes
    ----------
    name : str
        Empty where it names none.
    title : str
        Name and version as shown.
    """

    name: str
    title: str

    @property
    def version(self) -> Version | None:
        """The numbers of its version; None where it does not tell them."""
        return version_in(self.title)


def firmware_of(texts: Mapping[str, str]) -> Firmware:
    """Return name and version of the firmware that wrote a header.

    Its type where the revision holds no name. All of the family called their type Cleanflight until 4.3.
    """
    revision, kind = texts.get("Firmware revision", ""), texts.get("Firmware type", "")
    if match := _REVISION.match(revision):
        return Firmware(match[1], f"{match[1]} v{match[2]}{match[3]}".strip())
    if match := _SOURCE.match(revision):
        name = re.match(r"\s*(\w{0,20})", kind)
        return Firmware(name[1], f"{name[1]} {match[1]}".strip()) if name else Firmware("", match[1])
    # Without a version that can be read; firmware calls its own type so since 4.3.
    words = revision.split(maxsplit=1) or kind.split(maxsplit=1)
    name = re.match(r"\w{1,20}", words[0]) if words else None
    return Firmware(name[0], name[0]) if name else Firmware("", "")


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """How a firmware logs with Blackbox.

    Attributes
    ----------
    autopilot : str
        As in `FlightLog.autopilot`.
    name : str
        As the header calls the firmware.
    sources : tuple of Source
    fields : tuple of str
        Of main frames: all that `sources` are made of.
    unfiltered : str
        Field of the gyro before its filters.
    settings : callable
        From the numbers of a header, and the version, to settings by the names of Betaflight.
    facts : callable
        As `Facts.of`.
    """

    autopilot: str
    name: str
    sources: tuple[Source[Any], ...]
    fields: tuple[str, ...]
    unfiltered: str = "gyroUnfilt"
    settings: Callable[[Mapping[str, float], Version | None], dict[str, float]]
    facts: Callable[[Header, Mapping[str, float], Version | None, FrameTable, BoolArray], Facts]

    def is_mine(self, head: bytes) -> bool:
        """Tell whether a file that begins with these bytes is a Blackbox file of this firmware.

        By the first header.
        """
        if not is_mine(head):
            return False
        lines = {
            f"Firmware {m[1].decode()}": m[2].decode("ascii", "replace")
            for m in reversed([*_LINE.finditer(head)])
        }
        return firmware_of(lines).name == self.name

    def fields_of(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return which of the fields of a frame are needed.

        Where set-points are logged, sticks only of roll and pitch, which may ask for angles.
        """
        unused = ("rcCommand[2]", "rcCommand[3]") if "setpoint[0]" in names else ()
        return tuple(name for name in self.fields if name not in unused)


def numbered(field: str, count: int = 8) -> tuple[str, ...]:
    """Return the names of a field that is logged for each motor."""
    return tuple(f"{field}[{number}]" for number in range(count))


def fields_of(sources: tuple[Source[Any], ...]) -> tuple[str, ...]:
    """Return what the builders of a table take: its fields, and those that are numbered by motor."""
    named = (field for source in sources for field in (*source.fields, *source.optional))
    return (*named, *numbered("motor"), *numbered("eRPM"))


def settings_of(texts: Mapping[str, str]) -> dict[str, float]:
    """Return the numbers of a header; those of a list by name and place, as ``rollPID[0]``."""
    found: dict[str, float] = {}
    for name, text in texts.items():
        if name.startswith("Field "):
            continue
        cells = [cell.strip() for cell in text.split(",")]
        if all(map(_NUMBER.match, cells)):
            names = [name] if len(cells) == 1 else [f"{name}[{k}]" for k in range(len(cells))]
            found |= dict(zip(names, map(float, cells), strict=True))
    return found


def common_settings(settings: Mapping[str, float], version: Version | None) -> dict[str, float]:
    """Return settings under the names of later versions, with the gains by those of the command line."""
    found = with_later_names(settings, version)
    return found | named_gains(found)


BETAFLIGHT: Final = Dialect(
    autopilot="betaflight",
    name="Betaflight",
    sources=SOURCES,
    fields=fields_of(SOURCES),
    settings=common_settings,
    facts=Facts.of,
)
