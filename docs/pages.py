"""Write the pages that come from the program itself: `python docs/pages.py`.

findings.md is the catalogue that `quadid-log explain` quotes, nomenclature.md the
table of signals; paper/ is what `quadid-log paper` prints and draws.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path

from quadid_logs.cli import main
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, RATE_SYMBOLS, SIGNALS, TORQUE_SYMBOLS

DOCS = Path(__file__).parent


def findings_page() -> str:
    """Return the catalogue of findings as a page."""
    parts = [
        "# Findings\n\nEverything that a report can find, by code: QL1xx the file, QL2xx the vehicle, "
        "QL3xx what was logged and how fast, QL4xx the flight, QL5xx the model, QL6xx the loop. "
        "`quadid-log explain CODE` prints the same texts.\n"
    ]
    parts += [
        f"## {entry.code}: {entry.title}\n\n{entry.meaning}\n\n**What to do.** {entry.advice}\n"
        for entry in sorted(CATALOGUE.values(), key=lambda entry: entry.code)
    ]
    return "\n".join(parts)


NOMENCLATURE = """# Nomenclature

Body axes are forward, right, down (FRD), Earth axes north, east, down (NED), attitude is Euler 3-2-1, signs
are right-handed, units are SI. `p, q, r` are body rates, not the derivatives of the angles.

## Axes

The on-axis control effectiveness is the angular acceleration about an axis per unit of the torque about it. A
normalised torque has no unit; its scale is that of the autopilot's own command.

| axis | body rate [rad/s] | angular acceleration [rad/s²] | torque [1 or N m] | on-axis effectiveness |
|---|---|---|---|---|
{axes}

## Signals

What every reader turns a log's messages into. Signals without columns have one for each motor or output. The
columns are those of tables, read and exported.

| signal | symbols | columns | unit | meaning |
|---|---|---|---|---|
{signals}
"""


def nomenclature_page() -> str:
    """Return every symbol and signal with its unit and sign as a page."""
    axes = [
        f"| {axis} | {_code(symbols)} | `B{number}{number}` |"
        for number, (axis, *symbols) in enumerate(
            zip(AXES, RATE_SYMBOLS, ACCELERATION_SYMBOLS, TORQUE_SYMBOLS, strict=True), start=1
        )
    ]
    signals = [
        f"| `{spec.name}` | {_code(spec.symbols, ', ')} | {_code(spec.columns, ', ')} | {_unit(spec.unit)} "
        f"| {spec.meaning} |"
        for spec in SIGNALS.values()
    ]
    return NOMENCLATURE.format(axes="\n".join(axes), signals="\n".join(signals))


def _code(names: Iterable[str], between: str = " | ") -> str:
    """Return names as code."""
    return between.join(f"`{name}`" for name in names) or "–"


def _unit(unit: str) -> str:
    """Return a unit as people write it."""
    return {"1": "–", "us": "µs"}.get(unit, unit.replace("^2", "²"))


def write_paper_page() -> None:
    """Run the paper's experiment and keep its page and pictures."""
    with tempfile.TemporaryDirectory() as folder:
        code = main(["paper", "-o", folder, "--force"])
        if code != 0:
            raise SystemExit(code)
        for name in ("paper.md", "fig4.png", "windows.png"):
            shutil.copy(Path(folder) / name, DOCS / "paper" / name)


#: The pages that tests compare with what the program says.
PAGES = {"findings.md": findings_page, "nomenclature.md": nomenclature_page}

if __name__ == "__main__":
    for name, text in PAGES.items():
        (DOCS / name).write_text(text(), encoding="utf-8")
    write_paper_page()
