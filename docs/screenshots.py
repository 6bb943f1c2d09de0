"""Take the pictures of reports on docs/report.md: `python docs/screenshots.py`, by hand; needs Chromium.

Three flights of our own simulator: the sample log, a careful pilot's, and one logged with default settings.
Of each report the first screen, light, dark and on a phone, and the page that is printed for a pocket.
"""

from __future__ import annotations

import base64
import io
import subprocess
import sys
import tempfile
from pathlib import Path

REPOSITORY = Path(__file__).parent.parent
sys.path.insert(0, str(REPOSITORY))

from tests.chromium import Browser  # noqa: E402 - the tests' browser, which is in no package

PICTURES = REPOSITORY / "docs" / "report"
#: Log by picture: None for the sample log, else what makes it.
FLIGHTS = {
    "usable": None,
    "gentle": ("gentle-hover", "--rate-hz", "200", "--duration-s", "60", "-o", "gentle.ulg"),
    "refused": ("default-logging", "--duration-s", "60", "-o", "refused.bin"),
}
#: Width and height [px], dark or not, screen or paper (A4 at 96 dots per inch).
LOOKS = {
    "light": (1280, 900, False, "screen"),
    "dark": (1280, 900, True, "screen"),
    "phone": (400, 900, False, "screen"),
    "print": (794, 1123, False, "print"),
}
#: Sharp letters in few bytes, no wider than a page of the documents.
_QUALITY, _WIDTH = 80, 1000
_DRAWN = "document.querySelectorAll('#chart-evidence .annotation').length > 2"
_SUMMARY = "document.documentElement.dataset.print = 'summary'; dispatchEvent(new Event('beforeprint'))"
_SETTLED = "new Promise((done) => setTimeout(done, 1500))"


def report_of(name: str, folder: Path) -> Path:
    """Return the report of one of the flights."""
    made = FLIGHTS[name]
    log = REPOSITORY / "sample_logs" / "sysid-quad-x.bin"
    if made is not None:
        quadid_log("simulate", *made, folder=folder)
        log = folder / made[-1]
    quadid_log("analyze", str(log), "-o", "report", folder=folder)
    return folder / "report" / log.stem / "report.html"


def quadid_log(*words: str, folder: Path) -> None:
    """Run a command; exit code 1 is a verdict, not a failure."""
    command = [sys.executable, "-c", "from quadid_logs.cli import run; run()", *words]
    if subprocess.run(command, cwd=folder, check=False).returncode > 1:
        raise SystemExit(f"failed: {' '.join(words)}")


def take(browser: Browser, page: Path, look: str, target: Path) -> None:
    """Write the picture of a page's first screen."""
    width, height, dark, media = LOOKS[look]
    browser.show(width, dark=dark, media=media)
    browser.open(page)
    browser.wait(_DRAWN)
    if media == "print":
        browser.run(_SUMMARY)
    browser.run(_SETTLED)
    clip = {"x": 0, "y": 0, "width": width, "height": height, "scale": 1}
    answer = browser.send("Page.captureScreenshot", {"captureBeyondViewport": True, "clip": clip})
    write_small(base64.b64decode(answer["data"]), target)


def write_small(png: bytes, target: Path) -> None:
    """Write a picture for a page of the documents."""
    from PIL import Image

    with Image.open(io.BytesIO(png)) as picture:
        whole = picture.convert("RGB")
    if whole.width > _WIDTH:
        whole = whole.resize((_WIDTH, round(whole.height * _WIDTH / whole.width)), Image.Resampling.LANCZOS)
    whole.save(target, quality=_QUALITY, method=6)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place, Browser(Path(place) / "profile") as started:
        for flight in sys.argv[1:] or FLIGHTS:
            report = report_of(flight, Path(place))
            for kind in LOOKS:
                take(started, report, kind, PICTURES / f"{flight}-{kind}.webp")
