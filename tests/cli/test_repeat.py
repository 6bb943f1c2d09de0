"""``quadid-log repeat``: exit codes, files, a page that shows hostile names as text."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from quadid_logs.cli import main
from quadid_logs.data.result import Result
from quadid_logs.figures import Figure
from quadid_logs.figures.repetition_chart import repetition_figures
from quadid_logs.repetition import repeat
from quadid_logs.report.repetition_page import repetition_page
from tests.synthetic_results import refused_result
from tests.test_repeat import flights, flown

HOSTILE = "<img src=x onerror=alert(1)>"


@pytest.fixture
def analyzed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., None]:
    """Let logs be what their names say: a, b, c alike, "odd" with a tenth less of roll, "refused"."""
    alike = flights([438.0, 441.0, 440.0])
    found: dict[str, Result] = dict(zip("abc", alike, strict=True))
    found["odd"] = flights([0.0, 0.0, 0.0, 396.0])[3]
    found["refused"] = refused_result()
    monkeypatch.setattr(
        "quadid_logs.pipeline.analyze",
        lambda path, *_a, **_k: replace(
            found[Path(path).stem], log=replace(found[Path(path).stem].log, path=str(path))
        ),
    )
    monkeypatch.chdir(tmp_path)
    for name in found:
        (tmp_path / f"{name}.bin").touch()
    return lambda: None


@pytest.mark.parametrize(("last", "code"), [("c", 0), ("odd", 1)])
def test_the_exit_code_says_what_was_found(
    last: str, code: int, analyzed: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    """0 the flights agree, 1 one differs; stdout is plain text, its first line the verdict."""
    assert main(["repeat", "a.bin", "b.bin", f"{last}.bin"]) == code
    out, err = capsys.readouterr()
    assert err == ""
    assert out.startswith(
        "3 flights agree: roll " if code == 0 else "odd.bin is the outlier: 9.9 % less roll"
    )
    assert all(line.isprintable() for line in out.splitlines())


def test_too_few_flights_that_tell_end_with_3(
    analyzed: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    """One good and one refused flight: nothing was compared, and what to do is said."""
    assert main(["repeat", "a.bin", "refused.bin"]) == 3
    assert "  next: " in capsys.readouterr().out


@pytest.mark.parametrize("given", [["a.bin"], ["a.bin", "missing.bin"]])
def test_wrong_usage_ends_with_2(given: list[str], analyzed: Callable[..., None]) -> None:
    """One log is no repetition, and a missing one is named."""
    assert main(["repeat", *given]) == 2


def test_files_are_written_and_not_overwritten(
    analyzed: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    """--json prints what the file holds; a second run needs --force, and leaves no stale picture."""
    logs = ["a.bin", "b.bin", "c.bin"]
    assert main(["repeat", *logs, "-o", "out", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads(Path("out/repeat.json").read_text())
    assert printed["verdict"] == "agree"
    assert printed["left_out"]["held"] == printed["left_out"]["of"] > 0
    assert Path("out/repeat-funnel.png").read_bytes().startswith(b"\x89PNG")
    assert main(["repeat", *logs, "-o", "out"]) == 2
    assert main(["repeat", "a.bin", "refused.bin", "-o", "out", "--force"]) == 3
    assert {path.name for path in Path("out").iterdir()} == {"repeat.json", "repeat.html"}


def test_a_hostile_name_is_text_in_the_page() -> None:
    """The name of a log goes into headline, table and figure."""
    found = repeat([flown(0, f"{HOSTILE}.bin"), flown(1)])
    figures = [each for each in repetition_figures(found) if isinstance(each, Figure)]
    page = repetition_page(found, figures)
    assert HOSTILE not in page
    assert "&lt;img src=x" in page


def test_the_funnel_shows_each_flight_at_its_half_width() -> None:
    """Estimate along x, half of the interval along y, one panel an axis."""
    figure = next(iter(repetition_figures(repeat(flights([430.0, 440.0, 450.0], 12.0)))))
    assert isinstance(figure, Figure)
    assert [panel.title for panel in figure.panels] == ["Roll", "Pitch", "Yaw"]
    (dots,) = (curve for curve in figure.panels[0].curves if curve.label == "flights")
    assert dots.x.tolist() == [430.0, 440.0, 450.0]
    assert dots.y.tolist() == pytest.approx([12.0, 12.0, 12.0])
