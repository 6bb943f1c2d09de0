"""``quadid-log check``: its exit codes, for scripts."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from quadid_logs.cli import main
from quadid_logs.data.result import Result
from tests.cli.test_tune import changed, fly, refused, values
from tests.tuned_flights import as_flown, flown

pytestmark = pytest.mark.usefixtures("quick_multisines")

__all__ = ["fly"]


def followed() -> Result:
    """The vehicle with the gains of the file."""
    return as_flown(changed(flown("ardupilot")), **values(Path("tune/1/next.param")))


def test_check_exits_by_what_became_of_the_promise(
    fly: Callable[..., Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """0 kept, 1 broken, 3 not comparable; terminal and JSON say the same."""
    weak = changed(flown("ardupilot"))
    main(["tune", str(fly("1.BIN", weak)), "-o", "tune"])
    assert "quadid-log check NEXT-LOG --promise tune/1" in capsys.readouterr().out
    assert (Path("tune/1") / "promise.json").is_file()
    after = followed()
    second = fly("2.BIN", after)
    assert main(["check", str(second), "--promise", "tune/1"]) == 0
    assert "the promise was kept" in capsys.readouterr().out
    assert main(["check", str(second), "--promise", "tune/1/promise.json", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "kept"
    assert main(["check", str(fly("3.BIN", weak)), "--promise", "tune/1"]) == 1
    assert "the next ones were not loaded" in capsys.readouterr().out
    other = replace(after, log=replace(after.log, frame="HEXA/X"))
    assert main(["check", str(fly("4.BIN", other)), "--promise", "tune/1"]) == 3
    assert main(["check", str(second), "--promise", "nowhere"]) == 2


def test_a_refusal_takes_the_promise_of_an_earlier_run_away(
    fly: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Gains that are no longer recommended are no longer promised."""
    weak = changed(flown("ardupilot"))
    log = fly("1.BIN", weak)
    main(["tune", str(log), "-o", "tune"])
    monkeypatch.setattr("quadid_logs.pipeline.analyze", lambda *_a, **_k: refused(weak))
    assert main(["tune", str(log), "-o", "tune", "--force"]) == 1
    assert not Path("tune/1/promise.json").exists()
