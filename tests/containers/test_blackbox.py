"""Blackbox frames: every encoding and predictor, faults, several logs in a file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.containers.blackbox import BlackboxContent, FrameTable, is_mine, read_content
from quadid_logs.errors import EmptyLogError, SettingsError, SeveralLogsError, UnknownFormatError

from . import blackbox_maker as maker


def rows(count: int, *, step: int = 1, size: float = 30.0, seed: int = 0) -> list[list[int]]:
    """Return random values of any size, loop and time rising."""
    rng = np.random.default_rng(seed)
    values = np.rint(size ** rng.uniform(0.0, 2.2, (count, len(maker.NAMES))))
    values *= rng.choice([-1, 0, 1], values.shape)
    # A change of a set-point must be a number of 16 bits.
    setpoints = slice(maker.NAMES.index("setpoint[0]"), maker.NAMES.index("setpoint[3]") + 1)
    values[:, setpoints] = np.clip(values[:, setpoints], -16000, 16000)
    values[:, 0] = 64 + step * np.arange(count)
    values[:, 1] = 5_000_000 + 250 * values[:, 0] + rng.integers(-20, 20, count)
    for name, low in (("vbatLatest", 1500), ("motor[0]", 158)):
        values[:, maker.NAMES.index(name)] = low + rng.integers(0, 200, count)
    for k in range(1, 4):
        values[:, maker.NAMES.index(f"motor[{k}]")] = 158 + rng.integers(0, 1800, count)
    values[:, maker.NAMES.index("rssi")] = rng.integers(0, 1024, count)
    return [[int(value) for value in row] for row in values]


def read(tmp_path: Path, content: bytes, number: int = 0) -> BlackboxContent:
    """Read bytes as a file."""
    path = tmp_path / "log.bbl"
    path.write_bytes(content)
    return read_content(path, number=number)


def decoded(content: BlackboxContent) -> np.ndarray:
    """Return all fields of the main frames."""
    main = content.tables["I"]
    return np.column_stack([np.asarray(main.column(name), dtype=np.int64) for name in main.names])


@pytest.mark.parametrize("size", [1.5, 3.0, 6.0, 30.0, 150.0])
def test_every_encoding_and_predictor_gives_back_what_was_written(size: float, tmp_path: Path) -> None:
    """Of all sizes, so that every selector of the packed encodings is in use."""
    written = rows(400, size=size, seed=int(size))
    content = read(tmp_path, maker.log(written))
    np.testing.assert_array_equal(decoded(content), np.array(written))
    assert content.lost == ()


def test_loops_that_are_not_logged_are_counted(tmp_path: Path) -> None:
    """Of every fourth loop a frame: no frame says which loop it is of."""
    written = rows(100, step=4)
    content = read(tmp_path, maker.log(written, between="4"))
    np.testing.assert_array_equal(decoded(content)[:, 0], np.arange(64, 464, 4))


def test_a_fraction_of_loops_is_counted_as_older_logs_write_it(tmp_path: Path) -> None:
    """Three of four loops: as blackboxShouldLogPFrame chooses them."""
    loops = [loop for loop in range(64, 256) if loop % 32 == 0 or (loop % 32 + 2) % 4 < 3]
    written = rows(len(loops))
    for row, loop in zip(written, loops, strict=True):
        row[0], row[1] = loop, 250 * loop
    content = read(tmp_path, maker.log(written, between="3/4"))
    np.testing.assert_array_equal(decoded(content), np.array(written))


@pytest.mark.parametrize("frame", [5, 40, 63, 64])
def test_a_fault_costs_the_frames_up_to_the_next_complete_one(frame: int, tmp_path: Path) -> None:
    """Frames of differences continue what was lost, and the one before has nothing that confirms its end."""
    written = rows(320)
    content = maker.header(maker.SETTINGS)
    body = maker.frames(written)
    body[frame] = b"\0" + body[frame][1:]
    found = read(tmp_path, content + b"".join(body) + maker.END)
    after = -(-(frame + 1) // 32) * 32
    kept = [*written[: frame - 1], *written[after:]]
    np.testing.assert_array_equal(decoded(found), np.array(kept))
    assert sum(lost.n_bytes for lost in found.lost) == sum(map(len, body[frame - 1 : after]))


def test_frames_before_the_first_complete_one_are_lost(tmp_path: Path) -> None:
    """Nothing says what they differ from."""
    written = rows(96)
    body = maker.frames(written)[5:]
    found = read(tmp_path, maker.header(maker.SETTINGS) + b"".join(body) + maker.END)
    np.testing.assert_array_equal(decoded(found), np.array(written[32:]))


def test_random_bytes_in_the_middle_change_no_row_outside(tmp_path: Path) -> None:
    """Whatever the noise looks like, no row is invented."""
    written = rows(640)
    whole = maker.log(written)
    known = {tuple(row) for row in written}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        at = int(rng.integers(len(maker.header(maker.SETTINGS)) + 100, len(whole) - 600))
        noise = rng.integers(0, 256, 400, dtype=np.uint8).tobytes()
        found = decoded(read(tmp_path, whole[:at] + noise + whole[at + 400 :]))
        assert {tuple(row) for row in found.tolist()} <= known
        assert len(found) > 640 - 100


@pytest.mark.parametrize("n_bytes", [1, 20, 500, 3000])
def test_a_log_cut_off_keeps_the_frames_before(n_bytes: int, tmp_path: Path) -> None:
    """The battery was pulled."""
    written = rows(320)
    content = read(tmp_path, maker.log(written)[:-n_bytes])
    found = decoded(content)
    np.testing.assert_array_equal(found, np.array(written)[: len(found)])
    assert len(found) > 200


def test_without_a_number_the_logs_of_a_file_are_listed(tmp_path: Path) -> None:
    """Nothing is chosen silently; a log without frames cannot be chosen."""
    empty = maker.header(maker.SETTINGS) + b"E\x0f\x04" + maker.END
    with pytest.raises(SeveralLogsError, match=r"--log N: 1 \([0-9.]+ s\), 3 \([0-9.]+ s\)\.") as error:
        read(tmp_path, maker.log(rows(64)) + empty + maker.log(rows(96, seed=1)))
    assert [line.split(",")[1] for line in error.value.logs] == [" 64 frames", " 96 frames"]


def test_a_log_is_chosen_by_its_number(tmp_path: Path) -> None:
    """Its rows, and nothing of the others counts as lost."""
    second = rows(96, seed=1)
    content = read(tmp_path, maker.log(rows(64)) + maker.log(second), number=2)
    np.testing.assert_array_equal(decoded(content), np.array(second))
    assert (content.lost, content.number) == ((), 2)


def test_the_only_log_with_frames_needs_no_number(tmp_path: Path) -> None:
    """Arming and disarming at once leaves an empty log."""
    empty = maker.header(maker.SETTINGS) + b"E\x0f\x04" + maker.END
    assert read(tmp_path, empty + maker.log(rows(64))).number == 2


def test_a_number_that_is_not_there_is_refused(tmp_path: Path) -> None:
    """With how many there are."""
    with pytest.raises(SettingsError, match="holds 1"):
        read(tmp_path, maker.log(rows(64)), number=2)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"Data version:2", b"Data version:1"),
        (b"H Field P encoding", b"H Field Q encoding"),
        (b"H Field I signed:0,", b"H Field I signed:"),
        (b"H Field P encoding:9,", b"H Field P encoding:5,"),
        (b"H Field I name:loopIteration", b"H Field I name:somethingElse"),
        (b"H I interval:32", b"H I interval:0"),
    ],
)
def test_a_header_that_does_not_say_how_frames_are_written_is_refused(
    old: bytes, new: bytes, tmp_path: Path
) -> None:
    """Numbers read by a guessed layout would look like a flight."""
    content = maker.log(rows(64))
    assert old in content
    with pytest.raises(UnknownFormatError, match="cannot be read"):
        read(tmp_path, content.replace(old, new))


def test_a_file_that_lost_its_beginning_holds_no_log(tmp_path: Path) -> None:
    """Frames mean nothing without their header."""
    with pytest.raises(EmptyLogError):
        read(tmp_path, maker.log(rows(64))[100:])


def test_a_file_is_told_by_its_first_line() -> None:
    """Whatever its suffix; flash chips put zeros or 0xff before it."""
    assert is_mine(maker.log(rows(64)))
    assert is_mine(b"\xff\xff" + maker.log(rows(64)))
    assert not is_mine(b"H Product:something else\n")


@pytest.mark.corpus
@pytest.mark.parametrize("name", ["bf_quad_sticks", "bf_quad_chirp", "bf_quad_hover"])
def test_logs_of_the_firmware_have_as_many_frames_as_were_counted(name: str, corpus: Path) -> None:
    """Of each kind, by another decoder."""
    frames = json.loads((corpus / f"firmware/{name}.truth.json").read_text())["frames"]
    content = read_content(corpus / f"firmware/{name}.bbl")
    assert len(content.tables["I"].position) == frames["I"] + frames["P"]
    assert len(content.tables["S"].position) == frames["S"]
    assert content.lost == ()


@pytest.mark.thorough
@pytest.mark.corpus
def test_a_damaged_log_of_the_firmware_keeps_every_row_that_was_not_touched(
    corpus: Path, tmp_path: Path
) -> None:
    """Two places are overwritten: what is kept is the same, and a gap is as long as the fault."""
    whole = (corpus / "firmware/bf_quad_sticks.bbl").read_bytes()
    content = bytearray(whole)
    rng = np.random.default_rng(1)
    for at in (700_000, 1_900_000):
        content[at : at + 5000] = rng.integers(0, 256, 5000, dtype=np.uint8).tobytes()
    path = tmp_path / "damaged.bbl"
    path.write_bytes(content)
    intact = decoded(read_content(corpus / "firmware/bf_quad_sticks.bbl"))
    found = decoded(read_content(path))
    assert len(intact) - 400 < len(found) < len(intact)
    at = np.searchsorted(intact[:, 0], found[:, 0])
    np.testing.assert_array_equal(intact[at], found)


def test_a_field_that_is_let_go_takes_its_numbers_along_and_no_other_field() -> None:
    names = ("motor[0]", "motor[1]", "motorLegacy[0]")
    table = FrameTable(
        columns={name: np.zeros(2, np.int16) for name in names},
        signed=dict.fromkeys(names, True),
        position=np.arange(2),
    )
    table.let_go("motor")
    assert table.names == ("motorLegacy[0]",)
