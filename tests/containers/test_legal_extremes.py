"""What no autopilot writes though the format allows it must cost no more than its size."""

from __future__ import annotations

import contextlib
import random
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fuzz import extremes
from fuzz.seeds import Seed, load_seeds
from quadid_logs.containers import dataflash, dataflash_text, ulog, ulog_frames
from quadid_logs.containers.content import text_content
from quadid_logs.containers.table import read_cells
from quadid_logs.containers.ulog_formats import BrokenMessageError, Formats
from quadid_logs.errors import LogError, QuadidError, UnknownFormatError
from quadid_logs.load import read_log
from tests.containers import dataflash_files, ulog_maker
from tests.marks import thorough

resource = pytest.importorskip("resource", reason="memory limits are POSIX's")
pa = pytest.importorskip("pyarrow")
pytest.importorskip("pyarrow.parquet")

#: Before, the worst of each took 3 to 120 s; now 0.4 s. The machines of tests are slow.
_MOST_S = 3.0
FAMILIES = [(kind, family) for kind, families in extremes.BY_KIND.items() for family in families]


@pytest.fixture(scope="module")
def seeds() -> dict[str, Seed]:
    """Return an intact log of every kind."""
    return {seed.kind: seed for seed in load_seeds()}


@pytest.mark.parametrize("number", [0, thorough(1), thorough(2)])
@pytest.mark.parametrize(("kind", "family"), FAMILIES, ids=lambda each: getattr(each, "__name__", each))
def test_no_legal_extreme_costs_out_of_proportion(kind, family, number, seeds, tmp_path):
    """Definitions that are many, wide, nested, repeated; texts, instances and senders by the thousand."""
    path = tmp_path / f"log{seeds[kind].suffix}"
    path.write_bytes(family(random.Random(number), seeds[kind].content, 300_000))
    began = time.process_time()
    with contextlib.suppress(QuadidError):
        read_log(path)
    assert time.process_time() - began < _MOST_S


def test_a_format_inside_others_is_taken_apart_once():
    """Eight levels of 400 fields with arrays of four unfold to 1600^7 numbers."""
    formats = Formats()
    formats.define("a0:uint8_t x;")
    for level in range(1, 8):
        formats.define(f"a{level}:" + "".join(f"a{level - 1} f{k};" for k in range(2)))
    dtype, size = formats.row("a7")
    assert (size, dtype.itemsize, formats._n_fields) == (128, 128, 15)


def test_formats_deeper_than_eight_are_refused_from_whatever_side_they_are_asked_for():
    """A format that is known already counts with its depth."""
    formats = Formats()
    formats.define("a0:uint8_t x;")
    for level in range(1, 9):
        formats.define(f"a{level}:a{level - 1} x;")
        formats.row(f"a{level - 1}")
    with pytest.raises(BrokenMessageError):
        formats.row("a8")


def test_formats_that_keep_changing_come_to_an_end():
    """Each change makes the layouts void; none is worked out for ever."""
    formats = Formats()
    formats.define("wide:other o;" + "".join(f"uint8_t f{k};" for k in range(400)))

    def change_all_the_time() -> None:
        for number in range(300):
            formats.define(f"other:float x{number};")
            formats.row("wide")

    with pytest.raises(BrokenMessageError, match="keep changing"):
        change_all_the_time()


def test_a_format_that_changes_leaves_the_layouts_of_others_alone():
    """A topic of 400 fields used to be taken apart again for every change of a format it does not hold."""
    formats = Formats()
    formats.define("wide:" + "".join(f"uint8_t f{k};" for k in range(400)))
    for number in range(300):
        formats.define(f"other:float x{number};")
        formats.row("wide")
    assert formats._n_fields == 400


def test_a_format_that_changes_two_levels_down_changes_the_row():
    """What holds the changed format must not keep its old layout."""
    formats = Formats()
    for definition in ("a:uint8_t x;", "b:a x;", "c:b x;uint8_t y;"):
        formats.define(definition)
    before = formats.row("c")[1]
    formats.define("a:uint64_t x;")
    assert (before, formats.row("c")[1]) == (2, 9)


