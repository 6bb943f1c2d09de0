"""What every reader promises, on a log of each kind; `docs/extending.md` asks the same of a new one."""

from __future__ import annotations

import inspect
import random
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from quadid_logs import autopilots
from quadid_logs.data.log import FlightLog, Signal
from quadid_logs.errors import LogError
from quadid_logs.load import read_log
from quadid_logs.simulator import simulate
from quadid_logs.vocabulary import SIGNALS, VEHICLE_TYPES
from quadid_logs.writers import write_log
from tests.containers import blackbox_maker as blackbox
from tests.containers import dataflash_files as dataflash

from . import toy

KINDS = ("bin", "ulg", "tlog", "text", "sdlog2", "csv", "parquet", "bbl", "usd", "toy")
#: Of a table no byte is a message's, and a Parquet file has its columns one after the other.
WITHOUT_LOST_BYTES = ("csv", "parquet")


def text_log() -> str:
    """Return a DataFlash log as text."""
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 140, 17, ATT, QccC, TimeUS,Roll,Pitch,Yaw",
        "FMT, 141, 47, RATE, Qfffffffff, TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut",
    ]
    for k in range(200):
        lines.append(f"RATE, {1000 * k + 1}, " + ", ".join(f"{0.01 * k * n:.4f}" for n in range(9)))
        lines.append(f"ATT, {1000 * k + 2}, {0.01 * k:.2f}, {-0.02 * k:.2f}, {0.5 * k:.2f}")
    return "\n".join(lines) + "\n"


def sdlog2_log() -> bytes:
    """Return a legacy PX4 log."""
    labels = "Roll,Pitch,Yaw,RollRate,PitchRate,YawRate"
    content = dataflash.FMT_OF_FMT + dataflash.fmt(129, "TIME", "Q", "StartTime")
    content += dataflash.fmt(2, "ATT", "ffffff", labels) + dataflash.fmt(
        3, "ATTC", "ffff", "Roll,Pitch,Yaw,Thrust"
    )
    for k in range(200):
        content += dataflash.row(129, "Q", 4000 * k) + dataflash.row(
            2, "ffffff", *(0.01 * k * n for n in range(6))
        )
        content += dataflash.row(3, "ffff", *(0.001 * k * n for n in range(4)))
    return content


def blackbox_log() -> bytes:
    """Return a Blackbox log of slow motion."""
    wave = 100.0 * np.sin(0.01 * np.arange(2000)[:, np.newaxis] * np.arange(1, len(blackbox.NAMES) + 1))
    rows = np.rint(wave).astype(int) + 1000
    rows[:, 0] = np.arange(len(rows))
    rows[:, 1] = 1000 * rows[:, 0] + 5_000_000
    return blackbox.log(rows.tolist())


