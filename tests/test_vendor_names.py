"""Vendors' names live where vendors are known: in autopilots, containers, writers and the simulator."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "quadid_logs"
AT_HOME = ("autopilots", "containers", "writers", "simulator")
#: Vendors and their programs, parameters, messages.
NAMES = re.compile(
    r"\b(?:Ardu(?:Pilot|Copter|Plane)|PX4|Betaflight|INAV|QGroundControl|ardupilot|px4|betaflight)"
    r"|_?(?:PX4|px4|ardupilot)_"
    r"|\b(?:LOG_BITMASK|SDLOG_\w+|MOT_[A-Z]\w+|CA_ROTOR\w*|CA_AIRFRAME|INS_[A-Z]\w+|SID_[A-Z]\w+|IMU_GYRO\w*"
    r"|THR_MDL\w*|SYS_AUTOSTART|FRAME_(?:CLASS|TYPE)|SCHED_LOOP\w*|SERVO\w*_FUNCTION|ATC_[A-Z]\w+|PWM_MAIN\w*"
    r"|SYSID_\w+|MAV_SYS\w*)"
    r"|\b(?:RCOU|RCO2|MOTB|XKF1|PIDR|RATE\.[A-Z]\w*|[RPY]Out|SCALED_IMU\d?|actuator_(?:motors|outputs|controls\w*)"
    r"|vehicle_(?:torque_setpoint|angular_velocity|attitude|status))\b"
)
#: Each with the reason; a file that no longer needs its entry fails the second test.
EXCEPTIONS = {}


def files() -> Iterator[tuple[str, str]]:
    """Yield path and text of every file, code or template, that must not know a vendor."""
    for path in sorted(PACKAGE.rglob("*")):
        name = path.relative_to(PACKAGE).as_posix()
        if path.is_file() and "__pycache__" not in name and not name.startswith(AT_HOME):
            yield name, path.read_text(encoding="utf-8", errors="replace")


FILES = dict(files())


def found_in(text: str) -> list[str]:
    """Return the lines that name a vendor; a module's path is no name."""
    lines = (line.replace("quadid_logs.autopilots.", "") for line in text.splitlines())
    return [line.strip() for line in lines if NAMES.search(line)]


def test_no_file_outside_names_a_vendor() -> None:
    """What is one autopilot's belongs into its folder: then a new one is a new folder and nothing else."""
    found = {name: found_in(FILES[name]) for name in FILES.keys() - EXCEPTIONS.keys()}
    assert {name: names for name, names in found.items() if names} == {}


@pytest.mark.parametrize("name", sorted(EXCEPTIONS))
def test_no_exception_is_left_that_nothing_needs(name: str) -> None:
    """An entry for a clean or removed file would hide the next name in it."""
    assert found_in(FILES.get(name, "")), f"take {name} out of EXCEPTIONS"


def test_the_names_are_found_at_all() -> None:
    """The patterns find what they are for, in the folders that may know it."""
    for folder in ("ardupilot", "px4"):
        text = "".join(path.read_text() for path in (PACKAGE / "autopilots" / folder).glob("*.py"))
        assert len(found_in(text)) > 50
