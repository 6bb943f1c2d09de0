"""Recordings of a streamed log: as sent where nothing is lost, readable and told where something is."""

from __future__ import annotations

import io
import random
import threading
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadid_logs.errors import LinkError, OutputError
from quadid_logs.link.block_stream import BlockStream
from quadid_logs.link.losses import Losses
from quadid_logs.link.record import Recorder
from quadid_logs.link.ulog_stream import ULogStream
from quadid_logs.load import read_log
from quadid_logs.pipeline import analyze
from quadid_logs.simulator import simulate
from quadid_logs.vocabulary import AXES, ON_AXIS
from quadid_logs.writers import write_log
from tests.link.fake_logger import BLOCKS, FRAMES, US, FakeLogger, dialect, ulog_messages, whole_messages

BOTH = pytest.mark.parametrize("autopilot", [FRAMES, BLOCKS], ids=["frames", "blocks"])


SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
#: The beginning: two thousand frames or blocks.
LOGS = {
    FRAMES: (SAMPLES / "products-of-inertia.ulg").read_bytes()[:400_000],
    BLOCKS: (SAMPLES / "sysid-quad-x.bin").read_bytes()[:400_000],
}


#: What a poor Wi-Fi link does; outages each 0.9 s.
ALL_FAULTS = {"loss": 0.05, "reorder": 0.01, "duplicate": 0.02, "outage_s": 0.044}


