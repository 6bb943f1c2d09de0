"""What is done in a worker's process: one function per kind of entry, each writes files into a folder."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from quadid_logs.errors import SeveralLogsError
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.naming import craft_name
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.tasks import Outcome
from quadid_logs.serve.entries import Kind
from quadid_logs.untrusted import printable
from quadid_logs.version import __version__
from quadid_logs.vocabulary import AXES

if TYPE_CHECKING:
    from quadid_logs.data.result import Result

#: The page of every result, and what `quadid-log analyze` calls the numbers.
PAGE_FILE: Final = "report.html"
RESULT_FILE: Final = "result.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One entry as a worker gets it: the logs' paths and names, and the folder to write into."""

    kind: Kind
    logs: tuple[str, ...]
    names: tuple[str, ...]
    #: Of each file the log that was chosen, 0 for its longest.
    numbers: tuple[int, ...]
    sha256: tuple[str, ...]
    n_bytes: int
    options: Mapping[str, Any]
    folder: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """What a job gave: what the list shows, and of an analysis what the history is to hold."""

    summary: Mapping[str, Any] = field(default_factory=dict)
    outcome: Outcome | None = None


#: Called with the stage that begins, and with the summary as soon as there is a verdict.
Tell = Callable[[str, Mapping[str, Any] | None], None]


def do(job: Job, tell: Tell) -> Done:
    """Do a job.

    Raises
    ------
    QuadidError
        If it cannot be done for what the logs hold or the options say.
    """
    jobs = {Kind.ANALYZE: _analyze, Kind.COMPARE: _compare, Kind.TUNE: _tune, Kind.PLAN: _plan}
    return jobs[job.kind](job, tell)


def _analyze(job: Job, tell: Tell) -> Done:
    """Do what ``quadid-log analyze`` does, and what a fleet's history needs."""
    from quadid_logs.fleets.rows import judged_as, result_rows
    from quadid_logs.report.folder import write_drawings
    from quadid_logs.report.json import json_text
    from quadid_logs.report.provenance import Provenance

    result, lengths_s = _result_of(job, 0, tell)
    file = LogFile(url=job.names[0], n_bytes=job.n_bytes, modified_s=float(job.options["modified_s"]))
    rows = result_rows([result], file, job.sha256[0], Options().rules)
    summary = _summary(result, rows[0], lengths_s or job.options.get("lengths_s", {}))
    tell("writing the report", summary)
    provenance = Provenance(version=__version__, command="", log_sha256=job.sha256[0])
    folder = Path(job.folder)
    write_drawings(result, provenance, folder, "none")
    (folder / RESULT_FILE).write_text(json_text(result, provenance), encoding="utf-8")
    # Whether the history can take the result as it is: one flight, in the history's structure.
    model = result.identification.recommended
    if not (len(result.data.flights) < 2 and (model is None or model.structure == Options().structure)):
        tell("adding it to the history", summary)
        # Analyze each flight alone, in the structure that all flights of the history have.
        from quadid_logs.fleets.per_flight import analyze_flights

        settings = dataclasses.replace(Options().settings, log=result.settings.log)
        by_flight = result_rows(
            tuple(analyze_flights(Path(job.logs[0]), settings, None, "verdict")),
            file,
            job.sha256[0],
            Options().rules,
        )
        # Of a single flight, list, report and history say the same.
        rows = judged_as(by_flight, rows) if len(by_flight) == len(rows) else by_flight
    return Done(summary=summary, outcome=Outcome(file=file, sha256=job.sha256[0], rows=rows))


def _result_of(job: Job, which: int, tell: Tell) -> tuple[Result, dict[str, float]]:
    """Analyze one log under the name that its owner knows; of a file with several the chosen or longest.

    The second is how long each log of the file is [s], where none was chosen of several.
    """
    from quadid_logs.data.settings import Settings
    from quadid_logs.pipeline import analyze

    run = partial(analyze, job.logs[which], progress=lambda stage: tell(stage, None))
    lengths_s = {}
    try:
        result = run(Settings(log=job.numbers[which]))
    except SeveralLogsError as several:
        lengths_s = {str(number): length for number, length in several.durations_s.items()}
        result = run(Settings(log=several.longest))
    return dataclasses.replace(result, log=dataclasses.replace(result.log, path=job.names[which])), lengths_s


