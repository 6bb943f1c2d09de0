"""Run the commands that pages show, and keep what they print and draw: `python docs/console.py [PAGE...]`.

In a page, a block ```console holds commands (after ``$``) and their output. All commands of a page run in one
empty folder, in order; their output replaces what the page holds. A picture after a comment
``<!-- from: FILE -->`` is made of that file of the folder, with few colours so that it stays small.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).parent
PAGES = ("tutorials/ardupilot.md", "tutorials/px4.md", "gallery.md")
_PART = re.compile(
    r"```console\n(?P<block>.*?)```|<!-- from: (?P<source>\S+) -->\n!\[.*?\]\((?P<picture>\S+)\)", re.S
)
#: Pictures of few flat colours: so many are enough, and so wide is a page.
_COLOURS, _WIDTH = 48, 1000


def commands_of(page: str) -> list[str]:
    """Return the commands of a page in their order."""
    blocks = (found["block"] for found in _PART.finditer(page) if found["block"] is not None)
    return [
        line.removeprefix("$ ") for block in blocks for line in block.splitlines() if line.startswith("$ ")
    ]


def refreshed(page: str, folder: Path, place: Path) -> str:
    """Return a page with the output of its commands, run in a folder; its pictures are written beside it."""

    def replaced(found: re.Match[str]) -> str:
        if found["block"] is None:
            small_picture(folder / found["source"], place / found["picture"])
            return found[0]
        lines = []
        for line in found["block"].splitlines():
            if line.startswith("$ "):
                lines += [line, *output_of(line.removeprefix("$ "), folder)]
        return "\n".join(["```console", *lines, "```"])

    return _PART.sub(replaced, page)


def output_of(command: str, folder: Path) -> list[str]:
    """Return the lines that a command prints to stdout; exit code 1 is a verdict, not a failure."""
    shell = (
        f'quadid-log() {{ "{sys.executable}" -c "from quadid_logs.cli import run; run()" "$@"; }}; {command}'
    )
    done = subprocess.run(["bash", "-c", shell], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode > 1:
        raise SystemExit(f"{command}: exit code {done.returncode}\n{done.stderr}")
    return [line.rstrip() for line in done.stdout.rstrip().splitlines()]


def small_picture(source: Path, target: Path) -> None:
    """Write a picture with few colours and no wider than a page."""
    from PIL import Image

    with Image.open(source) as picture:
        height = round(picture.height * _WIDTH / picture.width)
        small = picture.convert("RGB").resize((_WIDTH, height), Image.Resampling.LANCZOS)
    target.parent.mkdir(exist_ok=True)
    small.quantize(_COLOURS).save(target, optimize=True)


if __name__ == "__main__":
    for name in sys.argv[1:] or PAGES:
        path = DOCS / name
        with tempfile.TemporaryDirectory() as folder:
            path.write_text(
                refreshed(path.read_text(encoding="utf-8"), Path(folder), path.parent), encoding="utf-8"
            )
        print(f"{name}: done")
