"""Batches of gyro samples are read whatever is lost of them, and show what faster vibration there is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.data.health import Noise
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.settings import AlignSettings
from quadid_logs.health import health_of
from quadid_logs.load import prepare, read_log
from quadid_logs.simulator import simulate
from quadid_logs.writers.dataflash_writer import write_dataflash

RATE_HZ, LINE_HZ = 2000.0, 437.3
BATCH, PAUSE_S = 1024, 1.5
ISBH, ISBD = 164, 165
LENGTHS = {ISBH: 31, ISBD: 207}


def batches(line_rms: float, seed: int = 0) -> Signal:
    """Return batches of half a second with a line far above what any other message of the log holds."""
    starts_s = np.arange(32.0, 70.0, PAUSE_S)
    time_s = (starts_s[:, np.newaxis] + np.arange(BATCH) / RATE_HZ).ravel()
    values = 0.02 * np.random.default_rng(seed).standard_normal((time_s.size, 3))
    values[:, 1] += np.sqrt(2.0) * line_rms * np.sin(2.0 * np.pi * LINE_HZ * time_s)
    rows = Rows(time_s, np.arange(time_s.size))
    return Signal(name="gyro_samples", rows=rows, values=values, source="made")


@pytest.fixture(scope="module")
def flown() -> FlightLog:
    return simulate("hover", seed=1, duration_s=20.0, rate_hz=100.0, autopilot="ardupilot").log


@pytest.fixture
def written(flown: FlightLog, tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a flight with batches, and options of INS_LOG_BAT_OPT."""

    def write(*samples: Signal, option: int = 0) -> Path:
        log = replace(
            flown,
            signals={**flown.signals, "gyro_samples": samples},
            parameters={**flown.parameters, "INS_LOG_BAT_OPT": float(option), "INS_GYR_ID": 1.0},
        )
        path = tmp_path / "batches.BIN"
        with path.open("wb") as file:
            write_dataflash(log, file)
        return path

    return write


def noise_of(log: FlightLog) -> Noise:
    prepared = prepare(log)
    found = health_of(prepared, cut(prepared, AlignSettings())).noise
    assert found is not None
    return found


def test_samples_come_back_as_they_were_taken(written: Callable[..., Path]) -> None:
    """Times by the header's first sample and rate, values by its multiplier, to half of its step."""
    made = batches(0.3)
    (read,) = read_log(written(made)).candidates("gyro_samples")
    assert read.raw
    np.testing.assert_allclose(read.rows.time_s - read.rows.time_s[0], made.rows.time_s - 32.0, atol=2e-6)
    np.testing.assert_allclose(read.values, made.values, atol=0.51 * np.radians(2000.0) / 32767.0)


def test_others_read_the_batches_that_we_write(written: Callable[..., Path]) -> None:
    """With pymavlink: a header of each batch, then 32 rows of counts, the rates times the multiplier."""
    from pymavlink.DFReader import DFReader_binary

    made = batches(0.3)
    reader = DFReader_binary(str(written(made)))
    heads, counts = [], []
    while (message := reader.recv_match(type=["ISBH", "ISBD"])) is not None:
        if message.get_type() == "ISBH":
            heads.append(message)
        else:
            assert message.N == heads[-1].N
            counts.append(np.column_stack([message.x, message.y, message.z]) / heads[-1].mul)
    reader.filehandle.close()
    assert {(one.type, one.instance, one.smp_cnt) for one in heads} == {(1, 0, BATCH)}
    assert heads[0].smp_rate == pytest.approx(RATE_HZ)
    np.testing.assert_allclose(np.concatenate(counts), made.values, atol=0.51 * np.radians(2000.0) / 32767.0)


def test_a_line_above_half_of_the_logs_rate_is_found_in_the_batches(written: Callable[..., Path]) -> None:
    """The other messages of this log end at 50 Hz."""
    noise = noise_of(read_log(written(batches(0.05))))
    assert noise.before is not None
    assert noise.before.frequency_hz[-1] == pytest.approx(0.5 * RATE_HZ, rel=0.01)
    assert [line.frequency_hz for line in noise.lines["pitch"]] == pytest.approx([LINE_HZ], abs=0.5)
    assert noise.lines["pitch"][0].rms == pytest.approx(0.05, rel=0.1)
    assert not noise.lines["roll"]
    assert not noise.lines["yaw"]


