"""Every sample of the gyro's FIFO is read, whatever is lost, and shows what faster vibration there is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.autopilots.px4.fifo import FIELDS, gyro_fifo
from quadid_logs.autopilots.sources import Part, Source
from quadid_logs.containers.ulog import TopicTable
from quadid_logs.data.health import Noise
from quadid_logs.data.log import FlightLog, Rows, Signal
from quadid_logs.data.settings import AlignSettings
from quadid_logs.health import health_of
from quadid_logs.load import prepare, read_log
from quadid_logs.simulator import simulate
from quadid_logs.writers.ulog_writer import write_ulog

RATE_HZ, LINE_HZ = 2000.0, 613.7


@pytest.fixture(scope="module")
def flown() -> FlightLog:
    return simulate("hover", seed=1, duration_s=20.0, rate_hz=100.0, autopilot="px4").log


@pytest.fixture(scope="module")
def made(flown: FlightLog) -> Signal:
    """Samples at 2 kHz with a line that no other message of the log can hold."""
    start_s, end_s = flown.candidates("body_rate")[0].rows.time_s[[0, -1]]
    time_s = np.arange(round(start_s, 3), end_s, 1.0 / RATE_HZ)
    values = 0.02 * np.random.default_rng(0).standard_normal((time_s.size, 3))
    values[:, 0] += np.sqrt(2.0) * 0.05 * np.sin(2.0 * np.pi * LINE_HZ * time_s)
    rows = Rows(time_s, np.arange(time_s.size))
    return Signal(name="gyro_samples", rows=rows, values=values, source="made", raw=True)


@pytest.fixture
def written(flown: FlightLog, tmp_path: Path) -> Callable[[Signal], Path]:
    """Return a function that writes a flight with what the gyro's FIFO held."""

    def write(samples: Signal) -> Path:
        path = tmp_path / "fifo.ulg"
        with path.open("wb") as file:
            write_ulog(replace(flown, signals={**flown.signals, "gyro_samples": (samples,)}), file)
        return path

    return write


def noise_of(path: Path) -> Noise:
    prepared = prepare(read_log(path))
    found = health_of(prepared, cut(prepared, AlignSettings())).noise
    assert found is not None
    return found


def test_samples_come_back_as_they_were_taken(made: Signal, written: Callable[[Signal], Path]) -> None:
    """The last one of each row at the row's time, values to half a count."""
    (read,) = read_log(written(made)).candidates("gyro_samples")
    n_whole = made.n_samples // 8 * 8
    assert read.raw
    assert read.n_samples == n_whole
    np.testing.assert_allclose(np.diff(read.rows.time_s), 1.0 / RATE_HZ, atol=2e-6)
    np.testing.assert_allclose(read.values, made.values[:n_whole], atol=0.51 * np.radians(2000.0) / 32768.0)


def test_others_read_the_fifo_that_we_write(made: Signal, written: Callable[[Signal], Path]) -> None:
    """With pyulog: eight samples in a row, counts of the scale."""
    from pyulog import ULog

    data = ULog(str(written(made))).get_dataset("sensor_gyro_fifo").data
    assert set(data["samples"]) == {8}
    found = np.column_stack([data[f"x[{place}]"] for place in range(8)]) * data["scale"][:, np.newaxis]
    n_whole = made.n_samples // 8 * 8
    np.testing.assert_allclose(
        found.ravel(), made.values[:n_whole, 0], atol=0.51 * np.radians(2000.0) / 32768.0
    )


def test_a_line_above_half_of_the_logs_rate_is_found_in_the_fifo(
    made: Signal, written: Callable[[Signal], Path]
) -> None:
    """The other topics of this log end at 50 Hz."""
    noise = noise_of(written(made))
    assert noise.before is not None
    assert noise.before.frequency_hz[-1] == pytest.approx(0.5 * RATE_HZ, rel=0.01)
    assert [line.frequency_hz for line in noise.lines["roll"]] == pytest.approx([LINE_HZ], abs=0.5)
    assert noise.lines["roll"][0].rms == pytest.approx(0.05, rel=0.1)
    assert not noise.lines["pitch"]
    assert not noise.lines["yaw"]


def test_dropouts_cost_only_what_was_lost(made: Signal, written: Callable[[Signal], Path]) -> None:
    """A tenth of a second is lost every two and a half: no row is stretched over it, the line stays."""
    kept = (made.rows.time_s * 10.0).astype(int) % 25 != 0
    rows = Rows(made.rows.time_s[kept], made.rows.position[kept])
    noise = noise_of(written(replace(made, rows=rows, values=made.values[kept])))
    assert [line.frequency_hz for line in noise.lines["roll"]] == pytest.approx([LINE_HZ], abs=0.5)


def fifo(**changes: object) -> TopicTable:
    """Return three rows of four samples."""
    axes = [(axis, "<i2", 32) for axis in "xyz"]
    rows = np.zeros(3, dtype=[*axes, ("dt", "<f4"), ("scale", "<f4"), ("samples", "u1")])
    rows["x"] = np.arange(32)
    rows["dt"], rows["scale"], rows["samples"] = 500.0, 0.001, 4
    for name, values in changes.items():
        rows[name] = values
    return TopicTable(name="sensor_gyro_fifo", multi_id=0, rows=rows, position=np.arange(3))


def built(table: TopicTable, time_s: tuple[float, ...] = (1.0, 1.002, 1.004)):
    part = Part(name="sensor_gyro_fifo", table=table, rows=Rows(np.array(time_s), table.position))
    return gyro_fifo(part, Source("gyro_samples", "sensor_gyro_fifo", FIELDS, ""))


def test_rows_are_as_far_apart_as_they_were_read() -> None:
    """A sensor whose clock is 10 % slow: its nominal period would let samples overlap."""
    found = built(fifo(), (1.0, 1.0022, 1.0044))
    assert found is not None
    assert found.rows is not None
    np.testing.assert_allclose(np.diff(found.rows.time_s)[3:], 0.00055)


@pytest.mark.parametrize(
    "changes",
    [
        {"samples": (4, 0, 200)},
        {"dt": (500.0, np.nan, 0.0)},
        {"scale": (0.001, np.inf, -1.0)},
    ],
)
def test_rows_that_say_nonsense_are_left_out(changes: dict[str, object]) -> None:
    """A count beyond the row's 32 places, a period of nothing, a scale of nothing."""
    found = built(fifo(**changes))
    assert found is not None
    assert len(found.values) == 4
    np.testing.assert_allclose(found.values[:, 0], 0.001 * np.arange(4), rtol=1e-6)


def test_a_topic_of_other_fields_gives_no_samples() -> None:
    """The format may be damaged, or another version's."""
    rows = np.zeros(3, dtype=[(name, "<f4") for name in FIELDS])
    assert built(TopicTable(name="sensor_gyro_fifo", multi_id=0, rows=rows, position=np.arange(3))) is None
