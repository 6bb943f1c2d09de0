"""index.html: one line per log of a call, with links to the reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import quote

from quadid_logs.data.result import Result
from quadid_logs.report.pages import environment
from quadid_logs.report.sharing import without_folder
from quadid_logs.report.verdict import effect_sentence, flown_sentence
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexRow:
    """One log: ``axes`` are verdict and gain per axis, ``link`` is relative to the index."""

    name: str
    summary: str
    link: str = ""
    axes: tuple[tuple[str, str], ...] = ()


def index_row(result: Result, folder_name: str) -> IndexRow:
    """Return the row of an analyzed log whose report is in a folder beside the index."""
    found = result.diagnosis.axes
    return IndexRow(
        name=printable(result.name, 80),
        summary=f"{flown_sentence(result)}; {printable(without_folder(result.log.path), 160)}",
        link=f"{quote(folder_name)}/report.html",
        axes=tuple(
            (found[axis].verdict if axis in found else "refused", effect_sentence(result, axis))
            for axis in AXES
        ),
    )


def index_page(rows: Sequence[IndexRow]) -> str:
    """Return the page; every text is escaped by the template."""
    page: str = environment().get_template("index.html").render(rows=rows, axes=AXES)
    return page
