"""The verdict in a few lines of plain text, for a terminal or a pipe."""

from __future__ import annotations

from quadid_logs.data.result import Result
from quadid_logs.report.health_view import health_lines
from quadid_logs.report.next_flight import next_steps
from quadid_logs.report.verdict import effect_sentence, flown_sentence
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES


def result_lines(result: Result) -> tuple[str, ...]:
    """Return the verdict per axis with its main number, what the log shows, and what to do next.

    Lines without control characters, whatever the log holds.
    """
    model = result.identification.recommended
    structure = f"structure {model.structure}, " if model else ""
    lines = [f"{_name(result)}: {structure}{flown_sentence(result)}"]
    for axis in AXES:
        if axis in result.diagnosis.axes:
            verdict = result.diagnosis.axes[axis]
            codes = (
                f" [{' '.join(printable(code, 20) for code in verdict.reasons)}]" if verdict.reasons else ""
            )
            lines.append(f"  {axis:<5}  {verdict.verdict:<7}  {printable(verdict.sentence, 400)}{codes}")
            if effect := effect_sentence(result, axis):
                lines.append(f"{'':18}{effect}")
    lines += health_lines(result)
    lines += [f"  next: {step}" for step in next_steps(result)]
    return tuple(lines)


def one_line(result: Result) -> str:
    """Return file and verdicts in one line."""
    verdicts = ", ".join(
        f"{axis} {verdict.verdict}"
        + (f" ({' '.join(printable(c, 20) for c in verdict.reasons)})" if verdict.reasons else "")
        for axis, verdict in result.diagnosis.axes.items()
    )
    return f"{_name(result)}: {verdicts}"


def _name(result: Result) -> str:
    """Return the log's file name."""
    return printable(result.name, 120)
