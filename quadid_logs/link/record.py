"""Record the log that a vehicle streams while it flies: a file as the vehicle would write it to its card."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO, Final, Generic, TypeVar

from quadid_logs.errors import LinkError, OutputError
from quadid_logs.link.block_stream import BlockStream
from quadid_logs.link.losses import Losses
from quadid_logs.link.ulog_stream import ULogStream, begins_log
from quadid_logs.link.vehicle import Vehicle, for_us
from quadid_logs.output import check_no_link, make_folder
from quadid_logs.untrusted import printable

#: MAV_AUTOPILOT of common.xml.
_BY_BLOCKS, _BY_FRAMES = 3, 12
#: MAV_CMD_LOGGING_START and _STOP; MAV_RESULT of their acknowledgement.
_START, _STOP = 2510, 2511
_ACCEPTED, _BUSY, _IN_PROGRESS = 0, 1, 5
#: MAV_REMOTE_LOG_DATA_BLOCK_COMMANDS and _STATUSES.
_STOP_BLOCKS, _START_BLOCKS = 2147483645, 2147483646
_NACK, _ACK = 0, 1
_KIND: Final = b"LOG_BACKEND_TYPE"
_MAVLINK_BIT: Final = 2
#: A block 0 beyond this many is of a new log: no vehicle keeps so many that it could be sent once more.
_MOST_KEPT: Final = 600
#: The file is flushed so often [s].
_FLUSH_S: Final = 1.0
#: What was logged before disarming arrives within this time [s].
_LANDED_S: Final = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordPatience:
    """How long is waited [s]: for a stream to start and stop, for data, and for a vehicle that is gone."""

    command_s: float = 5.0
    silence_s: float = 5.0
    gone_s: float = 60.0
    tries: int = 4


@dataclass(slots=True, kw_only=True)
class RecordState:
    """What a recording has so far, for those who watch it.

    Attributes
    ----------
    path : Path or None
        Of the file that is written.
    n_bytes : int
        From its beginning, that will not change any more: whole messages.
    paths : list of Path
        Of all files; more than one where the vehicle began its log anew.
    armed, was_armed : bool
    losses : Losses
    """

    path: Path | None = None
    n_bytes: int = 0
    paths: list[Path] = field(default_factory=list)
    armed: bool = False
    was_armed: bool = False
    losses: Losses = field(default_factory=Losses)


_Stream = TypeVar("_Stream", ULogStream, BlockStream)


class _Driver(ABC, Generic[_Stream]):
    """One of the two protocols, and the stream of the log that it brings; ``suffix`` is that of the file."""

    suffix: str

    def __init__(
        self, vehicle: Vehicle, patience: RecordPatience, losses: Losses, new_file: Callable[[], BinaryIO]
    ) -> None:
        self._vehicle, self._patience, self._losses = vehicle, patience, losses
        self._new_file = new_file
        self._stream: _Stream | None = None

    @abstractmethod
    def start(self, now_s: float) -> None:
        """Ask the vehicle to stream."""

    @abstractmethod
    def take(self, message: Any, now_s: float) -> None:
        """Take a message, answer it."""

    @abstractmethod
    def tick(self, now_s: float) -> None:
        """Do what time asks for."""

    @abstractmethod
    def finish(self) -> None:
        """Ask for what is missing, and end the stream."""

    def close(self, now_s: float) -> None:
        """End the file."""
        if self._stream is not None:
            self._stream.close(now_s)

    @property
    def n_bytes(self) -> int:
        """Bytes that will not change any more."""
        return 0 if self._stream is None else self._stream.n_bytes

    def _say_another_log(self) -> None:
        self._losses.events.append("The vehicle started a new log, which is recorded in another file.")


class Recorder:
    """A recording; `run` does it, and another thread may read `state` meanwhile.

    Parameters
    ----------
    vehicle : Vehicle
        That may fly.
    folder : Path
    patience : RecordPatience, optional

    Raises
    ------
    LinkError
        If this autopilot streams no log.
    OutputError
        If the folder cannot be made.
    """

    def __init__(self, vehicle: Vehicle, folder: Path, patience: RecordPatience | None = None) -> None:
        check_no_link(folder)
        make_folder(folder)
        self.state = RecordState(armed=vehicle.armed)
        self._vehicle, self._folder = vehicle, folder
        self._patience = patience or RecordPatience()
        self._file: BinaryIO | None = None
        self._begun = datetime.now(UTC)
        if vehicle.autopilot == _BY_FRAMES:
            self._driver: _Driver[Any] = _ByFrames(vehicle, self._patience, self.state.losses, self._new_file)
        elif vehicle.autopilot == _BY_BLOCKS:
            self._driver = _ByBlocks(vehicle, self._patience, self.state.losses, self._new_file)
        else:
            raise LinkError(
                "This autopilot cannot stream its log over MAVLink.",
                hint="Fly, then use `quadid-log fetch` on its card.",
            )

    def run(self, done: threading.Event, tell: Callable[[str], None] = lambda _: None) -> None:
        """Record until the vehicle was armed and is disarmed again, the link is gone, or `done` is set.

        Parameters
        ----------
        tell : callable
            Called with a sentence where something happens.

        Raises
        ------
        LinkError
            If the vehicle does not stream; not for a link that is lost later, which ends the recording.
        OutputError
            If the file cannot be written.
        """
        losses = self.state.losses
        try:
            self._driver.start(time.monotonic())
            # Take messages until the end.
            flushed_s, disarmed_s, n_told = 0.0, float("inf"), 0
            while not done.is_set():
                message = self._vehicle.next(time.monotonic() + 0.02)
                now_s = time.monotonic()
                if message is not None:
                    self._driver.take(message, now_s)
                self._driver.tick(now_s)
                state = self.state
                if state.armed != self._vehicle.armed:
                    state.armed = self._vehicle.armed
                    state.was_armed |= state.armed
                    disarmed_s = float("inf") if state.armed else now_s
                for event in state.losses.events[n_told:]:
                    tell(event)
                n_told = len(state.losses.events)
                if self._file is not None and now_s - flushed_s > _FLUSH_S:
                    flushed_s = now_s
                    self._file.flush()
                    state.n_bytes = self._driver.n_bytes
                if state.was_armed and now_s - disarmed_s > _LANDED_S:
                    break
                if now_s - self._vehicle.heard_s > self._patience.gone_s:
                    raise LinkError(f"the vehicle was not heard for {self._patience.gone_s:.0f} s.")
            self._driver.finish()
        except LinkError as error:
            if not self.state.paths:
                raise
            losses.events.append(f"The recording ended early: {error}")
        except OSError as error:
            raise OutputError(
                f"{printable(self.state.path or self._folder)} cannot be written: {error.strerror or error}.",
                hint="The file up to that point is a complete log.",
            ) from error
        finally:
            self._close()
        if not self.state.paths:
            raise LinkError(
                "The vehicle sent no log.",
                hint="Many vehicles log only while they are armed. See docs/live.md for what to set.",
            )

    def _new_file(self) -> BinaryIO:
        """End the file, and open the next one: a new one, never through a link."""
        self._close()
        count = len(self.state.paths) + 1
        name = f"live-{self._begun:%Y-%m-%d-%H%M%S}{'' if count == 1 else f'-{count}'}{self._driver.suffix}"
        path = self._folder / name
        try:
            number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o644)
        except OSError as error:
            raise OutputError(
                f"{printable(path)} cannot be written: {error.strerror or error}.", hint="Choose another -o."
            ) from error
        self._file = os.fdopen(number, "r+b")
        self.state.path, self.state.n_bytes = path, 0
        self.state.paths.append(path)
        return self._file

    def _close(self) -> None:
        """End the file; one without a message is removed."""
        if self._file is None:
            return
        file, self._file = self._file, None
        with file:
            self._driver.close(time.monotonic())
            self.state.n_bytes = self._driver.n_bytes
            with contextlib.suppress(OSError):
                file.flush()
                os.fsync(file.fileno())
        if not self.state.n_bytes:
            self.state.paths.pop().unlink(missing_ok=True)


class _ByFrames(_Driver[ULogStream]):
    """Frames as they come, those of the header acknowledged one by one; nothing is sent twice later."""

    suffix = ".ulg"

    def __init__(
        self, vehicle: Vehicle, patience: RecordPatience, losses: Losses, new_file: Callable[[], BinaryIO]
    ) -> None:
        super().__init__(vehicle, patience, losses, new_file)
        self._sent_s, self._tries, self._data_s = 0.0, 0, 0.0
        self._accepted = self._stopped = self._said_silence = False
        self._begun_s = 0.0

    def start(self, now_s: float) -> None:
        if self._vehicle.armed:
            raise LinkError(
                "The vehicle is armed: beginning a log stream would block its logger.",
                hint="Start `quadid-log live` before arming.",
            )
        self._sent_s, self._tries = now_s, self._tries + 1
        self._command(_START)

    def take(self, message: Any, now_s: float) -> None:
        kind = message.get_type()
        if kind == "COMMAND_ACK":
            command = int(message.command)
            result = int(message.result)
            if command == _STOP:
                self._stopped = True
            elif command == _START and result in {_ACCEPTED, _IN_PROGRESS}:
                self._accepted = True
            elif command == _START and self._stream is None:
                if result != _BUSY:
                    raise LinkError(
                        f"The vehicle refuses to stream its log (MAV_RESULT {result}).",
                        hint="Enable logging over MAVLink on the vehicle: see docs/live.md.",
                    )
                # A stream whose stop was lost is still on.
                self._begin_again(now_s)
        elif kind in {"LOGGING_DATA", "LOGGING_DATA_ACKED"}:
            if not for_us(message):
                self._losses.foreign += 1
                return
            if kind == "LOGGING_DATA_ACKED":
                self._vehicle.send("logging_ack", *self._vehicle.target, message.sequence)
            self._take_frame(message, now_s)

    def tick(self, now_s: float) -> None:
        if self._stream is not None:
            self._stream.expire(now_s)
            self._restart_if_silent(now_s)
        elif now_s - self._sent_s > self._patience.command_s:
            self._begin_again(now_s)

    def finish(self) -> None:
        """Stop the stream; a stop that nobody confirms is said, for the next start would have no header."""
        for _ in range(self._patience.tries):
            self._command(_STOP)
            until_s = time.monotonic() + self._patience.command_s / self._patience.tries
            while not self._stopped and (message := self._vehicle.next(until_s)) is not None:
                self.take(message, time.monotonic())
            if self._stopped:
                return
        self._losses.events.append(
            "The vehicle did not confirm the end of the stream. It may continue to stream until it restarts."
        )

    def _take_frame(self, message: Any, now_s: float) -> None:
        data, first = bytes(message.data)[: message.length], int(message.first_message_offset)
        if message.length > len(message.data) or not data:
            self._losses.senseless += 1
            return
        number = int(message.sequence)
        # The first frame may come twice; that of another log follows another start.
        if begins_log(data, first) and (self._stream is None or self._sent_s > self._begun_s):
            if self._stream is not None:
                self._say_another_log()
            self._stream, self._begun_s = ULogStream(self._new_file(), self._losses), now_s
        if self._stream is None:
            # In the middle of a stream that an earlier recording left on.
            if now_s - self._sent_s > 0.4 * self._patience.command_s:
                self._begin_again(now_s)
            return
        self._data_s, self._tries, self._said_silence = now_s, 0, False
        self._stream.take(number, data, first, now_s)

    def _begin_again(self, now_s: float) -> None:
        """Stop a stream that may be on, and start it."""
        if self._tries >= self._patience.tries:
            raise LinkError(
                "Another program records this vehicle's log."
                if self._losses.foreign
                else "The vehicle does not begin to stream its log.",
                hint="Close other recorders and ground stations that stream the log, or restart the vehicle.",
            )
        self._command(_STOP)
        self.start(now_s)

    def _restart_if_silent(self, now_s: float) -> None:
        """Start the stream again after a restart of the vehicle, but never in flight."""
        patience = self._patience
        is_heard = now_s - self._vehicle.heard_s < patience.silence_s
        if now_s - max(self._data_s, self._sent_s) < patience.silence_s or not is_heard:
            return
        if not self._said_silence:
            self._said_silence = True
            self._losses.events.append(f"No log data came for {patience.silence_s:.0f} s.")
        if not self._vehicle.armed and self._tries < patience.tries:
            self._command(_STOP)
            self.start(now_s)

    def _command(self, number: int) -> None:
        self._vehicle.send("command_long", *self._vehicle.target, number, 0, 0, 0, 0, 0, 0, 0, 0)


class _ByBlocks(_Driver[BlockStream]):
    """Blocks, each acknowledged, and requested again where it is missing."""

    suffix = ".bin"

    def __init__(
        self, vehicle: Vehicle, patience: RecordPatience, losses: Losses, new_file: Callable[[], BinaryIO]
    ) -> None:
        super().__init__(vehicle, patience, losses, new_file)
        self._begun_s = self._sent_s = self._data_s = self._checked_s = 0.0

    def start(self, now_s: float) -> None:
        self._begun_s = now_s
        self._vehicle.send("param_request_read", *self._vehicle.target, _KIND, -1)
        self._ask(now_s)

    def take(self, message: Any, now_s: float) -> None:
        kind = message.get_type()
        if kind == "PARAM_VALUE":
            self._take_kind(message)
        elif kind == "REMOTE_LOG_DATA_BLOCK":
            if for_us(message):
                self._take_block(int(message.seqno), bytes(message.data), now_s)
            else:
                self._losses.foreign += 1

    def tick(self, now_s: float) -> None:
        if now_s - max(self._data_s, self._sent_s) > 0.2 * self._patience.command_s:
            self._ask(now_s)
        if self._stream is None:
            if self._losses.foreign and now_s - self._begun_s > self._patience.command_s:
                raise LinkError("Another program records this vehicle's log.", hint="Close it.")
            return
        if now_s - self._checked_s > 0.05:
            self._checked_s = now_s
            for number in self._stream.wanted(now_s):
                self._answer(number, _NACK)

    def finish(self) -> None:
        """Wait a moment for what is missing, and end the stream: three times, for nothing confirms it."""
        until_s = time.monotonic() + 0.2 * self._patience.command_s
        while self._stream is not None and not self._stream.is_whole and time.monotonic() < until_s:
            message = self._vehicle.next(time.monotonic() + 0.05)
            if message is not None:
                self.take(message, time.monotonic())
            for number in self._stream.wanted(time.monotonic()):
                self._answer(number, _NACK)
        for _ in range(3):
            self._answer(_STOP_BLOCKS, _ACK)

    def _take_kind(self, message: Any) -> None:
        """Say at once where the vehicle does not log over MAVLink."""
        name, value = message.param_id, message.param_value
        if name.encode(errors="replace") != _KIND or not 0 <= value < 1 << 16:
            return
        if self._stream is None and not int(value) & _MAVLINK_BIT:
            raise LinkError(
                f"LOG_BACKEND_TYPE is {int(value)}: the vehicle does not log over MAVLink.",
                hint=(
                    f"Set it to {int(value) | _MAVLINK_BIT}, restart the vehicle, and run this command again."
                ),
            )

    def _take_block(self, number: int, data: bytes, now_s: float) -> None:
        is_new = self._stream is None
        if self._stream is not None and number == 0 and self._stream.n_blocks > _MOST_KEPT:
            # After a pause only: earlier it is a block whose acknowledgement was lost.
            is_new = now_s - self._data_s > 0.2 * self._patience.command_s
        if is_new:
            if number >= _MOST_KEPT:
                # In the middle of a log that an earlier recording left on: end it.
                self._answer(_STOP_BLOCKS, _ACK)
                return
            if self._stream is not None:
                self._say_another_log()
            self._stream = BlockStream(self._new_file(), self._losses)
        if self._stream is not None and self._stream.take(number, data, now_s):
            self._data_s = now_s
            self._answer(number, _ACK)

    def _ask(self, now_s: float) -> None:
        """Ask for the log; a vehicle that sends it already goes on as it is."""
        self._sent_s = now_s
        self._answer(_START_BLOCKS, _ACK)

    def _answer(self, number: int, status: int) -> None:
        self._vehicle.send("remote_log_block_status", *self._vehicle.target, number, status)
