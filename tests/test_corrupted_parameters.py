"""Parameters of a damaged log can be any number: no analysis may break on them."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from fuzz.mutations import parameter_values, ulog_frames
from quadid_logs.data.log import whole_number
from quadid_logs.load import read_log
from quadid_logs.pipeline import analyze
from quadid_logs.report import json_text
from tests.marks import thorough

SAMPLES = Path(__file__).parents[1] / "sample_logs"

Damaged = Callable[[bytes, float, int | None], bytes | None]


def dataflash_with(content: bytes, value: float, only: int | None = None) -> bytes | None:
    """Return a log with one or all parameters of a value; None without it."""
    log = bytearray(content)
    places = parameter_values(log)
    for place in places if only is None else places[only : only + 1]:
        log[place : place + 4] = struct.pack("<f", value)
    return None if only is not None and only >= len(places) else bytes(log)


def ulog_with(content: bytes, value: float, only: int | None = None) -> bytes | None:
    """Return a log with one or all parameters of a value, and of type float; None without it."""
    log, number = bytearray(content[:16]), -1
    for begin, end in ulog_frames(bytearray(content)):
        message = content[begin:end]
        if message[2] == ord("P"):
            number += 1
            if only in (None, number):
                key = b"float " + message[4 : 4 + message[3]].split(b" ")[1]
                body = bytes([len(key)]) + key + struct.pack("<f", value)
                message = struct.pack("<HB", len(body), ord("P")) + body
        log += message
    return None if only is not None and only > number else bytes(log)


DATAFLASH = ("sysid-quad-x.bin", dataflash_with)
ULOG = ("products-of-inertia.ulg", ulog_with)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "damaged", "value"),
    [
        thorough(*DATAFLASH, math.nan),
        *(thorough(*DATAFLASH, value) for value in (1e30, math.inf, -math.inf, -1.0)),
        (*ULOG, math.nan),
        *(thorough(*ULOG, value) for value in (math.inf, -math.inf, 1e30, -1.0)),
    ],
)
def test_a_log_whose_parameters_are_all_corrupted_is_analyzed(
    name: str, damaged: Damaged, value: float, tmp_path: Path
) -> None:
    """It gets a result, whatever that says."""
    (tmp_path / name).write_bytes(damaged((SAMPLES / name).read_bytes(), value, None) or b"")
    assert json_text(analyze(tmp_path / name))


@pytest.mark.parametrize(("name", "damaged"), [DATAFLASH, ULOG], ids=["dataflash", "ulog"])
def test_each_parameter_may_be_no_number(name: str, damaged: Damaged, tmp_path: Path) -> None:
    """One after the other, so that none hides behind another: they stand before the first flown second."""
    content = (SAMPLES / name).read_bytes()[:30_000]
    number = 0
    while (log := damaged(content, math.nan, number)) is not None:
        (tmp_path / name).write_bytes(log)
        assert read_log(tmp_path / name).signals
        number += 1
    assert number > 50


@pytest.mark.parametrize("value", [None, math.nan, math.inf, -math.inf, 1e30, -(2.0**32)])
def test_what_is_no_number_of_32_bits_is_no_whole_number(value: float | None) -> None:
    """Then the caller's default stands."""
    assert whole_number(value, 7) == 7
