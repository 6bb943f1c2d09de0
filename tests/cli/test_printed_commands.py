"""Every command that a page, the terminal, a file or the documentation prints can be pasted, and runs."""

from __future__ import annotations

import contextlib
import io
import json
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import typer

from quadid_logs import pipeline
from quadid_logs.cli import main
from quadid_logs.cli.app import command_of
from quadid_logs.cli.terminal import wrapped
from quadid_logs.commands import named, quoted
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.report.model_files import model_bytes, model_formats_of
from quadid_logs.report.next_flight import next_steps
from quadid_logs.vehicle_file import read_vehicle
from tests.marks import thorough
from tests.synthetic_results import synthetic_prediction
from tests.tuned_flights import stiff

pytestmark = pytest.mark.usefixtures("quick_multisines")

REPOSITORY = Path(__file__).resolve().parents[2]
SAMPLES = REPOSITORY / "sample_logs"
FLIGHTS = """it's "my" flights"""
VEHICLE = "mass_kg = 1.5\narm_length_m = 0.225\ntorque_to_thrust_m = 0.02\n"
#: Exit codes of a command that did what it says: `compare` may find flights not comparable.
DONE = {0, 1, 3}
#: They do not end, want a vehicle, or take many logs: their options are parsed.
PARSED_ONLY = {"fleet", "fleet-report", "live", "query", "serve"}


class Log(NamedTuple):
    """A log by its name in `FLIGHTS`, how it is made, and how it is analyzed."""

    name: str
    sample: str
    times: int
    options: tuple[str, ...]


LOGS = (
    Log("flight $1.bin", "sysid-quad-x.bin", 1, ("--vehicle", f"{FLIGHTS}/my quad.toml")),
    Log("plain.bin", "sysid-quad-x.bin", 1, ()),
    Log("slow & hover.bin", "default-logging.bin", 1, ()),
    Log("two logs.bbl", "betaflight-doublets.bbl", 2, ("--log", "2")),
    Log("ground station.tlog", "doublets.tlog", 1, ("--system", "1")),
    Log("flügel.ulg", "products-of-inertia.ulg", 1, ("--start-s", "34")),
)
#: A vehicle, no model: what is told of other logs and with other options differs by their words alone.
QUICK = tuple(LOGS[place] for place in (0, 2))


class Printed(NamedTuple):
    """Logs, commands with the log that they were printed for, and texts in which more of them stand.

    ``folder`` is where they were printed.
    """

    folder: Path
    logs: tuple[Log, ...]
    commands: dict[str, Log | None]
    others: list[str]


class _Page(HTMLParser):
    """Takes the commands out of a page: what stands as code, and texts that are nothing else."""

    def __init__(self) -> None:
        super().__init__()
        self.commands: list[str] = []
        self.rest = ""
        self._hidden = self._code = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: ARG002
        self._hidden += tag in ("script", "style")
        self._code += tag == "code"

    def handle_endtag(self, tag: str) -> None:
        self._hidden -= tag in ("script", "style")
        self._code -= tag == "code"

    def handle_data(self, data: str) -> None:
        text = data.strip()
        if self._hidden:
            return
        if text.startswith("quadid-log ") or (self._code and text == "quadid-log"):
            self.commands.append(text)
        else:
            self.rest += f"{text}\n"


def in_text(text: str) -> tuple[list[str], str]:
    """Return the commands of a text, which stand between backticks, and what is left of it."""
    pattern = r"`(quadid-log [^`]*)`"
    return re.findall(pattern, text), re.sub(pattern, "", text)


def in_page(text: str) -> tuple[list[str], str]:
    """Return the commands of a page, and what is left of its text."""
    page = _Page()
    page.feed(text)
    more, rest = in_text(page.rest)
    return [*page.commands, *more], rest


