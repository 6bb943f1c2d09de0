"""``quadid-log live``: record the log that a vehicle streams, with figures meanwhile and analysis after."""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from quadid_logs.cli.failure import flush, report_problem, say
from quadid_logs.cli.outcome import open_page
from quadid_logs.cli.terminal import is_terminal
from quadid_logs.errors import QuadidError
from quadid_logs.untrusted import printable

if TYPE_CHECKING:
    from rich.live import Live

    from quadid_logs.link.record import Recorder, RecordPatience, RecordState
    from quadid_logs.live import LiveEstimate, LiveFigures

#: Updates; lines in a pipe where nothing is new to do, and where something is [s].
_EVERY_S, _PAUSE_S, _NEWS_S = 1.0, 10.0, 2.0
_PROVISIONAL: Final = "Provisional: the analysis after landing decides."
#: How long the vehicle, and its stream, are waited for; None: as `RecordPatience` has it. Tests have less.
_PATIENCE: RecordPatience | None = None
#: For a browser, in the folder of the logs.
_PAGE: Final = "live.html"
#: The latest of what happened, on the page.
_MOST_EVENTS: Final = 5


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
    target: Annotated[
        float,
        typer.Option(
            "--target", metavar="PERCENT", min=1.0, max=50.0, help="Half of the 95 % interval to reach [%]."
        ),
    ] = 5.0,
    no_analyze: Annotated[
        bool, typer.Option("--no-analyze", help="Record only; analyze the log later.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one line of JSON for each update and event.")
    ] = False,
    open_page: Annotated[
        bool,
        typer.Option("--open", help="Also show the figures in the browser, and the report after landing."),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the report of an earlier run.")] = False,
) -> int:
    """Record the log that a vehicle streams, show what the flight tells so far, and analyze it after landing.

    Start it before arming. It ends after disarming, or with Ctrl-C. Exit code:
    that of analyze; 2: no vehicle, or no log.
    """
    from quadid_logs.link.record import Recorder
    from quadid_logs.link.vehicle import Vehicle

    teller = _Teller(as_json=as_json, page=output / _PAGE if open_page else None)
    with Vehicle(address, may_fly=True) as vehicle:
        recorder = Recorder(vehicle, output, _PATIENCE)
        _record(recorder, teller, 0.01 * target)
    state = recorder.state
    for sentence in state.losses.sentences():
        teller.event(sentence)
    teller.end(state)
    for path in state.paths:
        teller.recorded(path)
    if no_analyze:
        return 0
    from quadid_logs.cli.analyze import analyze as run

    return run(context, state.paths, force=force, quiet=as_json, open_report=open_page)


def _record(recorder: Recorder, teller: _Teller, target: float) -> None:
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
        # Show once a second what the flight tells so far.
        view = _View(target)
        with teller:
            while receiver.is_alive():
                receiver.join(_EVERY_S)
                teller.show(recorder.state, view.figures(recorder.state, teller))
    except KeyboardInterrupt:
        teller.event("Interrupted: the recording ends here.")
    finally:
        done.set()
        receiver.join()
    if failures:
        raise failures[0]


class _View:
    """The live figures of the file that is being written."""

    def __init__(self, target: float) -> None:
        self._target = target
        self._path: Path | None = None
        self._n_read = 0
        self._flight: LiveEstimate | None = None
        self._failed = False

    def figures(self, state: RecordState, teller: _Teller) -> LiveFigures:
        """Return the figures; what goes wrong with them ends them, and not the recording."""
        from quadid_logs.live import LiveEstimate, LiveFigures

        if state.path is None or self._failed:
            return LiveFigures(target=self._target)
        if state.path != self._path or self._flight is None:
            self._path, self._n_read = state.path, 0
            self._flight = LiveEstimate(self._target)
        try:
            with state.path.open("rb") as file:
                file.seek(self._n_read)
                content = file.read(max(state.n_bytes - self._n_read, 0))
            self._n_read += len(content)
            self._flight.append(content)
            return self._flight.figures()
        except Exception as error:  # noqa: BLE001 - any failure here must leave the recording alone
            self._failed = True
            teller.event(f"Live figures have stopped ({type(error).__name__}). The recording goes on.")
            return LiveFigures(target=self._target)


