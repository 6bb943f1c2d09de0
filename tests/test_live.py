"""Live figures: those of the flight so far, soon, at the same cost throughout, and never a traceback."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadid_logs.align import cut
from quadid_logs.containers.tail import LogTail
from quadid_logs.data.log import Signal
from quadid_logs.data.settings import AlignSettings
from quadid_logs.identify.spectral import fit_spectra, flight_spectra
from quadid_logs.identify.spectral_effects import fit_by_spectra
from quadid_logs.live import LiveAxis, LiveEstimate, LiveFigures, figure_block, figure_line, notes
from quadid_logs.load import load
from quadid_logs.simulator import simulate
from quadid_logs.vocabulary import AXES
from quadid_logs.writers import write_log
from tests.marks import thorough, thorough_but

SAMPLES = Path(__file__).resolve().parents[1] / "sample_logs"
SAMPLE_LOGS = pytest.mark.parametrize("name", ["sysid-quad-x.bin", thorough("products-of-inertia.ulg")])


#: Of scenarios of which a short flight shows enough: half of what they fly by themselves [s].
SHORT_S = 30.0


@cache
def flown(content: bytes, n_updates: int = 12) -> list[LiveFigures]:
    """Return the figures after each of some updates."""
    flight, found = LiveEstimate(0.1), []
    for part in np.array_split(np.frombuffer(content, np.uint8), n_updates):
        flight.append(part.tobytes())
        found.append(flight.figures())
    return found


@cache
def scenario(name: str, folder: Path, suffix: str = ".bin") -> tuple[bytes, np.ndarray]:
    """Return a simulated flight's log at 100 Hz, and its true effectiveness per unit of command."""
    autopilot = {".bin": "ardupilot", ".ulg": "px4"}[suffix]
    duration_s = SHORT_S if name in {"hover", "single-axis", "saturation"} else None
    flight = simulate(name, autopilot=autopilot, rate_hz=100.0, duration_s=duration_s)
    path = folder / f"{name}{suffix}"
    write_log(flight.log, path)
    return path.read_bytes(), np.diag(np.array(flight.truth["models"]["damped"]["B"]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return where logs are written."""
    return tmp_path_factory.mktemp("flights")


@SAMPLE_LOGS
def test_at_the_end_the_figures_are_those_of_the_whole_flight(name: str) -> None:
    """The same estimator on the same blocks; angles that are put back begin anew with each tail."""
    figures = flown((SAMPLES / name).read_bytes())[-1]
    data = cut(load(SAMPLES / name), AlignSettings())
    spectra = flight_spectra(data)
    assert spectra is not None
    for axis, fit in zip(figures.axes, fit_spectra(spectra, data.gyro_filter), strict=True):
        assert axis.effectiveness == pytest.approx(fit.gain, rel=0.005)
        assert axis.half_width == pytest.approx(fit.half_width / fit.gain, rel=0.05)


@pytest.mark.parametrize("n_updates", [1, thorough(25)])
def test_it_does_not_matter_how_the_log_comes(n_updates: int) -> None:
    """Byte by byte or after an outage: no block twice, none left out."""
    content = (SAMPLES / "sysid-quad-x.bin").read_bytes()
    one, other = flown(content, n_updates)[-1], flown(content)[-1]
    assert one.flown_s == pytest.approx(other.flown_s, abs=1.0)
    for first, second in zip(one.axes, other.axes, strict=True):
        assert first.effectiveness == pytest.approx(second.effectiveness, rel=0.003)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", thorough_but(["doublets"], ["doublets", "pilot-sticks", "wind", "rough-air"])
)
def test_the_interval_holds_the_truth_whenever_it_is_shown(name: str, folder: Path) -> None:
    """In calm and rough air; also early in the flight."""
    content, truth = scenario(name, folder)
    shown = 0
    for figures in flown(content, 20):
        for axis, true in zip(figures.axes, truth, strict=True):
            if axis.half_width < 1.0:
                shown += 1
                assert abs(axis.effectiveness - true) <= axis.half_width * axis.effectiveness, figures
    assert shown > 20


@pytest.mark.thorough
def test_intervals_shrink_while_the_flight_goes_on(folder: Path) -> None:
    """That is what the pilot watches."""
    widths = [figures.axes[0].half_width for figures in flown(scenario("doublets", folder)[0], 20)]
    known = [width for width in widths if width < 1.0]
    assert widths[0] == math.inf
    assert known[-1] < 0.8 * known[0]
    assert known[-1] < 0.05


@pytest.mark.thorough
def test_a_hover_shows_no_figure(folder: Path) -> None:
    """What is common to torque and rate there is the controller's answer to the air."""
    figures = flown(scenario("hover", folder)[0], 4)[-1]
    assert all(axis.half_width == math.inf for axis in figures.axes)
    assert "doublets for" in figures.hint


@pytest.mark.thorough
def test_the_axis_that_was_not_moved_is_next(folder: Path) -> None:
    """The chirp was on roll alone."""
    figures = flown(scenario("single-axis", folder)[0], 4)[-1]
    assert figures.axes[0].half_width < 0.1
    assert figures.hint.startswith(("Fly pitch doublets", "Fly yaw doublets"))


def test_what_is_least_known_is_moved_next() -> None:
    """Not what needs longest: an axis that no one moved waits for none that narrows slowly."""
    roll, pitch, yaw = LiveFigures().axes
    slow = replace(roll, effectiveness=100.0, half_width=0.065, excited_s=40.0, more_s=28.0)
    known = LiveFigures(flown_s=50.0, axes=(slow, pitch, yaw), missing="")
    assert known.next_axis == pitch
    assert known.hint.startswith("Fly pitch doublets")


@pytest.mark.parametrize(("unit", "said"), [("N m", True), ("1", False)])
def test_a_calibration_that_the_interval_does_not_hold_is_said(unit: str, said: bool) -> None:
    """PX4's parameters say how many newton metres a command is, and may be wrong."""
    axes = tuple(replace(axis, effectiveness=60.0, half_width=0.05) for axis in LiveFigures().axes)
    assert any("N m" in note for note in notes(LiveFigures(axes=axes, unit=unit))) is said


@pytest.mark.thorough
def test_saturation_is_said(folder: Path) -> None:
    """Before more excitation is advised."""
    figures = flown(scenario("saturation", folder)[0], 4)[-1]
    assert figures.saturated > 0.05
    assert "at their limits" in figure_line(figures)


@pytest.mark.thorough
def test_an_oscillation_is_said_with_its_frequency(folder: Path) -> None:
    """While there is time to land: here in rate and output of roll, at 6.2 Hz, and nowhere without it."""
    log = simulate("gentle-hover", autopilot="ardupilot", rate_hz=100.0, duration_s=20.0).log
    signals = dict(log.signals)
    for name, size in (("body_rate", 0.5), ("torque_command", 0.02)):
        signals[name] = tuple(shaken(signal, size) for signal in signals[name])
    path = folder / "shaken.bin"
    for each, oscillates in ((log, False), (replace(log, signals=signals), True)):
        write_log(each, path)
        said = flown(path.read_bytes(), 6)[-3].oscillation
        assert said.startswith("Roll oscillates at 6.2 Hz") == oscillates == bool(said)


def shaken(signal: Signal, size: float) -> Signal:
    """Return a signal whose roll oscillates."""
    values = np.array(signal.values)
    values[:, 0] += size * np.sin(2.0 * np.pi * 6.2 * signal.time_s)
    return replace(signal, values=values)


@pytest.mark.thorough
def test_a_clock_that_jumps_back_stops_nothing(folder: Path) -> None:
    """Blocks before and after it count."""
    content, truth = scenario("clock-jump", folder)
    before, *_, after = (figures for figures in flown(content, 6) if figures.axes[0].half_width < 1.0)
    assert after.flown_s > before.flown_s + 10.0
    assert after.axes[0].effectiveness == pytest.approx(truth[0], rel=0.1)


def test_on_the_ground_the_view_says_why_it_waits() -> None:
    """And promises nothing."""
    content = (SAMPLES / "sysid-quad-x.bin").read_bytes()
    figures = flown(content[: len(content) // 12], 3)[-1]
    assert figures.hint.startswith("Waiting: ")
    assert LiveFigures().hint == "Waiting: no log data yet."


def test_time_is_promised_by_the_square_of_the_width() -> None:
    """Half the interval takes four times the excitation, three times of it more; 30 s at most at a time."""
    from quadid_logs.live import _axis

    fit = fit_by_spectra(cut(load(SAMPLES / "sysid-quad-x.bin"), AlignSettings()))[0]
    fit = replace(fit, half_width=0.1 * fit.gain)
    assert _axis("roll", fit, 6.0, 0.05).more_s == pytest.approx(18.0)
    assert _axis("roll", fit, 20.0, 0.05).more_s == 30.0
    assert _axis("roll", fit, 20.0, 0.1).more_s == 0.0
    assert _axis("roll", fit, 100.0, 0.05).more_s == math.inf


def test_what_more_flight_will_not_narrow_is_said() -> None:
    """Instead of sending the pilot round and round."""
    axes = [LiveAxis(axis=axis, effectiveness=1.0, half_width=0.02, more_s=0.0) for axis in AXES]
    axes[2] = replace(axes[2], half_width=0.3, more_s=math.inf)
    figures = LiveFigures(flown_s=90.0, axes=tuple(axes), missing="")
    assert figures.hint == "More flight will hardly narrow yaw: land, and read the report."
    assert not figures.is_enough


def test_a_bar_is_full_once_the_interval_is_as_wanted() -> None:
    """And half full at twice the width."""
    axes = [LiveAxis(axis=axis, effectiveness=1.0, half_width=0.05, more_s=0.0) for axis in AXES]
    axes[1] = replace(axes[1], half_width=0.1)
    lines = figure_block(LiveFigures(flown_s=60.0, axes=tuple(axes), missing=""), width=8)
    assert [line.count("█") for line in lines[1:4]] == [8, 4, 8]


@pytest.mark.thorough
def test_an_update_costs_the_same_at_the_end_of_a_flight(folder: Path) -> None:
    """No more than a third of a second of the processor, and no sum over the whole flight."""
    content = scenario("pilot-sticks", folder)[0]
    flight, spent = LiveEstimate(), []
    for part in np.array_split(np.frombuffer(content, np.uint8), 60):
        began = time.process_time()
        flight.append(part.tobytes())
        flight.figures()
        spent.append(time.process_time() - began)
    assert np.median(spent[-10:]) < 0.3
    assert np.median(spent[-10:]) < 1.5 * np.median(spent[25:35])


@pytest.mark.thorough
def test_a_long_flight_keeps_the_blocks_in_which_most_was_commanded(
    monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    """Memory and time have a bound."""
    monkeypatch.setattr("quadid_logs.live._MOST_BLOCKS", 12)
    content, truth = scenario("doublets", folder)
    flight = LiveEstimate()
    flight.append(content)
    axes = flight.figures().axes
    assert [len(blocks.blocks) for blocks in flight._by_source.values()] == [12]
    assert [axis.effectiveness for axis in axes] == pytest.approx(truth, rel=0.07)


@pytest.mark.thorough
@SAMPLE_LOGS
@settings(max_examples=6, deadline=None)
@given(data=st.data())
def test_a_damaged_log_shows_figures_or_says_why_not(name: str, data: st.DataObject) -> None:
    """Any bytes overwritten, cut out, or put in: no exception, no hang."""
    content = bytearray((SAMPLES / name).read_bytes()[:400_000])
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place : place + data.draw(st.integers(0, 300))] = data.draw(st.binary(max_size=300))
    figures = flown(bytes(content), 4)[-1]
    assert figure_line(figures)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.binary(max_size=200), max_size=10),
    st.sampled_from([b"", b"ULog\x01\x12\x35\x01" + bytes(8), b"\xa3\x95\x80"]),
)
def test_the_tail_of_any_bytes_is_no_longer_than_they_are(parts: list[bytes], begin: bytes) -> None:
    """Whatever they say of their lengths and times."""
    tail = LogTail(2.0)
    for part in (begin, *parts):
        tail.append(part)
    assert len(tail.content()) <= len(begin) + sum(map(len, parts))
