"""How figures and their intervals are written, on every surface."""

from __future__ import annotations

import pytest

from quadid_logs.numerals import beside, estimate, interval, plus_minus


@pytest.mark.parametrize(
    ("figures", "text"),
    [
        ((29.9951, 29.838, 30.1513), "30.00 (29.84 to 30.15)"),
        ((49.9, 48.0, 52.0), "49.9 (48.0 to 52.0)"),
        ((27_912.0, 26_600.0, 29_200.0), "27900 (26600 to 29200)"),
        ((0.0, 0.0, 1.43), "0.00 (0.00 to 1.43)"),
        ((-0.02, -0.31, 0.27), "−0.02 (−0.31 to 0.27)"),
        ((1.5974e-5, 1.541e-5, 1.653e-5), "1.597e−5 (1.541e−5 to 1.653e−5)"),
        ((0.0001, 0.00005, 0.0003), "0.00010 (0.00005 to 0.00030)"),
        ((440.0, 439.99999, 440.00001), "440.000 (440.000 to 440.000)"),
        ((5.0, 5.0, 5.0), "5 (5 to 5)"),
        ((5.0, float("nan"), float("inf")), "5 (not bounded)"),
    ],
)
def test_value_and_ends_have_the_decimals_of_two_digits_of_the_half_width(
    figures: tuple[float, float, float], text: str
) -> None:
    """29.995 (29.838 to 30.151) said more than the flight knows."""
    assert estimate(*figures) == text


def test_what_is_rounded_to_nothing_has_no_sign() -> None:
    """−0.00 reads as if it meant something."""
    assert interval(-0.001, 1.0) == "0.00 to 1.00"


def test_half_a_width_has_the_decimals_of_its_value() -> None:
    """Both ends of what it stands for have."""
    assert plus_minus(-51.634, 2.61) == "−51.6 ± 2.6"


@pytest.mark.parametrize(
    ("value", "written"), [(75.3, "75.3"), (74.98, "74.98"), (80.2, "80"), (75.0, "75"), (75.00001, "75.000")]
)
def test_a_figure_beside_its_limit_does_not_read_like_it(value: float, written: str) -> None:
    """ "75 µs, more than the normal 75 µs" was said of a motor."""
    assert beside(value, 75.0, 0) == written
