"""Write the pages that come from the program itself: `python docs/pages.py`.

findings.md is the catalogue that `quadid-log explain` quotes; paper/ is what
`quadid-log paper` prints and draws.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from quadid_logs.cli import main
from quadid_logs.data.catalogue import CATALOGUE

DOCS = Path(__file__).parent


def findings_page() -> str:
    """Return the catalogue of findings as a page."""
    parts = [
        "# Findings\n\nEverything that a report can find, by code: QL1xx the file, QL2xx the vehicle, "
        "QL3xx what was logged and how fast, QL4xx the flight, QL5xx the model. "
        "`quadid-log explain CODE` prints the same texts.\n"
    ]
    parts += [
        f"## {entry.code}: {entry.title}\n\n{entry.meaning}\n\n**What to do.** {entry.advice}\n"
        for entry in sorted(CATALOGUE.values(), key=lambda entry: entry.code)
    ]
    return "\n".join(parts)


def write_paper_page() -> None:
    """Run the paper's experiment and keep its page and pictures."""
    with tempfile.TemporaryDirectory() as folder:
        code = main(["paper", "-o", folder, "--force"])
        if code != 0:
            raise SystemExit(code)
        for name in ("paper.md", "fig4.png", "windows.png"):
            shutil.copy(Path(folder) / name, DOCS / "paper" / name)


if __name__ == "__main__":
    (DOCS / "findings.md").write_text(findings_page(), encoding="utf-8")
    write_paper_page()
