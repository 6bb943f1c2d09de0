"""What got slower from one page of measurements to the next is said, and the machine is not blamed on us."""

from __future__ import annotations

from benchmarks.against import MACHINE, costs, told

PAGE = """# Measured

## Readers

| log | MB | columns | reader | MB/s | ours faster |
|---|---|---|---|---|---|
| a.bin | 38.0 | all | quadid-logs | {speed} | 1.0 |
| a.bin | 38.0 | all | pymavlink | 2.9 | 100.0 |

## Commands

| log | MB | command | CPU s | peak MB |
|---|---|---|---|---|
| a.bin | 38 | `analyze` | {analyze} | 300 |
| b.bin | 16 | `analyze` | {other} | 300 |
| b.bin | 16 | `info` | {info} | 300 |
"""


def page(speed: float = 400.0, analyze: float = 2.0, other: float = 1.0, info: float = 0.5) -> str:
    return PAGE.format(speed=speed, analyze=analyze, other=other, info=info)


def test_only_our_own_costs_are_compared() -> None:
    found = costs(page())
    assert sorted(found.values()) == [1.0 / 400.0, 0.5, 1.0, 2.0]


def test_what_got_slower_is_named() -> None:
    """A speed that fell counts as a cost that rose."""
    (_, _, *table) = told(page(), page(speed=200.0))
    assert table[-1] == "| Readers | a.bin, 38.0, all, quadid-logs | 2.00 |"


def test_a_slower_machine_is_no_slower_program() -> None:
    (line,) = told(page(), page(speed=200.0, analyze=4.0, other=2.0, info=1.0))
    assert "2.00 times" in line
    assert "None got slower" in line


def test_noise_is_not_told() -> None:
    (line,) = told(page(), page(analyze=2.15))
    assert "None got slower" in line


def test_pages_without_common_rows_say_so() -> None:
    assert list(told("# Nothing", page())) == ["Too few rows are on both pages to compare them."]


def test_work_that_is_none_of_ours_tells_how_fast_the_machine_is() -> None:
    """Where most rows got faster, one that did not is not called slower."""
    machine = f"\n## Short\n\n| what | CPU s |\n|---|---|\n| {MACHINE} | 1.0 |\n"
    (line,) = told(page() + machine, page(analyze=1.0, other=0.5, info=0.25) + machine)
    assert "None got slower" in line
