"""``quadid-log live``: record the log that a vehicle streams, and analyze it after landing."""

from __future__ import annotations

import json
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from quadid_logs.cli.failure import flush, report_problem, say
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from quadid_logs.link.record import Recorder, RecordPatience, RecordState

_EVERY_S: Final = 1.0
#: How long the vehicle, and its stream, are waited for; None: as `RecordPatience` has it. Tests have less.
_PATIENCE: RecordPatience | None = None


def live(
    context: typer.Context,
    address: Annotated[
        str,
        typer.Argument(
            metavar="ADDRESS",
            help="Serial port (/dev/ttyACM0, COM3@921600), udp:14550, udpout:HOST:PORT or tcp:HOST:PORT.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the recorded log.")
    ] = Path("logs"),
    no_analyze: Annotated[
        bool, typer.Option("--no-analyze", help="Record only; analyze the log later.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print a line of JSON for each update and event.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the report of an earlier run.")] = False,
) -> int:
    """Record the log that a vehicle streams while it flies; after landing, analyze it.

    Start it before arming. It ends after disarming, or with Ctrl-C. Exit code:
    that of analyze; 2: no vehicle, or no log.
    """
    from quadid_logs.link.record import Recorder
    from quadid_logs.link.vehicle import Vehicle

    teller = _Teller(as_json=as_json)
    with Vehicle(address, may_fly=True) as vehicle:
        recorder = Recorder(vehicle, output, _PATIENCE)
        _record(recorder, teller)
    state = recorder.state
    for sentence in state.losses.sentences():
        teller.event(sentence)
    for path in state.paths:
        teller.recorded(path)
    if no_analyze:
        return 0
    from quadid_logs.cli.analyze import analyze as run

    return run(context, state.paths, force=force, quiet=as_json)


def _record(recorder: Recorder, teller: _Teller) -> None:
    """Record in a thread of its own, which no update of the view keeps waiting; Ctrl-C ends it."""
    done, failures = threading.Event(), []

    def receive() -> None:
        try:
            recorder.run(done, teller.event)
        except BaseException as error:  # noqa: BLE001 - raised again where it is caught
            failures.append(error)

    receiver = threading.Thread(target=receive)
    receiver.start()
    try:
        _watch(recorder.state, receiver, teller)
    except KeyboardInterrupt:
        teller.event("Interrupted: the recording ends here.")
    finally:
        done.set()
        receiver.join()
    if failures:
        raise failures[0]


def _watch(state: RecordState, receiver: threading.Thread, teller: _Teller) -> None:
    """Say once a second how far the recording is."""
    while receiver.is_alive():
        receiver.join(_EVERY_S)
        teller.progress(state)


class _Teller:
    """Says what happens: lines for people on stderr, results on stdout, or all as JSON."""

    def __init__(self, *, as_json: bool) -> None:
        self._as_json = as_json
        self._said_s = -float("inf")

    def event(self, sentence: str) -> None:
        """Say that something happened."""
        if self._as_json:
            self._json(kind="event", sentence=printable(sentence, 400))
        else:
            report_problem(sentence)

    def recorded(self, path: Path) -> None:
        """Name a file."""
        if self._as_json:
            self._json(kind="recorded", path=str(path), bytes=path.stat().st_size)
        else:
            say(printable(path))

    def progress(self, state: RecordState) -> None:
        """Say how much was recorded."""
        now_s = time.monotonic()
        if self._as_json:
            self._json(kind="progress", bytes=state.n_bytes, armed=state.armed)
        elif now_s - self._said_s > 10.0:
            self._said_s = now_s
            word = "armed" if state.armed else "disarmed"
            sys.stderr.write(f"{state.n_bytes / 1e6:.1f} MB recorded, {word}\n")

    def _json(self, **fields: object) -> None:
        say(json.dumps(fields))
        flush()
