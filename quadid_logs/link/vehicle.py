"""A vehicle at the other end of a MAVLink link: who answers, whether it is armed, messages in and out."""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from quadid_logs import extra
from quadid_logs.errors import LinkError, SettingsError
from quadid_logs.untrusted import printable

_FORMS: Final = (
    "Give the address of a vehicle: a serial port (/dev/ttyACM0 or COM3, with @BAUD for the rate), "
    "udp:PORT to listen, udpout:HOST:PORT or tcp:HOST:PORT. Or give the folder of a mounted card."
)
_PORT = re.compile(r"(/dev/[^@]+|COM\d+)(?:@(\d{1,7}))?", re.IGNORECASE)
#: The rate of telemetry radios; on USB any value serves.
_BAUD: Final = 57_600
#: Ground station 255, as MAVLink's usage; the component keeps replies apart from those to another program.
_SYSTEM, _COMPONENT = 255, 191
#: MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID, MAV_STATE_ACTIVE and MAV_MODE_FLAG_SAFETY_ARMED of common.xml.
_GROUND_STATION, _NO_AUTOPILOT, _ACTIVE, _ARMED = 6, 8, 4, 128
_EVERY_S: Final = 1.0  # heartbeats: MAVLink's heartbeat protocol


@dataclass(frozen=True, slots=True, kw_only=True)
class Patience:
    """How long is waited: for a vehicle [s], for an answer [s], and how often a request is repeated."""

    heartbeat_s: float = 10.0
    answer_s: float = 0.7
    tries: int = 10


def device_of(address: str) -> tuple[str, int]:
    """Return an address as pymavlink writes it, and the baud rate.

    Returns
    -------
    device : str
    baud : int

    Raises
    ------
    SettingsError
        If it has none of the forms.

    Examples
    --------
    >>> device_of("udp:14550"), device_of("/dev/ttyUSB0@115200")
    (('udpin:0.0.0.0:14550', 57600), ('/dev/ttyUSB0', 115200))
    """
    serial = _PORT.fullmatch(address)
    if serial is not None:
        return serial[1], int(serial[2] or _BAUD)
    kind, _, rest = address.partition(":")
    host, colon, port = rest.rpartition(":")
    if (
        kind in {"udp", "udpin", "udpout", "tcp"}
        and port.isascii()
        and port.isdigit()
        and 0 < int(port) < 65536
    ):
        if kind in {"udp", "udpin"}:
            return f"udpin:{host or '0.0.0.0'}:{port}", _BAUD  # noqa: S104 - telemetry comes from another machine
        if colon and host:
            return f"{kind}:{host}:{port}", _BAUD
    raise SettingsError(f"{printable(address)} is not the address of a vehicle.", hint=_FORMS)


class Vehicle:
    """The first autopilot whose heartbeat arrives; a context manager.

    Parameters
    ----------
    address : str
    patience : Patience
    may_fly : bool
        Whether the vehicle may be armed.

    Raises
    ------
    LinkError
        If the link cannot be opened, or no autopilot is heard.
    """

    def __init__(self, address: str, patience: Patience | None = None, *, may_fly: bool = False) -> None:
        self.patience = patience or Patience()
        self._may_fly = may_fly
        #: As its last heartbeat says, which MAV_AUTOPILOT it is, and when that came [s, monotonic].
        self.armed, self.autopilot, self.heard_s = False, _NO_AUTOPILOT, -1.0
        self._address = printable(address)
        device, baud = device_of(address)
        os.environ.setdefault("MAVLINK20", "1")
        mavutil = extra.load("pymavlink.mavutil")
        if device.startswith(("/dev/", "COM")):
            extra.load("serial")
        with self._as_link_error():
            self._link: Any = mavutil.mavlink_connection(
                device, baud=baud, source_system=_SYSTEM, source_component=_COMPONENT, retries=1
            )
        # Else pymavlink prints a line for each attempt to read from a socket that is closed.
        self._link.handle_eof = self._link.handle_disconnect = self._closed
        self._beat_s = -_EVERY_S
        self._id: tuple[int, int] | None = None
        try:
            self._wait_for_heartbeat()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Vehicle:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the link."""
        with contextlib.suppress(Exception):
            self._link.close()

    @property
    def target(self) -> tuple[int, int]:
        """System and component that requests go to."""
        return self._id or (0, 0)

    def send(self, name: str, *fields: Any) -> None:
        """Send a message: its name in lower case and its fields in the order of the definition.

        Raises
        ------
        LinkError
            If the link is gone.
        """
        with self._as_link_error():
            getattr(self._link.mav, f"{name}_send")(*fields)

    def next(self, until_s: float) -> Any | None:
        """Return the autopilot's next message for us, None where none came until `until_s` (monotonic clock).

        Raises
        ------
        LinkError
            If the link is gone, or the vehicle is armed and must not be: a download loads its processor
            and its card.
        """
        while time.monotonic() < until_s:
            message = self._next()
            if message is None:
                continue
            if message.get_type() == "HEARTBEAT":
                self._note(message)
            elif self._id == (message.get_srcSystem(), message.get_srcComponent()) and (
                message.get_type() != "FILE_TRANSFER_PROTOCOL" or for_us(message)
            ):
                return message
        return None

    def _next(self) -> Any:
        """Return the next message, None if there was none for a moment."""
        now_s = time.monotonic()
        if now_s - self._beat_s >= _EVERY_S:
            self._beat_s = now_s
            self.send("heartbeat", _GROUND_STATION, _NO_AUTOPILOT, 0, 0, _ACTIVE)
        with self._as_link_error():
            message = self._link.recv_msg()
            if message is None:
                self._link.select(0.02)
            return message

    def _note(self, heartbeat: Any) -> None:
        """Take the first autopilot for the vehicle; refuse while it is armed."""
        sender = heartbeat.get_srcSystem(), heartbeat.get_srcComponent()
        if heartbeat.type == _GROUND_STATION or heartbeat.autopilot == _NO_AUTOPILOT:
            return
        self._id = self._id or sender
        if sender != self._id:
            return
        self.armed, self.autopilot = bool(heartbeat.base_mode & _ARMED), int(heartbeat.autopilot)
        self.heard_s = time.monotonic()
        if self.armed and not self._may_fly:
            raise LinkError(
                "The vehicle is armed: a download loads its processor and its card.",
                hint="Land, disarm, and run the command again.",
            )

    def _closed(self) -> None:
        raise LinkError(
            f"The other end closed the link {self._address}.",
            hint="Run the same command again: it continues where it stopped.",
        )

    def _wait_for_heartbeat(self) -> None:
        until_s = time.monotonic() + self.patience.heartbeat_s
        while self._id is None and time.monotonic() < until_s:
            message = self._next()
            if message is not None and message.get_type() == "HEARTBEAT":
                self._note(message)
        if self._id is None:
            raise LinkError(
                f"No autopilot answers at {self._address}.",
                hint="Check cable, power and baud rate, and close other programs that use the port.",
            )

    @contextlib.contextmanager
    def _as_link_error(self) -> Iterator[None]:
        """Turn what sockets, ports and the parser raise into one line."""
        try:
            yield
        except LinkError:
            raise
        except Exception as error:  # pymavlink raises whatever the system and the bytes cause
            raise LinkError(
                f"The link {self._address} failed: {printable(error) or type(error).__name__}.",
                hint="Check address, cable and permissions. The same command continues where it stopped.",
            ) from error


def for_us(message: Any) -> bool:
    """Return whether a message is addressed to us: another ground station may be served at the same time."""
    return message.target_system in {0, _SYSTEM} and message.target_component in {0, _COMPONENT}
