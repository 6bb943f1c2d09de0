"""ULog: what is read equals pyulog, and damage costs no more than itself."""

from __future__ import annotations

import contextlib
import io
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from quadid_logs.containers import content as file_content
from quadid_logs.containers import ulog, ulog_frames
from quadid_logs.errors import EmptyLogError
from quadid_logs.load import read_log
from tests.marks import thorough_but

from . import ulog_maker as make

INTACT = [
    "firmware/px4_quad_default_logging.ulg",
    "firmware/px4_quad_multisine.ulg",
    "real/px4-1.6-sample-auavx21-handheld-69s.ulg",
    "real/px4-1.9-quad-escstatus-39s.ulg",
    "real/px4-1.11-vtol-babyshark-sysid-branch-1174s.ulg",
    "real/px4-1.12-f450-tumble-3s.ulg",
    "real/px4-1.14-octocoax-cubeorange-75s.ulg",
    "real/px4-1.16-quad-v6c-indoor-85s.ulg",
    "damaged/appended-multiple.ulg",
]
DAMAGED = [
    "damaged/corrupt-format-not-utf8.ulg",
    "damaged/corrupt-wrong-size.ulg",
    "damaged/px4-1.17-x500-v6xrt-outdoor-89s-corrupt.ulg",
]

#: Of an old and a new firmware one, with eight rotors, joined to another, and damaged.
OF_EACH_KIND = (
    "firmware/px4_quad_default_logging.ulg",
    "real/px4-1.9-quad-escstatus-39s.ulg",
    "real/px4-1.14-octocoax-cubeorange-75s.ulg",
    "damaged/appended-multiple.ulg",
    "damaged/corrupt-format-not-utf8.ulg",
    "damaged/px4-1.17-x500-v6xrt-outdoor-89s-corrupt.ulg",
)


def pyulog_of(source: Path | bytes):
    """Return pyulog's reading of the same file, without its prints."""
    import pyulog

    with contextlib.redirect_stdout(io.StringIO()):
        return pyulog.ULog(io.BytesIO(source) if isinstance(source, bytes) else str(source))


def write(folder: Path, content: bytes) -> Path:
    """Write a log under a name that says nothing."""
    path = folder / "flight"
    path.write_bytes(content)
    return path


def n_rows(tables) -> int:
    """Count the rows of all topics."""
    return sum(len(table.rows) for table in tables.values())


@pytest.mark.corpus
@pytest.mark.parametrize("corpus_log", thorough_but(OF_EACH_KIND, INTACT), indirect=True)
def test_every_field_of_every_topic_equals_pyulog(corpus_log: Path) -> None:
    """On intact logs no value of any topic differs from the reference reader's."""
    ours = ulog.read_topics(corpus_log)
    reference = pyulog_of(corpus_log)
    assert {(data.name, data.multi_id) for data in reference.data_list} == set(ours)
    for data in reference.data_list:
        columns = ours[data.name, data.multi_id].columns()
        assert set(columns) == set(data.data)
        for name, values in data.data.items():
            np.testing.assert_array_equal(columns[name], values, err_msg=f"{data.name}.{name}")


@pytest.mark.corpus
@pytest.mark.parametrize("corpus_log", thorough_but(OF_EACH_KIND, INTACT + DAMAGED), indirect=True)
def test_parameters_texts_information_and_dropouts_equal_pyulog(corpus_log: Path) -> None:
    """What stands beside the data is the same, on damaged logs too."""
    known = ulog.read_content(corpus_log, ()).definitions
    reference = pyulog_of(corpus_log)
    parameters = reference.initial_parameters | {
        name: value for _, name, value in reference.changed_parameters
    }
    assert known.parameters == parameters
    tagged = [text for texts in reference.logged_messages_tagged.values() for text in texts]
    expected = sorted((text.timestamp, text.message) for text in reference.logged_messages + tagged)
    assert sorted((text.timestamp_us, text.text) for text in known.texts) == expected
    assert known.information == reference.msg_info_dict
    assert [dropout.duration_ms for dropout in known.dropouts] == [d.duration for d in reference.dropouts]