def in_json(content: Any) -> Iterator[str]:
    """Yield the texts of a file of JSON but for the command that made it."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict):
        for name, value in content.items():
            yield from () if name == "command" else in_json(value)
    elif isinstance(content, list):
        for value in content:
            yield from in_json(value)


def in_file(path: Path) -> tuple[list[str], str]:
    """Return the commands of a file, and what is left of it."""
    if path.suffix == ".png":
        return [], ""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".json":
        return in_text("\n".join(in_json(json.loads(text))))
    return in_page(text) if path.suffix == ".html" else in_text(text)


def lay_out(folder: Path) -> None:
    """Put the flights of all samples into a folder."""
    flights = folder / FLIGHTS
    flights.mkdir()
    (flights / "my quad.toml").write_text(VEHICLE)
    for log in LOGS:
        (flights / log.name).write_bytes((SAMPLES / log.sample).read_bytes() * log.times)


@pytest.fixture(scope="module")
def quick() -> Iterator[None]:
    """Analyze each log once, whatever commands do it; leave out what prints no command."""
    results: dict[tuple[bytes, Settings, bool], Result] = {}
    analyze, card = pipeline.analyze, synthetic_prediction()

    def once(
        log: Path | list[Path], settings: Settings, *, vehicle: Vehicle | None = None, **_k: object
    ) -> Result:
        # Several logs are flights to pool.
        paths = log if isinstance(log, list) else [log]
        key = (b"".join(Path(each).read_bytes() for each in paths), settings, vehicle is not None)
        if key not in results:
            results[key] = stiff(analyze(log, settings, vehicle=vehicle))
        result = results[key]
        return replace(result, log=replace(result.log, path=str(paths[0])), vehicle=vehicle)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("quadid_logs.pipeline.analyze", once)
        patch.setattr("quadid_logs.planning.predict", lambda *_a: card)
        patch.setattr("quadid_logs.report.tune_folder.autotune_forecasts", lambda *_a: {})
        patch.setattr("quadid_logs.report.tune_folder.what_if_grids", lambda *_a: {})
        # Figures print no command, and `--png all` draws thirty.
        patch.setattr("quadid_logs.figures.png.write_png", lambda *_a: None)
        yield


@pytest.fixture(scope="module", params=[QUICK, thorough(LOGS)], ids=["quick", "all"])
def printed(request: pytest.FixtureRequest, quick: None, tmp_path_factory: pytest.TempPathFactory) -> Printed:
    """Analyze, tune, look at and compare every log, go wrong, and take down every command that is told."""
    folder = tmp_path_factory.mktemp("printed")
    lay_out(folder)
    told = Printed(folder, request.param, {}, [])

    def note(found: tuple[list[str], str], log: Log | None) -> None:
        told.commands.update(dict.fromkeys(found[0], log))
        told.others.append(found[1])

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for number, log in enumerate(told.logs):
            path = f"{FLIGHTS}/{log.name}"
            for verb in (
                ("analyze", path, *log.options, "-o", f"reports {number}"),
                ("tune", path, *log.options, "-o", f"gains {number}"),
                ("info", path, *log.options),
                ("export", path, *log.options, "--model", "-o", f"{number}.sdf"),
                ("export", path, *log.options, "-o", f"{number}.csv"),
                ("compare", path, path, *_of_both(log.options), "-o", f"compared {number}"),
            ):
                note(in_text(output_of(verb)), log)
            for written in (f"reports {number}", f"gains {number}", f"compared {number}"):
                for file in sorted((folder / written).rglob("*.*")):
                    note(in_file(file), log)
        for wrong in (
            ("analyze", FLIGHTS),
            ("analyze", f"{FLIGHTS}/{told.logs[1].name}", "--start-s", "1e9"),
            ("tune", "nowhere.bin"),
            ("tune",),
            ("explain", "QL999"),
            ("query", FLIGHTS, "SELECT 1"),
            ("plan", "--autopilot", "ardupilot", "-o", "plan"),
            ("plan", "--autopilot", "px4", "-o", "plan of px4"),
            *(("explain", code) for code in CATALOGUE),
        ):
            note(in_text(output_of(wrong)), told.logs[1])
        for file in sorted(folder.glob("plan*/*.*")):
            note(in_file(file), told.logs[1])
    return told


def _of_both(options: tuple[str, ...]) -> tuple[str, ...]:
    """Return the options of a log as `compare` takes them for two."""
    return ("--logs", options[1], options[1]) if options[:1] == ("--log",) else options


def output_of(arguments: tuple[str, ...]) -> str:
    """Return what a command prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        main(list(arguments))
    return out.getvalue()


@cache
def verbs() -> Mapping[str, Any]:
    """Return the commands by name."""
    return command_of().commands  # type: ignore[attr-defined, no-any-return]


def parsed(words: list[str]) -> None:
    """Parse a command without running it; what is no command raises."""
    assert words[0] == "quadid-log"
    if len(words) > 1:
        verb = verbs()[words[1]]
        # `--help` says so and leaves.
        with contextlib.suppress(typer.Exit):
            verb.make_context(words[1], words[2:])


def test_commands_are_printed_for_every_log(printed: Printed) -> None:
    """Else the tests below would run nothing."""
    told = [(shlex.split(line)[1], log) for line, log in printed.commands.items()]
    assert {log for _verb, log in told} == {*printed.logs}
    assert {"analyze", "tune", "compare", "export", "plan", "info", "fleet"} <= {verb for verb, _log in told}


def test_no_command_stands_where_it_cannot_be_told_from_words(printed: Printed) -> None:
    """Set off as code: a reader sees where it ends."""
    assert [text for text in printed.others if re.search(r"quadid-log (?!s)\w", text)] == []


def test_no_printed_command_is_broken_in_two_lines(printed: Printed) -> None:
    """Pasted it would be two commands, of which the first has no log."""
    assert [line for line in printed.commands if "\n" in line] == []