def test_thousands_of_late_topics_give_every_row(tmp_path, monkeypatch):
    """Each used to make the whole block be searched again; taken one by one, no row is lost."""
    searches = []
    find = ulog_frames._find_images
    monkeypatch.setattr(ulog_frames, "_find_images", lambda *given: searches.append(0) or find(*given))
    content = ulog_maker.header() + ulog_maker.definitions()
    for k in range(3000):
        content += ulog_maker.subscription(100 + k, "vehicle_angular_velocity", k % 4)
        content += ulog_maker.row(100 + k, k) + ulog_maker.row(ulog_maker.RATE_ID, k)
    path = tmp_path / "log.ulg"
    path.write_bytes(content)
    topics = ulog.read_topics(path)
    found = np.concatenate([table.rows["xyz"][:, 0] for table in topics.values()])
    assert sorted(found.tolist()) == sorted(2 * list(range(3000)))
    assert len(searches) < 100


def test_a_type_that_is_defined_thousands_of_times_gives_every_row():
    """Only the columns that are wanted are put together: 3000 definitions would make 9000 of 3000 rows."""
    rows, text = dataflash_files.FMT_OF_FMT, b""
    for k in range(3000):
        rows += dataflash_files.fmt(140, "ATT", "Qf", f"TimeUS,c{k}") + dataflash_files.row(140, "Qf", k, k)
        text += f"FMT, 140, 15, ATT, Qf, TimeUS,c{k}\nATT, {k}, {k}.0\n".encode()
    for log in (dataflash.DataFlashFile.from_bytes(rows), dataflash_text.TextLog("", text)):
        table = log.read_messages({"ATT"}, {"TimeUS", "c7"})["ATT"]
        assert table.columns["TimeUS"].tolist() == list(range(3000))
        assert np.flatnonzero(np.isfinite(table.columns["c7"])).tolist() == [7]
        ends = log.first_and_last()["ATT"].columns["TimeUS"]
        assert (ends[0], ends[-1]) == (0, 2999)


def test_a_text_in_every_cell_of_a_parquet_column_is_kept_once(tmp_path):
    """2000 rows of a dictionary's one text of 1 MB are 2 GB, from 3 kB."""
    path = tmp_path / "bomb.parquet"
    cell = pa.DictionaryArray.from_arrays(pa.array([0] * 2000, pa.int32()), pa.array(["x" * 1_000_000]))
    numbers = pa.array(np.arange(2000.0))
    pa.parquet.write_table(pa.table({"time_s": numbers, "p_rad_s": cell}), path, store_schema=False)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    cells = read_cells(path, lambda names: names)
    assert cells.n_not_numeric == 2000
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000


def test_a_parquet_file_that_unfolds_to_far_more_than_its_size_is_refused(tmp_path):
    """Before it is unfolded."""
    path = tmp_path / "zeros.parquet"
    zeros = pa.array(np.zeros(3_000_000))
    pa.parquet.write_table(pa.table({"time_s": zeros, "p_rad_s": zeros}), path)
    with pytest.raises(UnknownFormatError, match="unpacks from"):
        read_cells(path, lambda names: names)


def test_no_column_of_a_parquet_file_is_asked_for_its_statistics(tmp_path, monkeypatch):
    """Found by damage: where they contradict each other, Arrow ends the process instead of raising."""
    path = tmp_path / "table.parquet"
    pa.parquet.write_table(pa.table({"time_s": pa.array([0.0, 1.0])}), path)
    groups = SimpleNamespace(total_byte_size=16)  # has no column()
    about = SimpleNamespace(num_rows=2, num_row_groups=1, num_columns=1, row_group=lambda _number: groups)
    whole = pa.parquet.ParquetFile(path)
    damaged = SimpleNamespace(metadata=about, schema_arrow=whole.schema_arrow, read=whole.read)
    monkeypatch.setattr(pa.parquet, "ParquetFile", lambda *_rest, **_options: damaged)
    assert read_cells(path, lambda names: names).columns["time_s"].tolist() == [0.0, 1.0]


def test_a_text_with_holes_is_not_read_whole(tmp_path):
    """20 GB that take no room on the disk."""
    path = tmp_path / "sparse.csv"
    path.write_text("time_s,p_rad_s\n0,0\n")
    with path.open("r+b") as file:
        file.truncate(20_000_000_000)
    with pytest.raises(LogError, match=r"20\.0 GB"):
        text_content(path)


@pytest.mark.parametrize("ending", [".csv", ".log"])
def test_both_formats_of_text_are_read_within_the_limit(ending: str, tmp_path: Path) -> None:
    """The limit stands in one place, and both ask it."""
    path = tmp_path / f"sparse{ending}"
    path.write_text("time_s,p_rad_s\n" if ending == ".csv" else "FMT, 140, 15, ATT, Qf, TimeUS,Roll\n")
    with path.open("r+b") as file:
        file.truncate(20_000_000_000)
    with pytest.raises(LogError, match=r"20\.0 GB"):
        read_log(path)
