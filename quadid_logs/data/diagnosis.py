"""Results of the stage `diagnose`: findings and the verdict of each axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from quadid_logs.data.catalogue import Step
from quadid_logs.untrusted import printable

Level = Literal["info", "warning", "error"]
Verdict = Literal["usable", "caution", "refused"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A caveat about the flight, with its evidence and its advice.

    ``axes`` names the affected axes; empty means all. ``step`` is the kind of advice if it differs from the
    catalogue. The texts may quote the log: escape them before showing.
    """

    code: str
    level: Level
    title: str
    evidence: Mapping[str, object]
    advice: str
    axes: tuple[str, ...] = ()
    step: Step | None = None

    def __repr__(self) -> str:
        axes = f" ({', '.join(self.axes)})" if self.axes else ""
        return f"<{type(self).__name__} {self.code} {self.level}: {printable(self.title, 200)}{axes}>"


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisVerdict:
    """The verdict of one axis, with the codes of its reasons.

    ``sentence`` states the first reason, or why the axis is usable.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    sentence: str

    def __repr__(self) -> str:
        told = " ".join((self.verdict, *self.reasons))
        return f"<{type(self).__name__} {told}: {printable(self.sentence, 200)}>"


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """All findings, the most severe first, and the verdict of each axis by its name."""

    findings: tuple[Finding, ...]
    axes: Mapping[str, AxisVerdict]

    def __repr__(self) -> str:
        lines = [f"<{type(self).__name__}: {' '.join(one.code for one in self.findings) or 'no findings'}"]
        lines += [f"  {axis:<5}  {' '.join((one.verdict, *one.reasons))}" for axis, one in self.axes.items()]
        return "\n".join(lines) + ">"

    @property
    def usable(self) -> bool:
        """Whether no axis is refused (exit code 0)."""
        return all(axis.verdict != "refused" for axis in self.axes.values())