@pytest.mark.thorough
def test_every_printed_command_runs(
    printed: Printed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Pasted where the first one was typed, with the next log in the place of `NEXT-LOG`: no exit code 2."""
    lay_out(tmp_path)
    monkeypatch.chdir(tmp_path)
    failed = {}
    for line, log in printed.commands.items():
        words = shlex.split(line)
        path = f"{FLIGHTS}/{(log or printed.logs[1]).name}"
        words = [path if word in ("LOG", "NEXT-LOG") else word for word in words]
        parsed(words)
        if words[1] in PARSED_ONLY:
            continue
        if log is not None and "LOG" in shlex.split(line) and words[1] != "plan":
            words += log.options
        if "--promise" in words:
            # It stands where the gains were printed.
            place = words.index("--promise") + 1
            words[place] = str(printed.folder / words[place])
        if "--logs" in words:
            # The next log may be of a file with several, too.
            words[words.index("--logs") + 2] = words[words.index("--logs") + 1]
        for name in ("quadid-tune", "quadid-report", "plan"):
            shutil.rmtree(tmp_path / name, ignore_errors=True)
        (tmp_path / "model.mat").unlink(missing_ok=True)
        if (code := main(words[1:])) not in DONE:
            failed[line] = code, capsys.readouterr().err
    assert failed == {}


def test_a_shell_reads_a_printed_command_as_it_is_meant(printed: Printed) -> None:
    """Spaces, quotes, `$` and `&` in names."""
    for line in printed.commands:
        words = line.removeprefix("quadid-log ")
        shell = subprocess.run(["sh", "-c", f"printf '%s\\n' {words}"], capture_output=True, check=True)
        assert shell.stdout.decode().splitlines() == shlex.split(words)


@pytest.mark.thorough
def test_what_cannot_be_exported_is_not_offered(tmp_path: Path) -> None:
    """`model.sdf` stood beside every model, and ended with exit code 2 without an inertia in kg m^2."""
    log = tmp_path / "flight.bin"
    shutil.copy(SAMPLES / "sysid-quad-x.bin", log)
    (tmp_path / "quad.toml").write_text(VEHICLE)
    for vehicle in (None, read_vehicle(tmp_path / "quad.toml")):
        result = pipeline.analyze(log, Settings(), vehicle=vehicle)
        assert ("model.sdf" in " ".join(next_steps(result))) == (vehicle is not None)
        assert all(model_bytes(result, ending) for ending in model_formats_of(result))


@pytest.mark.parametrize(
    ("word", "windows", "posix"),
    [
        ("flight.bin", "flight.bin", "flight.bin"),
        ("my flight.bin", '"my flight.bin"', '"my flight.bin"'),
        ("it's.bin", '"it\'s.bin"', '"it\'s.bin"'),
        ("C:\\logs\\a b.bin", '"C:\\logs\\a b.bin"', "'C:\\logs\\a b.bin'"),
        ("C:\\logs\\a.bin", "C:\\logs\\a.bin", "'C:\\logs\\a.bin'"),
        ("a $b.bin", '"a $b.bin"', "'a $b.bin'"),
        ("ü.bin", '"ü.bin"', '"ü.bin"'),
        ("~x", '"~x"', '"~x"'),
        ("", '""', "''"),
    ],
)
def test_a_name_is_quoted_for_the_shells_of_its_system(word: str, windows: str, posix: str) -> None:
    """Double quotes where they do: they are the same on all."""
    assert quoted(word, windows=True) == windows
    assert quoted(word, windows=False) == posix


@pytest.mark.parametrize(
    "name", ["two\nlines.bin", "a  b.bin", "a`b.bin", "\x1b[31m.bin", "\udcff.bin", "s3://a/b.bin", ""]
)
def test_a_name_that_cannot_be_shown_as_it_is_is_not_printed(name: str) -> None:
    """What a page shows of it would name another file."""
    assert named(name) == "LOG"


def test_a_name_that_looks_like_an_option_is_none() -> None:
    """In the working folder."""
    assert named("-o.bin") == "./-o.bin"


def test_a_terminal_breaks_no_command(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pasted from two lines it would be two commands."""
    monkeypatch.setattr("quadid_logs.cli.terminal.is_terminal", lambda _stream: True)
    monkeypatch.setenv("COLUMNS", "40")
    line = "quadid-log tune some/folder/with/a/long/name/flight.bin --log 2"
    parts = wrapped(f"The next gains to fly, as many words before it: `{line}` and after it.", 2)
    assert len(parts) > 2
    assert sum(f"`{line}`" in part for part in parts) == 1


def documented() -> list[tuple[str, str]]:
    """Return every command of the documentation with its page."""
    told = []
    for page in [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]:
        text = page.read_text(encoding="utf-8")
        blocks = re.findall(r"^```[^\n]*\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
        blocks += re.findall(r"(?:^ {4}[^\n]*\n)+", text, re.MULTILINE)
        lines = [part for block in blocks for line in block.splitlines() for part in re.split(r"&&|\|", line)]
        found = [re.sub(r"\s#.*", "", line.strip().removeprefix("$ ")).rstrip("\\").strip() for line in lines]
        found += re.findall(r"`(quadid-log [^`\n]*)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
        told += [(page.name, line) for line in found if line.startswith("quadid-log ")]
    return sorted(set(told))


@pytest.mark.parametrize(("page", "line"), documented())
def test_every_command_of_the_documentation_is_one(page: str, line: str) -> None:
    """With options that exist; a verb alone is named, not to be run."""
    words = shlex.split(line)
    if len(words) > 2:
        parsed(words)
    elif not words[1].startswith("--"):
        assert words[1] in verbs(), page