@pytest.mark.corpus
@pytest.mark.parametrize("corpus_log", INTACT, indirect=True)
def test_an_intact_log_has_no_lost_bytes(corpus_log: Path) -> None:
    """Nothing is called lost where nothing is damaged."""
    assert ulog.read_content(corpus_log, ()).lost == ()


@pytest.mark.corpus
@pytest.mark.parametrize("corpus_log", thorough_but(OF_EACH_KIND, DAMAGED), indirect=True)
def test_at_least_as_many_rows_are_kept_as_by_pyulog(corpus_log: Path) -> None:
    """On damaged logs we lose no more than the reference reader, and say what."""
    content = ulog.read_content(corpus_log)
    reference = pyulog_of(corpus_log)
    assert n_rows(content.topics) >= sum(len(data.data["timestamp"]) for data in reference.data_list)
    assert content.lost


@pytest.mark.corpus
@pytest.mark.parametrize("corpus_log", ["damaged/px4-1.17-x500-v6xrt-outdoor-89s-corrupt.ulg"], indirect=True)
def test_no_row_is_made_up_from_bytes_beside_the_damage(corpus_log: Path) -> None:
    """Every thrust setpoint of the damaged log is within its physical range."""
    thrust = ulog.read_topics(corpus_log)["vehicle_thrust_setpoint", 0]
    assert np.abs(thrust.rows["xyz"]).max() <= 1.0
    assert (np.diff(thrust.rows["timestamp"].astype(np.int64)) > 0).all()


def test_a_truncation_costs_only_the_message_that_is_cut(tmp_path: Path) -> None:
    """Cut at every byte of the data section, all messages before the cut are read, and no other."""
    content = make.small_log(6)
    data_begins = len(make.header() + make.definitions())
    ends = [data_begins + k * len(make.row(make.RATE_ID, 0)) for k in range(7)]
    for cut in range(data_begins, ends[-1] + 1):
        path = write(tmp_path, content[:cut])
        whole = sum(end <= cut for end in ends[1:])
        topics = ulog.read_content(path)
        assert n_rows(topics.topics) == whole
        assert sum(lost.n_bytes for lost in topics.lost) == cut - ends[whole]


def test_every_truncation_ends_with_a_log_or_a_clear_error(tmp_path: Path) -> None:
    """Cut at every byte, the file opens or raises EmptyLogError."""
    content = make.small_log(3)
    for cut in range(7, len(content)):
        with contextlib.suppress(EmptyLogError):
            assert read_log(write(tmp_path, content[:cut])).format == "ulog"


