"""What is measured: one function per action, each taking the file's path (or the problem's size).

An action's result is kept until the memory has been read.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np

#: What `analyze` needs from each format: the fair task for a reader that can select.
DATAFLASH_NEEDED = [
    "RATE", "ANG", "ATT", "IMU", "RCOU", "MOTB", "ESC", "BAT", "PARM", "MODE", "ARM", "EV", "MSG", "SIDD",
    "SIDS",
]  # fmt: skip
TLOG_NEEDED = [
    "ATTITUDE", "ATTITUDE_QUATERNION", "ATTITUDE_TARGET", "RAW_IMU", "SCALED_IMU2", "HIGHRES_IMU",
    "SERVO_OUTPUT_RAW", "PARAM_VALUE", "HEARTBEAT", "SYS_STATUS", "EXTENDED_SYS_STATE", "STATUSTEXT",
]  # fmt: skip
ULOG_NEEDED = [
    "vehicle_angular_velocity", "vehicle_attitude", "vehicle_torque_setpoint", "vehicle_thrust_setpoint",
    "vehicle_rates_setpoint", "actuator_motors", "actuator_outputs", "esc_status", "sensor_combined",
    "vehicle_status", "vehicle_land_detected", "battery_status", "control_allocator_status", "actuator_armed",
]  # fmt: skip


def quadid_read_log(path: str) -> object:
    """Ours: everything that `analyze` takes from a log."""
    from quadid_logs.load import read_log

    return read_log(path)


def quadid_dataflash_needed(path: str) -> object:
    """Ours: every column of the messages that `analyze` needs."""
    from quadid_logs.containers.dataflash import read_messages

    return read_messages(path, DATAFLASH_NEEDED)


def quadid_ulog_needed(path: str) -> object:
    """Ours: every column of the topics that `analyze` needs."""
    from quadid_logs.containers.ulog import read_topics

    return read_topics(path, ULOG_NEEDED)


def quadid_tlog_needed(path: str) -> object:
    """Ours: every column of the messages that `analyze` needs."""
    from quadid_logs.containers.tlog import read_messages

    return read_messages(path, TLOG_NEEDED)


def quadid_dataflash_all(path: str) -> object:
    """Ours: every column of every message."""
    from quadid_logs.containers.dataflash import read_messages

    return read_messages(path)


def quadid_ulog_all(path: str) -> object:
    """Ours: every column of every topic."""
    from quadid_logs.containers.ulog import read_topics

    return read_topics(path)


def quadid_tlog_all(path: str) -> object:
    """Ours: every column of every message."""
    from quadid_logs.containers.tlog import read_messages

    return read_messages(path)


def quadid_blackbox_needed(path: str) -> object:
    """Ours: the fields that `analyze` needs."""
    from quadid_logs.autopilots.betaflight.dialect import BETAFLIGHT
    from quadid_logs.containers.blackbox import read_content

    return read_content(path, BETAFLIGHT.fields_of)


def quadid_blackbox_all(path: str) -> object:
    """Ours: every field of every frame."""
    from quadid_logs.containers.blackbox import read_content

    return read_content(path)


def _columns(receive: Callable[[], object]) -> dict[str, dict[str, np.ndarray]]:
    """Gather a reader's messages into columns, which is what any analysis needs."""
    rows: defaultdict[str, defaultdict[str, list[object]]] = defaultdict(lambda: defaultdict(list))
    while (message := receive()) is not None:
        table = rows[message.get_type()]  # type: ignore[attr-defined]
        for name in message.get_fieldnames():  # type: ignore[attr-defined]
            table[name].append(getattr(message, name))
    return {
        kind: {
            name: np.array(values, dtype=None if _plain(values) else object) for name, values in table.items()
        }
        for kind, table in rows.items()
    }


def _plain(values: list[object]) -> bool:
    """Tell numbers and texts from lists, whose lengths may differ."""
    return not isinstance(values[0], list)


def pymavlink_dataflash_all(path: str) -> object:
    """pymavlink: every message."""
    from pymavlink.DFReader import DFReader_binary

    return _columns(DFReader_binary(path).recv_msg)


