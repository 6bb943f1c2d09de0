"""The plan for a Crazyflie: what the deck logs, and a script that flies."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from types import ModuleType
from unittest.mock import MagicMock

import pytest

from quadid_logs.cli import main
from quadid_logs.load import read_log
from tests.containers import usd_maker as maker
from tests.synthetic_results import synthetic_prediction


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a plan for roll and yaw."""
    path = tmp_path_factory.mktemp("plan")
    arguments = ["--autopilot", "crazyflie", "--axis", "roll", "--axis", "yaw", "-o", str(path / "p")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("quadid_logs.planning.predict", lambda *_a: synthetic_prediction())
        assert main(["plan", *arguments]) == 0
    return path / "p"


def variables(folder: Path) -> list[str]:
    """Return the log variables of the configuration."""
    lines = [line.split("#")[0].strip() for line in (folder / "config.txt").read_text().splitlines()]
    assert lines[:4] == ["1", "4096", "log", "0"]
    assert lines[4:7] == ["on:fixedFrequency", "250", "1"]
    return lines[7:]


def test_the_deck_logs_no_more_than_its_firmware_takes(folder: Path) -> None:
    """Twenty variables of up to 29 characters, each once."""
    found = variables(folder)
    assert len(found) == len(set(found)) <= 20
    assert all(len(name) < 30 for name in found)


def test_what_the_deck_logs_is_all_that_an_analysis_wants(folder: Path, tmp_path: Path) -> None:
    """Rates, set-points, torque, throttle, attitude, accelerometer, battery and state."""
    names = variables(folder)
    types: dict[int, maker.Type] = {
        0xFFFF: ("fixedFrequency", [(name, "H" if name == "supervisor.info" else "f") for name in names])
    }
    rows = [maker.Event(0xFFFF, 4000 * k, [k + place for place in range(len(names))]) for k in range(50)]
    (tmp_path / "log00").write_bytes(maker.log(types, rows))
    assert set(read_log(tmp_path / "log00").signals) == {
        "body_rate", "body_rate_setpoint", "torque_command", "throttle", "attitude", "specific_force",
        "battery_voltage", "armed", "landed",
    }  # fmt: skip


def test_the_script_arms_flies_its_axes_lands_and_ends_the_log(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Run against the vendor's library as far as it is called, on a clock that runs fast."""
    now = iter(range(10**9))
    monkeypatch.setattr(time, "monotonic", lambda: 0.05 * next(now))
    monkeypatch.setattr(time, "sleep", lambda _: None)
    link = MagicMock()
    for name in ("cflib", "cflib.crtp", "cflib.crazyflie", "cflib.crazyflie.syncCrazyflie"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    sys.modules["cflib"].crtp = sys.modules["cflib.crtp"]  # type: ignore[attr-defined]
    sys.modules["cflib.crtp"].init_drivers = MagicMock()  # type: ignore[attr-defined]
    sys.modules["cflib.crazyflie.syncCrazyflie"].SyncCrazyflie = MagicMock(return_value=link)  # type: ignore[attr-defined]
    monkeypatch.setattr(sys, "argv", ["fly.py"])
    exec(compile((folder / "fly.py").read_text(), "fly.py", "exec"), {"__name__": "__main__"})
    crazyflie = link.__enter__.return_value.cf
    flown = {call.args[:3] for call in crazyflie.commander.send_zdistance_setpoint.call_args_list}
    assert flown == {(12.0, 0.0, 0.0), (-12.0, -0.0, -0.0), (0.0, 0.0, 150.0), (-0.0, -0.0, -150.0)}
    assert [call.args for call in crazyflie.param.set_value.call_args_list] == [
        ("usd.logging", 1), ("usd.logging", 0),
    ]  # fmt: skip
    crazyflie.platform.send_arming_request.assert_called_once_with(True)
    crazyflie.high_level_commander.land.assert_called_once()
