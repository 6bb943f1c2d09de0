"""The script that moves a PX4 vehicle by rate set-points: it keeps its limits, and ends when it has to."""

from __future__ import annotations

import math
import sys
import types
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import pytest

from quadid_logs.planning import make_plan

OFFBOARD, POSITION, AUTO = 6, 3, 4


class Link:
    """A vehicle that hovers, answers for parameters, and is heard at every step of a clock of its own."""

    def __init__(self, event: Callable[[Link], None], event_s: float) -> None:
        self.time_s, self.event, self.event_s = 0.0, event, event_s
        self.target_system = self.target_component = 1
        self.mode, self.silent, self.battery, self.roll, self.height_m = POSITION, False, 80, 0.01, 12.0
        self.parameters = {
            "COM_OF_LOSS_T": 0.5,
            "COM_OBL_RC_ACT": 0.0,
            "COM_RC_OVERRIDE": 3.0,
            "MPC_THR_HOVER": 0.4,
        }
        self.asked, self.queue, self.sent, self.commands = "", [], [], []  # type: ignore[var-annotated]
        self.mav = SimpleNamespace(
            param_request_read_send=self._ask,
            set_attitude_target_send=lambda *values: self.sent.append((self.time_s, values)),
            command_long_send=lambda *values: self.commands.append(values),
        )

    def _ask(self, _system: int, _component: int, name: bytes, _index: int) -> None:
        self.asked = name.decode()

    def wait_heartbeat(self, timeout: float) -> None:
        """Return at once."""

    def sleep(self, seconds: float) -> None:
        """Let time pass: messages arrive, the pilot switches after a second, and the event happens."""
        self.time_s += seconds
        if self.time_s >= 1.0 and self.mode == POSITION and self.sent:
            self.mode = OFFBOARD
        if self.time_s >= self.event_s:
            self.event_s = math.inf
            self.event(self)
        if not self.silent:
            place = {"x": 0.0, "y": 0.0, "z": -self.height_m, "vx": 0.0, "vy": 0.0, "vz": 0.0}
            self.queue += [
                self._message("HEARTBEAT", custom_mode=self.mode << 16),
                self._message("ATTITUDE", roll=self.roll, pitch=0.0, yaw=0.3),
                self._message("LOCAL_POSITION_NED", **place),
                self._message("SYS_STATUS", battery_remaining=self.battery),
            ]

    @staticmethod
    def _message(kind: str, **values: float) -> SimpleNamespace:
        return SimpleNamespace(**values, get_type=lambda: kind, get_srcSystem=lambda: 1)

    def recv_match(self, **wanted: Any) -> Any:
        """Return a parameter that was asked for, or what has arrived."""
        if wanted.get("type") == "PARAM_VALUE":
            return SimpleNamespace(param_id=self.asked, param_value=self.parameters[self.asked])
        return self.queue.pop(0) if self.queue else None


def flown(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    event: Callable[[Link], None] = lambda _: None,
    event_s: float = 10.0,
    **parameters: float,
) -> tuple[Link, str]:
    """Run the script of a plan against the vehicle; return what it did, and what it said last."""
    link = Link(event, event_s)
    link.parameters |= parameters
    mavutil = SimpleNamespace(
        mavlink_connection=lambda _: link,
        mavlink=SimpleNamespace(MAV_CMD_DO_SET_MODE=176, MAV_MODE_FLAG_CUSTOM_MODE_ENABLED=1),
    )
    monkeypatch.setitem(sys.modules, "pymavlink", SimpleNamespace(mavutil=mavutil))
    monkeypatch.setattr(sys, "argv", ["excite.py"])
    module = types.ModuleType("excite")
    exec(compile(script(), "excite.py", "exec"), module.__dict__)
    module.time = SimpleNamespace(monotonic=lambda: link.time_s, sleep=link.sleep)  # type: ignore[attr-defined]
    module.main()
    return link, capsys.readouterr().out.splitlines()[-1]


@cache
def script() -> str:
    """Return the script of a plan for a vehicle that is not known."""
    return make_plan("px4").script_files()["excite.py"]


def test_an_undisturbed_flight_ends_after_its_two_periods(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """41 s from Offboard on; then it holds its place."""
    link, said = flown(monkeypatch, capsys, event_s=1e9)
    assert said == "Ended by its end."
    assert link.sent[-1][0] == pytest.approx(42.0, abs=0.5)
    assert link.commands[0][4:8] == (1, 4, 3, 0)


def test_no_rate_leaves_its_limit(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Beside what levels the vehicle, 0.02 rad/s here; thrust stays around hovering."""
    planned = make_plan("px4")
    link, _ = flown(monkeypatch, capsys, event_s=1e9)
    for number, axis in enumerate(("roll", "pitch", "yaw")):
        largest = max(abs(values[5 + number]) for _, values in link.sent)
        assert 0.01 < largest <= planned.excitations[axis].peak_rate_rad_s / 3.0 + 0.021
    assert all(0.2 <= values[8] <= 0.6 for _, values in link.sent)


@pytest.mark.parametrize(
    ("event", "word"),
    [
        (lambda link: setattr(link, "mode", POSITION), "mode"),
        (lambda link: setattr(link, "roll", 0.7), "tilt"),
        (lambda link: setattr(link, "height_m", 6.0), "height"),
        (lambda link: setattr(link, "battery", 20), "battery"),
        (lambda link: setattr(link, "silent", True), "link"),
    ],
)
def test_a_danger_ends_the_set_points(
    event: Callable[[Link], None],
    word: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Within half a second, after which the vehicle's own failsafe would."""
    link, said = flown(monkeypatch, capsys, event)
    assert word in said
    assert link.sent[-1][0] < 10.6


def test_without_its_failsafes_it_does_not_begin(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A link that breaks would leave the last rate in force for COM_OF_LOSS_T."""
    link, said = flown(monkeypatch, capsys, COM_OF_LOSS_T=30.0)
    assert "COM_OF_LOSS_T" in said
    assert not link.sent


def test_nothing_faster_than_five_hertz_is_sent() -> None:
    """A stream of 50 Hz with jitter has ten set-points to a cycle then."""
    namespace: dict[str, Any] = {}
    line = next(line for line in script().splitlines() if line.startswith("MULTISINE"))
    exec(line, namespace)
    assert max(hz for axis in namespace["MULTISINE"]["lines"] for hz, _ in axis) <= 5.0


def test_failsafes_have_a_way_back_where_the_vehicle_s_own_are_known() -> None:
    """COM_OF_LOSS_T is a real number, the others are integers: QGroundControl's types 9 and 6."""
    parameters = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 3.0, "COM_RC_OVERRIDE": 1.0}
    files = make_plan("px4", [], None, parameters).script_files()
    rows = [line.split("\t")[2:] for line in files["offboard-back.params"].splitlines() if "COM_" in line]
    assert rows == [["COM_OF_LOSS_T", "1", "9"], ["COM_OBL_RC_ACT", "3", "6"], ["COM_RC_OVERRIDE", "1", "6"]]
