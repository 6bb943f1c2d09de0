"""Which axes a log's system-identification mode swept."""

from __future__ import annotations

from pathlib import Path

import pytest

from quadid_logs.autopilots.ardupilot.log import read_text
from quadid_logs.load import read_log

HEADER = (
    "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format\n"
    "FMT, 1, 31, PARM, QNf, TimeUS,Name,Value\n"
    "FMT, 2, 51, SIDD, Qfffffffff, TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az\n"
)


def log_of(path: Path, *rows: tuple[int | None, float]) -> tuple[str, ...]:
    """Return what a text log swept; by row: what SID_AXIS is set to (None: as before), then the chirp."""
    lines = []
    for number, (axis, chirp) in enumerate(rows):
        time_us = 1_000_000 * (number + 1)
        if axis is not None:
            lines.append(f"PARM, {time_us}, SID_AXIS, {axis}\n")
        lines += [f"SIDD, {time_us + k}, 1.0, {chirp}, 2.0, 0, 0, 0, 0, 0, -9.8\n" for k in (1000, 2000)]
    path.write_text(HEADER + "".join(lines))
    return read_text(path).swept_axes


@pytest.mark.parametrize(
    ("number", "axes"),
    [(1, ("roll",)), (5, ("pitch",)), (9, ("yaw",)), (10, ("roll",)), (12, ("yaw",)), (13, ()), (0, ())],
)
def test_sid_axis_says_which_axis_was_swept(number: int, axes: tuple[str, ...], tmp_path: Path) -> None:
    """mode_systemid.cpp: angle, recovered angle, rate and mixer of roll, pitch, yaw; 13 is the throttle."""
    assert log_of(tmp_path / "a.log", (number, 0.1)) == axes


def test_axes_that_one_flight_swept_in_turn_are_all_named(tmp_path: Path) -> None:
    """A script changes SID_AXIS between the sweeps."""
    assert log_of(tmp_path / "a.log", (12, 0.1), (10, -0.1), (None, 0.1)) == ("roll", "yaw")


def test_an_axis_that_was_set_and_not_swept_is_not_named(tmp_path: Path) -> None:
    """The parameter is set on the ground; the mode writes zeros until it injects."""
    assert log_of(tmp_path / "a.log", (11, 0.0), (10, 0.1), (12, 0.0)) == ("roll",)


@pytest.mark.corpus
@pytest.mark.parametrize(
    ("name", "axes"),
    [
        ("ac47_quadx_sid_roll.BIN", ("roll",)),
        ("ac47_quadx_doublets.BIN", ()),
        ("bf_quad_chirp.bbl", ("roll", "pitch", "yaw")),
        ("bf_quad_sticks.bbl", ()),
    ],
)
def test_a_flown_log_names_the_axes_that_it_swept(name: str, axes: tuple[str, ...], corpus: Path) -> None:
    """As the corpus says how each was flown."""
    assert read_log(corpus / "firmware" / name).swept_axes == axes