def table_columns() -> dict[str, np.ndarray]:
    """Return columns with canonical names."""
    time_s = np.arange(300) * 0.004
    names = [
        name for signal in ("body_rate", "torque_command", "throttle") for name in SIGNALS[signal].columns
    ]
    return {"time_s": time_s} | {name: np.sin(time_s * (k + 1.0)) for k, name in enumerate(names)}


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Write a log of every kind."""
    folder = tmp_path_factory.mktemp("kinds")
    paths = {kind: folder / f"log.{kind}" for kind in KINDS}
    for kind, autopilot in (
        ("bin", "ardupilot"),
        ("ulg", "px4"),
        ("tlog", "ardupilot"),
        ("usd", "crazyflie"),
    ):
        flight = simulate("sysid-quad-x", seed=1, duration_s=15.0, rate_hz=50.0, autopilot=autopilot)
        write_log(flight.log, paths[kind])
    paths["text"].write_text(text_log())
    paths["sdlog2"].write_bytes(sdlog2_log())
    paths["bbl"].write_bytes(blackbox_log())
    columns = table_columns()
    rows = [",".join(f"{value:.9g}" for value in row) for row in zip(*columns.values(), strict=True)]
    paths["csv"].write_text("\n".join([",".join(columns), *rows]) + "\n")
    parquet.write_table(pa.table(columns), paths["parquet"])
    paths["toy"].write_text(
        "TOY1\n" + "".join(f"GYRO {4 * k} {k} 0 1\nCMD {4 * k} 1 2 {k} 50\n" for k in range(200))
    )
    return paths


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """The template must keep the promises too."""
    monkeypatch.setattr(autopilots, "_registered", [toy.AUTOPILOT])


@pytest.fixture(params=KINDS)
def path(request: pytest.FixtureRequest, logs: dict[str, Path]) -> Path:
    """Return the log of one kind."""
    return logs[request.param]


def signals_of(log: FlightLog) -> Iterator[Signal]:
    """Yield every source of every signal."""
    for sources in log.signals.values():
        yield from sources


def check_words(log: FlightLog) -> None:
    """Names are canonical, and each source says what it is and why it has its place."""
    assert log.format in {*(each.name for each in autopilots.formats()), "toy"}
    assert log.vehicle_type in VEHICLE_TYPES
    for name, sources in log.signals.items():
        assert all(signal.name == name and signal.source and signal.reason for signal in sources)
        assert len({signal.source for signal in sources}) == len(sources)


def check_order(log: FlightLog) -> None:
    """Rows stand in file order, inside the file."""
    for signal in signals_of(log):
        assert (np.diff(signal.position) >= 0).all()
        assert (signal.position >= 0).all()
        assert (signal.position < log.n_bytes).all()


def check_shared_rows(log: FlightLog) -> None:
    """Rows of one message stand at the same places: then they are one object."""
    for one, other in combinations(signals_of(log), 2):
        if one.n_samples and np.array_equal(one.position, other.position):
            assert one.rows is other.rows, f"{one.source} and {other.source}"


def check_lost(log: FlightLog) -> None:
    """Lost bytes are inside the file, in order, each counted once, and no signal's row begins in them."""
    ends = [0]
    for lost in log.lost:
        assert lost.n_bytes > 0
        assert lost.offset >= ends[-1]
        assert lost.reason
        ends.append(lost.offset + lost.n_bytes)
    assert ends[-1] <= log.n_bytes
    edges = np.array([(lost.offset, lost.offset + lost.n_bytes) for lost in log.lost]).reshape(-1, 2)
    for signal in signals_of(log):
        inside = np.searchsorted(edges.ravel(), signal.position, side="right") % 2
        assert not inside.any(), signal.source


def check_same(one: FlightLog, other: FlightLog) -> None:
    """Two readings hold the same."""
    assert list(one.signals) == list(other.signals)
    for first, second in zip(signals_of(one), signals_of(other), strict=True):
        assert (first.source, first.reason) == (second.source, second.reason)
        np.testing.assert_array_equal(first.time_s, second.time_s)
        np.testing.assert_array_equal(first.position, second.position)
        np.testing.assert_array_equal(first.values, second.values)
    assert (one.parameters, one.modes, one.texts, one.lost, one.remarks) == (
        other.parameters,
        other.modes,
        other.texts,
        other.lost,
        other.remarks,
    )


def check_promises(log: FlightLog) -> None:
    """All of them but repetition."""
    check_words(log)
    check_order(log)
    check_shared_rows(log)
    check_lost(log)


def opened(path: Path) -> FlightLog | None:
    """Read a file that may be no log; a refusal must say what to do."""
    try:
        return read_log(path)
    except LogError as error:
        refusal = error
    assert refusal.hint, path.name
    return None


def test_signals_are_canonical_and_say_where_they_are_from(path: Path) -> None:
    """The report shows source and reason."""
    check_words(read_log(path))


def test_rows_stand_in_file_order(path: Path) -> None:
    """The clock tells a reboot from an out-of-order row by the place in the file."""
    check_order(read_log(path))