def pymavlink_dataflash_needed(path: str) -> object:
    """pymavlink: the messages that `analyze` needs, by its own fast skipping."""
    from pymavlink.DFReader import DFReader_binary

    reader = DFReader_binary(path)
    return _columns(lambda: reader.recv_match(type=DATAFLASH_NEEDED))


def pymavlink_tlog_all(path: str) -> object:
    """pymavlink: every message."""
    from pymavlink import mavutil

    return _columns(mavutil.mavlink_connection(path, dialect="ardupilotmega").recv_msg)


def pymavlink_tlog_needed(path: str) -> object:
    """pymavlink: the messages that `analyze` needs."""
    from pymavlink import mavutil

    connection = mavutil.mavlink_connection(path, dialect="ardupilotmega")
    return _columns(lambda: connection.recv_match(type=TLOG_NEEDED))


def pyulog_all(path: str) -> object:
    """pyulog: every topic."""
    from pyulog import ULog

    return ULog(path)


def pyulog_needed(path: str) -> object:
    """pyulog: the topics that `analyze` needs."""
    from pyulog import ULog

    return ULog(path, ULOG_NEEDED)


def orangebox_all(path: str) -> object:
    """orangebox: every field of every main frame; it cannot select."""
    from orangebox import Parser

    return np.array([frame.data for frame in Parser.load(path).frames() if frame.type.value in ("I", "P")])


def mavparser_all(path: str) -> object:
    """mavparser: every message, as the list of dictionaries that it returns."""
    import mavparser

    return mavparser.parse(path)


def fasttlogparser_all(path: str) -> object:
    """fasttlogparser: every message."""
    import fasttlogparser

    return fasttlogparser.parseTLog(path)


def signalviewer_all(path: str) -> object:
    """signalviewer: every signal."""
    import signalviewer

    return signalviewer.load(path)


def quadid_windows(count: str) -> object:
    """Ours: so many H_k of eq. (5), 9 samples by 9 unknowns, six targets each."""
    from quadid_logs.maths.sliding_windows import solve_windows, stack_windows

    rng = np.random.default_rng(0)
    n = int(count) + 8
    regressors = stack_windows(rng.standard_normal((n, 9)), width=9, stride=1)
    targets = stack_windows(rng.standard_normal((n, 6)), width=9, stride=1)
    return solve_windows(regressors, targets)


def quadid_simulate(duration_s: str) -> object:
    """Ours: a closed-loop flight of that length, logged at 400 Hz and written as .bin."""
    from quadid_logs.simulator import simulate
    from quadid_logs.writers import write_log

    flight = simulate("sysid-quad-x", seed=0, duration_s=float(duration_s), rate_hz=400.0)
    with tempfile.TemporaryDirectory() as folder:
        write_log(flight.log, Path(folder) / "flight.bin")
    return flight


def quadid_analyze(path: str) -> object:
    """Ours: the whole chain without a report."""
    from quadid_logs.pipeline import analyze

    return analyze(path)


def quadid_cli_info(path: str) -> object:
    """Ours: ``quadid-log info LOG`` in a process of its own, start included."""
    return _command("info", path)


def quadid_cli_json(path: str) -> object:
    """Ours: ``quadid-log analyze LOG --json --no-report`` in a process of its own, start included."""
    return _command("analyze", path, "--json", "--no-report")


def quadid_cli_report(path: str) -> object:
    """Ours: ``quadid-log analyze LOG -o DIR`` in a process of its own; returns the stages' times."""
    with tempfile.TemporaryDirectory() as folder:
        _command("analyze", path, "-o", folder)
        (result,) = Path(folder).glob("*/result.json")
        return json.loads(result.read_text(encoding="utf-8"))["timings_s"]


def _command(*arguments: str) -> object:
    """Run the command line; an axis that is not to be trusted (exit code 1) is fine."""
    command = [sys.executable, "-c", "from quadid_logs.cli import run; run()", *arguments]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False, text=True)
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stderr)
    return None