def test_samples_in_front_of_the_filters_and_behind_them_are_told_apart(written: Callable[..., Path]) -> None:
    """Option 4 logs both: those behind have the numbers of the gyros plus how many there are."""
    before, behind = read_log(written(batches(0.05), batches(0.005, seed=1), option=4)).candidates(
        "gyro_samples"
    )
    assert (before.raw, behind.raw) == (True, False)
    assert behind.gyro_filter.low_pass_hz < 1000.0


def test_option_2_logs_what_the_filters_leave(written: Callable[..., Path]) -> None:
    """Then no gyro is raw."""
    (behind,) = read_log(written(batches(0.05), option=2)).candidates("gyro_samples")
    assert not behind.raw


def test_batches_change_nothing_but_the_spectrum(flown: FlightLog, written: Callable[..., Path]) -> None:
    """They stand in the file long after they were taken, and are no clock; no model is fitted to them."""
    with_batches = prepare(read_log(written(batches(0.05))))
    without = prepare(read_log(written()))
    assert with_batches.clean.clock.n_resets == 0
    assert with_batches.flights == without.flights
    assert with_batches.series["body_rate"].source == without.series["body_rate"].source


@pytest.mark.parametrize("lost", ["every tenth row", "every other header", "half of each batch", "damaged"])
def test_what_is_lost_of_the_batches_costs_only_itself(written: Callable[..., Path], lost: str) -> None:
    """Rows without their header belong to no batch; the line is still where it is."""
    path = written(batches(0.05))
    content = path.read_bytes()
    heads, rows = _places(content, ISBH), _places(content, ISBD)
    gone = {
        "every tenth row": rows[::10],
        "every other header": heads[::2],
        "half of each batch": [one for number, one in enumerate(rows) if number % 32 < 16],
        "damaged": [],
    }[lost]
    kept = np.ones(len(content), dtype=np.bool_)
    for place in gone:
        kept[place : place + LENGTHS[content[place + 2]]] = False
    damaged = bytearray(np.frombuffer(content, np.uint8)[kept].tobytes())
    if lost == "damaged":
        for place in rows[::20]:
            damaged[place : place + 40] = bytes(40)
    path.write_bytes(damaged)
    noise = noise_of(read_log(path))
    assert noise.before is not None
    assert [line.frequency_hz for line in noise.lines["pitch"]] == pytest.approx([LINE_HZ], abs=2.0)


def test_rows_without_their_header_are_no_part_of_the_batch_before(written: Callable[..., Path]) -> None:
    """Every other header lost: half of the batches are left, each as it was taken."""
    made = batches(0.05)
    path = written(made)
    content = path.read_bytes()
    heads = _places(content, ISBH)
    for place in reversed(heads[1::2]):
        content = content[:place] + content[place + LENGTHS[ISBH] :]
    path.write_bytes(content)
    (read,) = read_log(path).candidates("gyro_samples")
    expected = made.values.reshape(-1, BATCH, 3)[::2].reshape(-1, 3)
    np.testing.assert_allclose(read.values, expected, atol=0.51 * np.radians(2000.0) / 32767.0)


def test_headers_that_say_nonsense_give_no_samples(written: Callable[..., Path]) -> None:
    """A rate of nothing, a multiplier of nothing."""
    path = written(batches(0.05))
    content = bytearray(path.read_bytes())
    for number, place in enumerate(_places(content, ISBH)):
        if number % 2:
            content[place + 3 + 8 + 4 : place + 3 + 8 + 6] = b"\0\0"
        else:
            content[place + 27 : place + 31] = b"\0\0\xc0\x7f"
    path.write_bytes(content)
    assert not read_log(path).candidates("gyro_samples")


def _places(content: bytes, number: int) -> list[int]:
    """Return where the messages of a type begin: another one follows them."""
    mark, length = bytes([0xA3, 0x95, number]), LENGTHS[number]
    found, place = [], content.find(mark)
    while place >= 0:
        if content[place + length : place + length + 2] in (mark[:2], b""):
            found.append(place)
        place = content.find(mark, place + 1)
    return found