def test_signals_of_one_message_share_their_rows(path: Path) -> None:
    """What is found out about the stamps of a message is found out once."""
    log = read_log(path)
    check_shared_rows(log)
    assert len({id(signal.rows) for signal in signals_of(log)}) < len(list(signals_of(log)))


def test_of_an_intact_log_nothing_is_lost(path: Path) -> None:
    """Lost bytes are a finding."""
    assert read_log(path).lost == ()


def test_the_same_bytes_give_the_same_log(path: Path, tmp_path: Path) -> None:
    """Under another name, after another log."""
    copy = tmp_path / "copy"
    copy.write_bytes(path.read_bytes())
    check_same(read_log(path), read_log(copy))


@pytest.mark.parametrize("fraction", [0.001, 0.1, 0.37, 0.5, 0.9, 0.9999])
def test_a_log_cut_off_gives_no_row_that_the_whole_one_has_not(
    path: Path, fraction: float, tmp_path: Path
) -> None:
    """A truncated copy opens with the rows before the cut, or says why not."""
    content = path.read_bytes()
    (tmp_path / "cut").write_bytes(content[: int(fraction * len(content))])
    log = opened(tmp_path / "cut")
    if log is None:
        return
    check_promises(log)
    whole = {signal.source: signal for signal in signals_of(read_log(path))}
    for signal in signals_of(log):
        if signal.source in whole:
            assert np.isin(signal.position, whole[signal.source].position).all()


@pytest.mark.parametrize("seed", range(4))
def test_noise_in_a_log_is_lost_and_nothing_else(path: Path, seed: int, tmp_path: Path) -> None:
    """A damaged block: the promises hold, and what cannot be read is told."""
    rng = random.Random(seed)
    content = bytearray(path.read_bytes())
    start = rng.randrange(len(content) // 4, len(content) - 400)
    content[start : start + 300] = rng.randbytes(300)
    (tmp_path / "damaged").write_bytes(content)
    log = opened(tmp_path / "damaged")
    if log is None:
        return
    check_promises(log)
    if path.suffix[1:] not in WITHOUT_LOST_BYTES:
        assert 100 <= log.corrupt_bytes <= 3000
        assert all(start - 3000 <= lost.offset <= start + 300 for lost in log.lost)


@pytest.mark.parametrize("seed", range(3))
def test_garbage_behind_the_first_bytes_raises_nothing_but_log_errors(
    path: Path, seed: int, tmp_path: Path
) -> None:
    """A file that only begins like a log."""
    head = path.read_bytes()[:64]
    (tmp_path / "garbage").write_bytes(head + random.Random(seed).randbytes(5000))
    log = opened(tmp_path / "garbage")
    if log is not None:
        check_promises(log)


@pytest.mark.corpus
@pytest.mark.thorough
def test_every_log_of_the_corpus_keeps_the_promises(corpus: Path) -> None:
    """Flown, damaged and simulated logs of all formats."""
    folders = [
        corpus / name for name in ("real", "firmware", "damaged", "blackbox", "flown/crazyswarm2/logs")
    ]
    logs = [opened(path) for folder in folders for path in sorted(folder.iterdir())]
    read = [log for log in logs if log is not None]
    for log in read:
        check_promises(log)
    assert len(read) > 50


METHODS = [name for name, _ in inspect.getmembers(autopilots.Autopilot, inspect.isfunction) if name[0] != "_"]


@pytest.mark.parametrize("autopilot", autopilots.known(), ids=lambda one: one.name)
@pytest.mark.parametrize("method", METHODS)
def test_an_autopilot_takes_what_every_autopilot_takes(autopilot: autopilots.Autopilot, method: str) -> None:
    """By name and kind, with the same defaults: also of functions that stand in other modules."""
    expected = [*inspect.signature(getattr(autopilots.Autopilot(), method)).parameters.values()]
    found = [*inspect.signature(getattr(autopilot, method)).parameters.values()]
    assert [(one.name, one.kind, one.default) for one in found] == [
        (one.name, one.kind, one.default) for one in expected
    ]