@pytest.mark.parametrize("block_bytes", [50, 333, 4096])
def test_a_log_reads_the_same_in_blocks_of_any_size(
    block_bytes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Messages lie across the ends of blocks, and damage does."""
    log = bytearray(make.small_log(200))
    log[5000:5100] = bytes(100)
    path = write(tmp_path, bytes(log))
    whole = ulog.read_content(path)
    monkeypatch.setattr(ulog_frames, "_BLOCK", block_bytes)
    monkeypatch.setattr(file_content, "_PART_BYTES", block_bytes)
    found = ulog.read_content(path)
    assert (found.lost, found.counts) == (whole.lost, whole.counts)
    assert list(found.topics) == list(whole.topics)
    for key, table in found.topics.items():
        np.testing.assert_array_equal(table.rows, whole.topics[key].rows)
        np.testing.assert_array_equal(table.position, whole.topics[key].position)


@pytest.mark.thorough
@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_garbage_costs_no_more_than_the_damage_and_four_rows(data: st.DataObject, tmp_path: Path) -> None:
    """Bytes put in or over lose at most their number over the row size, plus 4; no value changes."""
    n_pairs = 60
    content = make.header() + make.definitions() + make.rows(n_pairs)
    begin = len(make.header() + make.definitions())
    place = data.draw(st.integers(begin, len(content)))
    size = data.draw(st.integers(1, 600))
    kind = data.draw(st.sampled_from(["zeros", "noise", "copy", "heads"]))
    garbage = {
        "zeros": bytes(size),
        "noise": np.random.default_rng(data.draw(st.integers(0, 999))).bytes(size),
        "copy": content[begin + 5 : begin + 5 + size],
        "heads": (struct.pack("<HBH", 30, ord("D"), make.RATE_ID) * size)[:size],
    }[kind]
    overwrite = data.draw(st.booleans())
    damaged = content[:place] + garbage + content[place + (len(garbage) if overwrite else 0) :]
    topics = ulog.read_topics(write(tmp_path, damaged))
    row_size = len(make.row(make.RATE_ID, 0))
    assert n_rows(topics) >= 2 * n_pairs - (len(garbage) if overwrite else 0) / row_size - 4
    if not overwrite and kind in ("zeros", "noise"):
        for table in topics.values():
            k = (table.rows["timestamp"].astype(np.int64) - 1_000_000) // 4000
            np.testing.assert_array_equal(table.rows["xyz"][:, 0], k.astype(np.float32))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(places=st.lists(st.tuples(st.integers(16, 10_000), st.integers(0, 255)), min_size=1, max_size=30))
def test_flipped_bytes_anywhere_never_crash(places: list[tuple[int, int]], tmp_path: Path) -> None:
    """Whatever bytes change, the file opens or raises EmptyLogError."""
    content = bytearray(make.small_log(30))
    for place, value in places:
        content[16 + place % (len(content) - 16)] = value
    with contextlib.suppress(EmptyLogError):
        assert read_log(write(tmp_path, bytes(content))).n_bytes == len(content)


def test_missing_bytes_inside_a_row_drop_that_row_only(tmp_path: Path) -> None:
    """A row that lost bytes is not made up from the ones that follow."""
    good = make.row(make.RATE_ID, 1)
    content = make.header() + make.definitions() + make.rows(1) + good[:-6] + make.rows(5, 2)
    table = ulog.read_topics(write(tmp_path, content))["vehicle_angular_velocity", 0]
    assert table.rows["xyz"][:, 0].tolist() == [0.0, 2.0, 3.0, 4.0, 5.0, 6.0]


def test_a_log_whose_only_row_is_cut_short_still_gives_its_text(tmp_path: Path) -> None:
    """The row is lost with what its size reaches into; nothing is left of its block to sort by topic."""
    body = make.row(make.RATE_ID, 1)[:-6] + make.text(1_000_000, "takeoff") + make.text(1_100_000, "landed")
    content = ulog.read_content(write(tmp_path, make.header() + make.definitions() + body))
    assert dict(content.topics) == {}
    assert [each.text for each in content.definitions.texts] == ["landed"]
    assert content.lost


def test_a_size_that_lies_does_not_swallow_the_rows_behind_it(tmp_path: Path) -> None:
    """A text that claims 5000 bytes costs itself and the row before it, whose end is then not certain."""
    lying = bytearray(make.text(1_000_000, "short"))
    lying[0:2] = struct.pack("<H", 5000)
    content = make.header() + make.definitions() + make.rows(3) + bytes(lying) + make.rows(200, 3)
    assert n_rows(ulog.read_topics(write(tmp_path, content))) >= 2 * 203 - 1


def test_a_message_of_unknown_type_is_stepped_over_and_counted(tmp_path: Path) -> None:
    """Types of the future cost nothing."""
    content = (
        make.header() + make.definitions() + make.rows(2) + make.message("Z", b"future") + make.rows(2, 2)
    )
    found = ulog.read_content(write(tmp_path, content))
    assert (n_rows(found.topics), found.n_unknown, found.lost) == (8, 1, ())


def test_data_of_an_unannounced_topic_is_counted_and_costs_no_other_row(tmp_path: Path) -> None:
    """Where an announcement was lost, the other topics stay whole."""
    content = make.header() + make.definitions()
    content += b"".join(make.row(make.RATE_ID, k) + make.row(99, k) for k in range(10)) + make.rows(1, 10)
    found = ulog.read_content(write(tmp_path, content))
    assert (n_rows(found.topics), found.n_unknown) == (12, 10)


def test_a_format_that_is_not_utf8_costs_only_its_topic(tmp_path: Path) -> None:
    """A damaged format does not stop the others."""
    broken = make.message("F", b"x\xff\xfe:uint64_t timestamp;\xf0 y;")
    content = make.header() + broken + make.definitions() + make.rows(4)
    assert n_rows(ulog.read_topics(write(tmp_path, content))) == 8


@pytest.mark.parametrize(
    "definition",
    [
        "loop:loop inner;",
        "big:float[65000] a;float[65000] b;",
        "void:",
        "twice:float a;float a;",
        "lost:unheard_of x;",
    ],
)
def test_a_format_that_cannot_be_right_costs_only_its_topic(definition: str, tmp_path: Path) -> None:
    """Recursive, endless, empty or contradictory formats are refused, not followed."""
    name = definition.partition(":")[0]
    content = make.header() + make.message("F", definition.encode()) + make.definitions()
    content += make.subscription(50, name) + make.rows(4)
    assert n_rows(ulog.read_topics(write(tmp_path, content))) == 8


@pytest.mark.parametrize("layout", ["uint8_t[8] timestamp", "uint32_t[2] timestamp"])
def test_a_time_that_is_an_array_is_no_time(layout: str, tmp_path: Path) -> None:
    """A damaged format has rows of the right size, but none that could be placed."""
    broken = make.RATE_FORMAT.replace("uint64_t timestamp;", f"{layout};", 1)
    assert broken != make.RATE_FORMAT
    definitions = make.definitions().replace(
        make.message("F", make.RATE_FORMAT.encode()), make.message("F", broken.encode())
    )
    log = read_log(write(tmp_path, make.header() + definitions + make.rows(20)))
    assert log.candidates("body_rate") == ()
    assert [count.count for count in log.counts] == [20, 20]


def test_nested_types_arrays_and_padding_are_laid_out_as_by_pyulog(tmp_path: Path) -> None:
    """Nested arrays become columns with the names and values of the reference."""
    content = make.header() + make.message("F", b"inner:uint16_t a;uint8_t[2] _padding0;float b;")
    content += make.message(
        "F", b"outer:uint64_t timestamp;inner[2] part;bool on;char[3] name;uint8_t[4] _padding1;"
    )
    content += make.subscription(9, "outer", multi_id=2)
    body = struct.pack("<QH2xfH2xf?3s", 5, 1, 1.5, 2, 2.5, True, b"abc")
    content += make.message("D", struct.pack("<H", 9) + body)
    columns = ulog.read_topics(write(tmp_path, content))["outer", 2].columns()
    reference = pyulog_of(content).data_list[0].data
    assert set(columns) == set(reference)
    for name, values in reference.items():
        assert columns[name].tolist() == values.tolist()


def test_rows_are_read_with_and_without_padding_at_the_end(tmp_path: Path) -> None:
    """Old loggers write the padding of the last field, new ones leave it out."""
    content = make.header() + make.message("F", b"topic:uint64_t timestamp;uint8_t on;uint8_t[7] _padding0;")
    content += make.subscription(9, "topic")
    short = struct.pack("<HQB", 9, 5, 1)
    content += make.message("D", short) + make.message("D", short + bytes(7)) + make.message("D", short)
    assert ulog.read_topics(write(tmp_path, content))["topic", 0].rows["on"].tolist() == [1, 1, 1]


def test_an_id_that_is_given_to_another_topic_keeps_the_rows_before(tmp_path: Path) -> None:
    """Rows belong to the topic that had the id when they were written."""
    content = make.header() + make.definitions() + make.rows(3)
    content += make.subscription(make.RATE_ID, "vehicle_torque_setpoint", multi_id=1) + make.rows(2, 3)
    topics = ulog.read_topics(write(tmp_path, content))
    assert len(topics["vehicle_angular_velocity", 0].rows) == 3
    assert topics["vehicle_torque_setpoint", 1].rows["xyz"][:, 0].tolist() == [3.0, 4.0]


def test_positions_are_the_byte_offsets_of_the_messages(tmp_path: Path) -> None:
    """Each row says where in the file it stands."""
    begin = len(make.header() + make.definitions())
    size = len(make.row(make.RATE_ID, 0))
    table = ulog.read_topics(write(tmp_path, make.header() + make.definitions() + make.rows(3)))
    assert table["vehicle_torque_setpoint", 0].position.tolist() == [
        begin + size,
        begin + 3 * size,
        begin + 5 * size,
    ]


def test_joined_files_give_the_rows_of_both(tmp_path: Path) -> None:
    """A second log behind the first one is read with its own definitions, and said."""
    second = make.header() + make.message("B", bytes(40)) + make.message("F", make.RATE_FORMAT.encode())
    second += make.subscription(make.TORQUE_ID, "vehicle_angular_velocity") + make.row(make.TORQUE_ID, 77)
    path = write(tmp_path, make.small_log(10) + second)
    table = ulog.read_topics(path)["vehicle_angular_velocity", 0]
    assert table.rows["xyz"][:, 0].tolist() == [*range(10), 77.0]
    assert any("joined" in remark for remark in read_log(path).remarks)


def test_joined_files_with_other_formats_keep_the_fields_that_both_have(tmp_path: Path) -> None:
    """A firmware change between joined logs does not lose the common columns."""
    other = "vehicle_angular_velocity:uint64_t timestamp;float[3] xyz;"
    second = make.header() + make.message("F", other.encode())
    second += make.subscription(make.RATE_ID, "vehicle_angular_velocity")
    second += make.message("D", struct.pack("<HQ3f", make.RATE_ID, 9_000_000, 9.0, 8.0, 7.0))
    table = ulog.read_topics(write(tmp_path, make.small_log(4) + second))["vehicle_angular_velocity", 0]
    assert table.fields == ("timestamp", "xyz")
    assert table.rows["xyz"][:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 9.0]


def test_appended_data_are_read_behind_a_message_that_was_cut(tmp_path: Path) -> None:
    """The flags tell where data were appended; the message cut there is lost, nothing else."""
    cut = make.row(make.RATE_ID, 4)[:20]
    flags_size = len(make.message("B", bytes(40)))
    before = make.header() + make.definitions() + make.rows(4) + cut
    flags = bytes(8) + b"\x01" + bytes(7) + struct.pack("<3Q", len(before), 0, 0)
    before = make.header() + make.message("B", flags) + before[len(make.header()) + flags_size :]
    found = ulog.read_content(write(tmp_path, before + make.rows(3, 5)))
    assert n_rows(found.topics) == 14
    assert [(lost.offset, lost.n_bytes) for lost in found.lost] == [(len(before) - len(cut), len(cut))]


def test_bogus_append_offsets_do_not_stop_the_reader(tmp_path: Path) -> None:
    """Offsets behind the end of the file are ignored."""
    flags = bytes(8) + b"\x01" + bytes(7) + struct.pack("<3Q", 2**63, 3, 10**9)
    content = make.header() + make.definitions(flags) + make.rows(4)
    assert n_rows(ulog.read_topics(write(tmp_path, content))) == 8


def test_dropouts_are_counted_with_their_duration(tmp_path: Path) -> None:
    """The autopilot's own marks of missing data reach the log."""
    content = make.header() + make.definitions() + make.rows(2) + make.dropout(250) + make.dropout(750)
    log = read_log(write(tmp_path, content))
    assert log.n_dropped == 2
    assert any("1.00 s" in remark for remark in log.remarks)


def test_only_the_topics_asked_for_are_decoded(tmp_path: Path) -> None:
    """Other topics are counted, not decoded."""
    found = ulog.read_content(write(tmp_path, make.small_log()), {"vehicle_torque_setpoint"})
    assert list(found.topics) == [("vehicle_torque_setpoint", 0)]
    assert [(count.name, count.count) for count in found.counts] == [
        ("vehicle_angular_velocity", 40),
        ("vehicle_torque_setpoint", 40),
    ]


def test_a_log_without_data_is_called_empty(tmp_path: Path) -> None:
    """Definitions alone are no flight."""
    with pytest.raises(EmptyLogError, match="no readable data message"):
        read_log(write(tmp_path, make.header() + make.definitions()))


def test_a_log_of_another_program_is_not_called_a_flight_that_did_not_happen(tmp_path: Path) -> None:
    """Fetching it again, as was advised, brings no topic of PX4."""
    other = make.small_log().replace(b"vehicle_angular_velocity", b"light_control_of_a_show_")
    other = other.replace(b"vehicle_torque_setpoint", b"path_planner_of_a_show_")
    with pytest.raises(EmptyLogError, match="only light_control_of_a_show_ and path_planner_of_a_show_"):
        read_log(write(tmp_path, other))


@pytest.mark.parametrize("step", [7, 16, 23])
def test_a_flood_of_file_headers_costs_only_itself(step: int, tmp_path: Path) -> None:
    """What looks like a joined file is none unless its messages follow."""
    flood = make.header()[:step].ljust(step, b"S") * 3000
    content = make.header() + make.definitions() + make.rows(20) + flood + make.rows(20, 20)
    found = ulog.read_content(write(tmp_path, content))
    assert n_rows(found.topics) >= 2 * 40 - 1
    assert found.n_joined == 0


def test_signalling_nan_in_a_row_raises_no_warning(tmp_path: Path) -> None:
    """Damaged bytes can be any NaN; they arrive as NaN."""
    broken = bytearray(make.row(make.RATE_ID, 1))
    broken[21:25] = struct.pack("<I", 0x7F800001)
    content = make.header() + make.definitions() + make.rows(1) + bytes(broken) + make.rows(1, 2)
    values = read_log(write(tmp_path, content)).candidates("body_rate")[0].values
    assert np.isnan(values[:, 0]).tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("kind", "code", "values"),
    [
        ("int8_t", "b", (-128, 127)),
        ("uint8_t", "B", (0, 255)),
        ("int16_t", "h", (-32768, 32767)),
        ("uint16_t", "H", (0, 65535)),
        ("int32_t", "i", (-(2**31), 2**31 - 1)),
        ("uint32_t", "I", (0, 2**32 - 1)),
        ("int64_t", "q", (-(2**62), 2**62)),
        ("uint64_t", "Q", (0, 2**63)),
        ("float", "f", (-1.5, 1e30)),
        ("double", "d", (-1.25, 1e300)),
    ],
)
def test_the_least_and_the_largest_number_of_every_type_are_read(
    kind: str, code: str, values: tuple[float, float], tmp_path: Path
) -> None:
    """With their signs."""
    content = make.header() + make.message("F", f"one:uint64_t timestamp;{kind} value;".encode())
    content += make.subscription(9, "one")
    for number, value in enumerate(values):
        content += make.message("D", struct.pack(f"<HQ{code}", 9, number, value))
    found = ulog.read_topics(write(tmp_path, content))["one", 0].columns()["value"]
    np.testing.assert_array_equal(found, np.array(values, dtype=found.dtype))
    np.testing.assert_allclose(found.astype(float), values, rtol=1e-6)
