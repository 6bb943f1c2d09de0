"""Hold the tables of one page of measurements against those of another, and say what got slower.

Two runs are on two machines, or on one that was busier. How much longer work took that is none of ours
is the machine's; where that is on neither page, how much longer the middle row took.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from typing import NamedTuple

#: A row of work that no change of ours makes slower.
MACHINE = "a sum in plain Python and a product in numpy, for the machine"
#: Less is noise.
TOLERANCE = 0.10
#: Columns that tell a cost, and those that tell a speed.
_COSTS, _SPEEDS = ("CPU s",), ("MB/s", "MB/s of CPU")
#: With fewer rows in common there is no middle to speak of.
_FEWEST_ROWS = 3


class Row(NamedTuple):
    """What a row of a table measures: by section and the words in it, its cost (any unit)."""

    section: str
    what: tuple[str, ...]


def costs(page: str) -> dict[Row, float]:
    """Return what the rows of a page's tables cost.

    Parameters
    ----------
    page : str
        Markdown, as `run.py` writes it.

    Returns
    -------
    dict of Row to float
        Seconds, or seconds per megabyte; of readers, those of ours alone.
    """
    found: dict[Row, float] = {}
    section, names = "", []
    for line in page.splitlines():
        if line.startswith("## "):
            section, names = line.removeprefix("## "), []
        elif line.startswith("|") and not line.startswith("|---"):
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if not names:
                names = cells
            elif cost := _cost(dict(zip(names, cells, strict=False))):
                words = tuple(cell for name, cell in zip(names, cells, strict=False) if _is_word(name, cell))
                found[Row(section, words)] = cost
        elif not line.startswith("|"):
            names = []
    return found


def _cost(row: dict[str, str]) -> float | None:
    """Return the cost of a row; None for one that measures nothing, or others' readers."""
    if row.get("reader", "quadid-logs") != "quadid-logs":
        return None
    for name, cell in row.items():
        number = _number(cell)
        if number and name in _COSTS:
            return number
        if number and name in _SPEEDS:
            return 1.0 / number
    return None


def _is_word(name: str, cell: str) -> bool:
    """Tell what a row is about from what was measured; the size of a file is a word."""
    return name in ("log", "MB", "columns", "reader", "what", "command") and bool(cell)


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def told(before: str, after: str) -> Iterator[str]:
    """Yield the lines that say what got slower.

    Parameters
    ----------
    before, after : str
        Pages.

    Yields
    ------
    str
        Markdown.
    """
    old, new = costs(before), costs(after)
    ratios = {row: new[row] / old[row] for row in new if row in old}
    if len(ratios) < _FEWEST_ROWS:
        yield "Too few rows are on both pages to compare them."
        return
    machine = [ratio for row, ratio in ratios.items() if MACHINE in row.what]
    speed = machine[0] if machine else statistics.median(ratios.values())
    slower = {row: ratio / speed for row, ratio in ratios.items() if ratio / speed > 1.0 + TOLERANCE}
    common = f"{len(ratios)} rows are on both pages, and {speed:.2f} times as long is the machine's."
    limit = f"slower by more than {100 * TOLERANCE:.0f} % beyond that"
    yield f"{common} {len(slower)} got {limit}:" if slower else f"{common} None got {limit}."
    if slower:
        yield ""
        yield "| section | what | times as long |"
        yield "|---|---|---|"
        for row, ratio in sorted(slower.items(), key=lambda each: -each[1]):
            yield f"| {row.section} | {', '.join(row.what)} | {ratio:.2f} |"