def record(vehicle: FakeLogger, folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[list[bytes], Losses]:
    """Record until the vehicle is disarmed; return the files and what was lost."""
    monkeypatch.setattr("quadid_logs.link.record.time", vehicle)
    recorder = Recorder(vehicle, folder)  # type: ignore[arg-type]
    recorder.run(threading.Event())
    return [path.read_bytes() for path in recorder.state.paths], recorder.state.losses


@BOTH
def test_without_loss_the_file_is_the_log_byte_for_byte(
    autopilot: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the vehicle would write it to its card."""
    (found,), losses = record(FakeLogger(LOGS[autopilot], autopilot), tmp_path, monkeypatch)
    assert found == whole_messages(LOGS[autopilot], autopilot)
    assert next(losses.sentences()).startswith("No frame was lost")


@BOTH
@pytest.mark.parametrize("fault", ["reorder", "duplicate", "other_client", "lost_answers", "left_on"])
def test_these_faults_cost_no_byte(
    autopilot: int, fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Late, repeated, foreign frames; an acknowledgement that got lost; a stream that was still on."""
    how = {"reorder": 0.01, "duplicate": 0.05, "other_client": True, "lost_answers": 1, "left_on": True}[
        fault
    ]
    vehicle = FakeLogger(LOGS[autopilot], autopilot, **{fault: how})  # type: ignore[arg-type]
    (found,), _ = record(vehicle, tmp_path, monkeypatch)
    assert found == whole_messages(LOGS[autopilot], autopilot)


@pytest.mark.parametrize("fault", [{"loss": 0.05}, ALL_FAULTS, {"outage_s": 3.0, "outage_every_s": 9}])
def test_blocks_that_get_lost_are_requested_again(
    fault: dict[str, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The vehicle keeps them until they are acknowledged."""
    (found,), losses = record(FakeLogger(LOGS[BLOCKS], BLOCKS, **fault), tmp_path, monkeypatch)  # type: ignore[arg-type]
    assert found == whole_messages(LOGS[BLOCKS], BLOCKS)
    assert any("requested again" in sentence for sentence in losses.sentences())


@pytest.mark.parametrize("first_number", [0, 65_000])
def test_lost_frames_leave_whole_messages_and_a_mark(
    first_number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every message of the file is one of the log, or a dropout; numbers begin anew after 65535."""
    vehicle = FakeLogger(LOGS[FRAMES], FRAMES, loss=0.05, first_number=first_number)
    (found,), losses = record(vehicle, tmp_path, monkeypatch)
    sent, kept = (messages(content) for content in (LOGS[FRAMES], found))
    dropouts = [message for message in kept if message[2:3] == b"O"]
    assert len(dropouts) == pytest.approx(losses.gaps, abs=2)
    assert set(kept) - set(dropouts) <= set(sent)
    assert len(kept) > 0.85 * len(sent)
    assert 0.03 < losses.frames / (losses.arrived + losses.frames) < 0.07


@pytest.mark.thorough
def test_a_flight_over_a_poor_link_is_still_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of the frames is missing, in a thousand places: the truth lies inside the intervals."""
    flight = simulate("doublets", autopilot="px4", rate_hz=250.0, duration_s=40.0)
    path = tmp_path / "flight.ulg"
    write_log(flight.log, path)
    log = path.read_bytes()
    # As fast as it was logged.
    step_s = 249 * 40.0 / len(log)
    vehicle = FakeLogger(log, FRAMES, step_s=step_s, **ALL_FAULTS)  # type: ignore[arg-type]
    _, losses = record(vehicle, tmp_path / "logs", monkeypatch)
    assert 0.05 < losses.frames / (losses.arrived + losses.frames) < 0.15
    assert "The log marks where" in next(losses.sentences())
    result = analyze(next((tmp_path / "logs").iterdir()))
    truth = np.diag(flight.truth["models"]["damped"]["B"]) / np.diag(flight.truth["torque_n_m_per_command"])
    assert result.diagnosis.usable
    assert result.identification.recommended is not None
    for axis, true in zip(AXES, truth, strict=True):
        low, high = result.identification.recommended.entries[ON_AXIS[axis]].ci95
        assert low < true < high


def messages(log: bytes) -> list[bytes]:
    """Return the messages of a ULog; the last one whole too."""
    begins = [*ulog_messages(log), len(log)]
    return [log[begin:after] for begin, after in pairwise(begins)]


def test_blocks_that_never_come_leave_no_half_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A row of which a half is zeros would be read as a sample."""
    sample = SAMPLES / "sysid-quad-x.bin"
    vehicle = FakeLogger(sample.read_bytes(), BLOCKS, never_again=frozenset({1000, 2000, 2001, 3000}))
    _, losses = record(vehicle, tmp_path, monkeypatch)
    assert (losses.frames, losses.gaps) == (4, 3)
    (path,) = tmp_path.iterdir()
    log, whole = read_log(path), read_log(sample)
    assert log.corrupt_bytes >= 800
    for signal in ("body_rate", "torque_command"):
        found, sent = log.signals[signal][0], whole.signals[signal][0]
        rows = np.searchsorted(sent.time_s, found.time_s)
        np.testing.assert_array_equal(found.values, sent.values[rows])
        assert 0 < len(sent.time_s) - len(found.time_s) < 40


@BOTH
def test_a_restart_of_the_vehicle_begins_another_file(
    autopilot: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both are logs; what happened is said."""
    log = LOGS[autopilot]
    vehicle = FakeLogger(log, autopilot, restarts_with=log, restarts_after=1000)
    (first, second), losses = record(vehicle, tmp_path, monkeypatch)
    assert second == whole_messages(log, autopilot)
    assert log.startswith(first)
    assert any("another file" in sentence for sentence in losses.sentences())


def test_a_stop_that_is_lost_is_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else the vehicle would go on streaming, and the next start would have no header."""
    vehicle = FakeLogger(LOGS[FRAMES], FRAMES, lost_stops=2)
    _, losses = record(vehicle, tmp_path, monkeypatch)
    assert vehicle.stops == 3
    assert losses.events == []


def test_a_stop_that_nobody_confirms_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The vehicle may need a restart."""
    _, losses = record(FakeLogger(LOGS[FRAMES], FRAMES, lost_stops=99), tmp_path, monkeypatch)
    assert "did not confirm" in losses.events[-1]


@pytest.mark.parametrize(
    ("vehicle", "words"),
    [
        (FakeLogger(LOGS[FRAMES], FRAMES, refuses=True), "refuses to stream"),
        (FakeLogger(LOGS[FRAMES], FRAMES, armed=True), "before arming"),
        (FakeLogger(LOGS[BLOCKS], BLOCKS, backend=1.0), "LOG_BACKEND_TYPE is 1.*Set it to 3"),
        (FakeLogger(LOGS[BLOCKS], 8), "cannot stream its log"),
    ],
)
def test_what_cannot_be_recorded_is_said_at_once(
    vehicle: FakeLogger, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With what to set, and no file."""
    with pytest.raises(LinkError, match=words):
        record(vehicle, tmp_path, monkeypatch)
    assert list(tmp_path.iterdir()) == []


@BOTH
def test_a_vehicle_that_is_gone_ends_the_recording(
    autopilot: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was flown until then stays."""
    log = LOGS[autopilot]
    vehicle = FakeLogger(log, autopilot, restarts_with=b"x", restarts_after=1000)
    vehicle._restart = lambda: setattr(vehicle, "_silent_until_s", 1e9)  # type: ignore[method-assign]
    (found,), losses = record(vehicle, tmp_path, monkeypatch)
    assert len(found) > 150_000
    assert log.startswith(found)
    assert "ended early" in losses.events[-1]


@BOTH
def test_what_was_recorded_is_in_the_file_at_any_time(
    autopilot: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a recording that is killed, too, all but the last second."""
    vehicle = FakeLogger(LOGS[autopilot], autopilot)
    monkeypatch.setattr("quadid_logs.link.record.time", vehicle)
    recorder = Recorder(vehicle, tmp_path)  # type: ignore[arg-type]
    seen = []

    def step() -> None:
        path = recorder.state.path
        if path is not None:
            seen.append(recorder.state.n_bytes)
            assert path.read_bytes()[: recorder.state.n_bytes] == LOGS[autopilot][: recorder.state.n_bytes]

    original = vehicle._step
    vehicle._step = lambda: (original(), step() if round(vehicle.now_s / 0.004) % 250 == 0 else None)[0]  # type: ignore[method-assign,func-returns-value]
    recorder.run(threading.Event())
    assert len(set(seen)) > 5


@BOTH
def test_nothing_that_is_there_is_overwritten(
    autopilot: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither a file nor what a link leads to."""
    outside = tmp_path / "outside"
    outside.write_bytes(b"kept")
    vehicle = FakeLogger(LOGS[autopilot], autopilot)
    monkeypatch.setattr("quadid_logs.link.record.time", vehicle)
    recorder = Recorder(vehicle, tmp_path / "logs")  # type: ignore[arg-type]
    for suffix in (".ulg", ".bin"):
        (tmp_path / "logs" / f"live-{recorder._begun:%Y-%m-%d-%H%M%S}{suffix}").symlink_to(outside)
    with pytest.raises(OutputError, match="cannot be written"):
        recorder.run(threading.Event())
    assert outside.read_bytes() == b"kept"


frames = st.tuples(st.integers(0, 65_535), st.binary(max_size=249), st.integers(0, 255), st.floats(0.0, 2.0))


@pytest.mark.thorough
@settings(max_examples=150, deadline=None)
@given(st.lists(frames, max_size=40), st.booleans())
def test_any_frames_make_a_file_of_whole_messages(
    sent: list[tuple[int, bytes, int, float]], begins: bool
) -> None:
    """In any order, with any content: no exception, and no more bytes than came, but for the marks."""
    file, now_s = io.BytesIO(), 0.0
    stream = ULogStream(file, losses := Losses())
    if begins:
        stream.take(0, b"ULog\x01\x12\x35" + bytes(9), 0, 0.0)
    for number, data, first, pause_s in sent:
        now_s += pause_s
        stream.take(number, data, first, now_s)
        stream.expire(now_s)
    stream.close(now_s)
    found = file.getvalue()
    assert len(found) == stream.n_bytes <= 16 + sum(len(data) for _, data, *_ in sent) + 5 * losses.gaps
    assert not found or [*ulog_messages(found + b"\0\0\0")][-1] == len(found)


blocks = st.tuples(
    st.integers(0, 40) | st.integers(0, 2**32 - 1), st.binary(max_size=60), st.floats(0.0, 3.0)
)


@pytest.mark.thorough
@settings(max_examples=150, deadline=None)
@given(st.lists(blocks, max_size=40))
def test_any_blocks_make_a_file_of_bounded_size(sent: list[tuple[int, bytes, float]]) -> None:
    """A number without a measure would make a file of 800 GB."""
    file, now_s = io.BytesIO(), 0.0
    stream = BlockStream(file, Losses())
    for number, data, pause_s in sent:
        now_s += pause_s
        stream.take(number, (data * 200)[:200] if data else bytes(200), now_s)
        assert len(stream.wanted(now_s)) <= 20
    stream.close(now_s)
    assert len(file.getvalue()) == stream.n_bytes <= 200 * 4096 * (len(sent) + 1)


@BOTH
def test_hostile_frames_are_contained(
    autopilot: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three thousand, valid by their checksums, between those of the log: no exception, no large file."""
    vehicle = FakeLogger(LOGS[autopilot], autopilot, hostile=hostile_packets(3000))
    found, losses = record(vehicle, tmp_path, monkeypatch)
    assert losses.senseless + losses.foreign > 100
    assert sum(map(len, found)) < 20 * len(LOGS[autopilot])


def hostile_packets(count: int) -> list[bytes]:
    """Return packets with random fields, and random bytes."""
    draw, mav = random.Random(11), dialect.MAVLink(None, srcSystem=1, srcComponent=1)

    def number(bits: int) -> int:
        return draw.choice([0, 1, (1 << bits) - 1, draw.getrandbits(bits)])

    def packet() -> bytes:
        who, data = (number(8), number(8)), draw.randbytes(249)
        if draw.random() < 0.3:
            data = b"ULog\x01\x12\x35" + data[7:]
        kind = draw.randrange(7)
        if kind < 2:
            make = (mav.logging_data_encode, mav.logging_data_acked_encode)[kind]
            return make(*(who if draw.random() < 0.3 else US), number(16), number(8), number(8), data).pack(
                mav
            )
        if kind == 2:
            return mav.remote_log_data_block_encode(*US, number(32), data[:200]).pack(mav)
        if kind == 3:
            return mav.command_ack_encode(draw.choice([2511, number(16)]), number(3) % 7).pack(mav)
        if kind == 4:
            return mav.param_value_encode(draw.randbytes(16), float("nan"), 9, 1, 0).pack(mav)
        if kind == 5:
            return mav.param_value_encode(
                b"LOG_BACKEND_TYPE", draw.choice([float("nan"), 1e30, 3.0]), 9, 1, 0
            ).pack(mav)
        return draw.randbytes(draw.randrange(1, 60))

    return [packet() for _ in range(count)]