class _Teller:
    """Says what happens: a block that is drawn anew or lines on stderr, results on stdout; or all as JSON."""

    def __init__(self, *, as_json: bool, page: Path | None = None) -> None:
        self._as_json = as_json
        self._page, self._opened = page, False
        self._events: list[str] = []
        self._figures: LiveFigures | None = None
        self._said_s, self._hint = -float("inf"), ""
        self._block: Live | None = None

    def __enter__(self) -> _Teller:
        if not self._as_json and is_terminal(sys.stderr):
            from rich.console import Console
            from rich.live import Live

            self._block = Live(console=Console(stderr=True, highlight=False), auto_refresh=False)
            self._block.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._block is not None:
            self._block.stop()
            self._block = None

    def event(self, sentence: str) -> None:
        """Say that something happened."""
        self._events.append(sentence)
        if self._as_json:
            self._json(kind="event", sentence=printable(sentence, 400))
        elif self._block is not None:
            self._block.console.print(printable(sentence, 400), markup=False)
        else:
            report_problem(sentence)

    def recorded(self, path: Path) -> None:
        """Name a file."""
        if self._as_json:
            self._json(kind="recorded", path=str(path), bytes=path.stat().st_size)
        else:
            say(printable(path))

    def show(self, state: RecordState, figures: LiveFigures) -> None:
        """Show the figures: at once on a terminal, in a pipe when there is something new to do."""
        from quadid_logs.live import figure_block, figure_line

        self._figures = figures
        self._write_page(state, figures, flying=True)
        if self._as_json:
            self._json(kind="update", **_fields(state, figures))
        elif self._block is not None:
            from rich.text import Text

            lines = "\n".join((_recording(state), *figure_block(figures), _PROVISIONAL))
            self._block.update(Text(lines), refresh=True)
        else:
            now_s, due_s = time.monotonic(), _PAUSE_S if figures.hint == self._hint else _NEWS_S
            if now_s - self._said_s >= due_s:
                self._said_s, self._hint = now_s, figures.hint
                sys.stderr.write(f"{figure_line(figures)}\n")
                sys.stderr.flush()

    def end(self, state: RecordState) -> None:
        """Leave a page that does not renew itself."""
        if self._figures is not None:
            self._write_page(state, self._figures, flying=False)

    def _write_page(self, state: RecordState, figures: LiveFigures, *, flying: bool) -> None:
        """Write the page, and open it the first time; a browser that fails leaves the recording alone."""
        if self._page is None:
            return
        from quadid_logs.output import make_folder, write_beside
        from quadid_logs.report.live_page import live_page

        content = live_page(
            figures,
            log=_recording(state),
            clock=time.strftime("%H:%M:%S"),
            sentences=self._events[-_MOST_EVENTS:],
            flying=flying,
        )
        try:
            make_folder(self._page.parent)
            write_beside(self._page, content.encode())
        except QuadidError as error:
            self._page = None
            self.event(f"The live page is no longer written: {error.args[0]}")
            return
        if not self._opened:
            self._opened = True
            open_page(self._page, self.event)

    def _json(self, **fields: object) -> None:
        say(json.dumps(fields, allow_nan=False))
        flush()


def _recording(state: RecordState) -> str:
    """Say what is recorded, and whether the motors may turn."""
    name = "no log yet" if state.path is None else printable(state.path.name, 80)
    return f"{name}  {state.n_bytes / 1e6:.1f} MB  {'armed' if state.armed else 'disarmed'}"


def _fields(state: RecordState, figures: LiveFigures) -> dict[str, object]:
    """Return an update as JSON has it: what is not known is null."""
    return {
        "bytes": state.n_bytes,
        "armed": state.armed,
        "flown_s": round(figures.flown_s, 2),
        "axes": {
            axis.axis: {
                "effectiveness": axis.effectiveness if math.isfinite(axis.effectiveness) else None,
                "half_width": axis.half_width if math.isfinite(axis.half_width) else None,
                "more_s": axis.more_s if math.isfinite(axis.more_s) else None,
            }
            for axis in figures.axes
        },
        "unit": figures.unit,
        "saturated": round(figures.saturated, 4),
        "oscillation": figures.oscillation,
        "hint": figures.hint,
        "provisional": True,
    }