def _summary(result: Result, row: Mapping[str, Any], lengths_s: Mapping[str, float]) -> dict[str, Any]:
    """Return what the list shows of a log."""
    from quadid_logs.report.verdict import effect_sentence, flown_sentence, headline

    started = row.get("started")
    found = result.diagnosis.axes
    number, which_log = str(result.settings.log), ""
    if number in lengths_s:
        which = "the longest" if lengths_s[number] == max(lengths_s.values()) else "one"
        which_log = f"; log {number}, {which} of {len(lengths_s)} in the file"
    return {
        "vehicle": row["vehicle"],
        "craft": printable(craft_name(result.log), 80),
        "model": row["model"],
        "started": started.isoformat() if started is not None else "",
        "started_from": row["started_from"],
        "n_flights": len(result.data.flights),
        "headline": headline(result),
        "flown": flown_sentence(result) + which_log,
        "log": result.settings.log,
        "lengths_s": dict(lengths_s),
        "axes": {
            axis: {"verdict": found[axis].verdict, "effect": effect_sentence(result, axis)} for axis in AXES
        },
    }


def _compare(job: Job, tell: Tell) -> Done:
    """Do what ``quadid-log compare`` does."""
    from quadid_logs.comparison import compare
    from quadid_logs.figures import Figure
    from quadid_logs.figures.comparison_chart import comparison_figure
    from quadid_logs.figures.loop_comparison import loop_comparison_figure
    from quadid_logs.report.comparison import comparison_lines, comparison_text
    from quadid_logs.report.comparison_page import comparison_page

    before, after = (_result_of(job, which, tell)[0] for which in (0, 1))
    comparison = compare(before, after)
    tell("writing the report", None)
    drawn = (comparison_figure(comparison), loop_comparison_figure(before, after))
    figures = [each for each in drawn if isinstance(each, Figure)]
    _write(
        job,
        {
            PAGE_FILE: comparison_page(before, after, comparison, figures),
            "compare.json": comparison_text(before, after, comparison),
        },
    )
    return Done(summary={"headline": comparison_lines(before, after, comparison)[0]})


def _tune(job: Job, tell: Tell) -> Done:
    """Do what ``quadid-log tune`` does: the first log, with the others as earlier flights."""
    from quadid_logs.earlier import with_earlier
    from quadid_logs.report.provenance import Provenance
    from quadid_logs.report.tune_folder import tuning_files
    from quadid_logs.report.tune_view import headline
    from quadid_logs.tuning import tuning_of

    result, *earlier = (_result_of(job, which, tell)[0] for which in range(len(job.logs)))
    result = with_earlier(result, earlier)
    tell("tune", None)
    tuning = tuning_of(result)
    provenance = Provenance(version=__version__, command="", log_sha256=job.sha256[0])
    files = tuning_files(result, tuning, provenance, page=PAGE_FILE)
    _write(job, files)
    return Done(summary={"headline": headline(tuning)})


def _plan(job: Job, tell: Tell) -> Done:
    """Do what ``quadid-log plan`` does."""
    from quadid_logs.planning import make_plan, parse_version, predict
    from quadid_logs.report.markdown_page import markdown_page
    from quadid_logs.report.plan import CARD_FILE, card_lines, live_files, parameter_files

    firmware = str(job.options.get("firmware") or "")
    planned = make_plan(
        str(job.options["autopilot"]),
        [str(axis) for axis in job.options["axes"]],
        parse_version(firmware) if firmware else None,
    )
    tell("simulating the flight", None)
    lines = card_lines(planned, predict(planned))
    card = "\n".join(lines) + "\n"
    files = parameter_files(planned) | live_files(planned)
    _write(job, {**files, CARD_FILE: card, PAGE_FILE: markdown_page(card)})
    return Done(summary={"headline": printable(lines[0].lstrip("# "))})


def _write(job: Job, files: Mapping[str, str]) -> None:
    """Write texts into the job's folder."""
    for name, text in files.items():
        (Path(job.folder) / name).write_text(text, encoding="utf-8")
