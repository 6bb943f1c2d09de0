"""Flown research logs with gains known from elsewhere: a number where there is one, and none is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from quadid_logs import pipeline
from quadid_logs.data.result import Result
from quadid_logs.data.settings import IdentifySettings, Settings, in_band
from quadid_logs.vocabulary import AXES, ON_AXIS
from tests.analyses import Analyzed
from tests.marks import thorough_but

TAILSITTERS = ("manual-altitude-2", "manual-position-1", "manual-stabilized-2", "step-size2-2")
SMALL = ("square3", "square4", "multisine1", "melon1")
SLOW = ("goodprop-hover1", "goodprop-hover2", "goodprop-line1", "25mmcut-hover1", "25mmcut-hover2")
#: Moments of inertia that were published for the vehicle of cf21-1khz-log15 [kg m^2].
PUBLISHED = {"roll": 1.66e-5, "pitch": 1.67e-5}


def interval(result: Result, axis: str) -> tuple[float, float]:
    model = result.identification.recommended
    assert model is not None
    return model.entries[ON_AXIS[axis]].ci95


@pytest.mark.thorough
@pytest.mark.parametrize("names", [TAILSITTERS[2:], TAILSITTERS], ids=len)
def test_roll_of_a_tail_sitter_is_the_same_in_all_flights(
    corpus: Path, analyzed: Analyzed, names: tuple[str, ...]
) -> None:
    """Published elsewhere as 105 to 134; a yaw that cannot be told took roll with it in three of them."""
    results = [analyzed(corpus / "real" / f"tailsitter-{name}.csv") for name in names]
    assert all(result.diagnosis.axes["roll"].verdict != "refused" for result in results)
    low, high = np.array([interval(result, "roll") for result in results]).T
    assert low.max() < high.min()
    assert all(high > 105.0)
    assert all(low < 134.0)


@pytest.mark.thorough
def test_a_fast_log_without_attitude_gives_the_published_inertia(corpus: Path, analyzed: Analyzed) -> None:
    """Within 6 %."""
    result = analyzed(corpus / "real" / "cf21-1khz-log15.csv")
    for number, axis in enumerate(AXES[:2]):
        assert result.diagnosis.axes[axis].verdict != "refused"
        assert result.identification.recommended is not None
        gain = result.identification.recommended.B[number, number]
        assert 1.0 / gain == pytest.approx(PUBLISHED[axis], rel=0.06)


@pytest.mark.thorough
def test_axes_told_by_commands_alone_tell_the_lag(corpus: Path, analyzed: Analyzed) -> None:
    """Four other flights of this quadrotor say 20 to 25 ms after 1 to 3; in time its roll says 0 after 26."""
    result = analyzed(corpus / "blackbox" / "bf3-log21.bfl")
    assert [result.diagnosis.axes[axis].verdict for axis in ("roll", "pitch")] == ["usable", "caution"]
    assert result.identification.recommended is not None
    actuator = result.identification.recommended.actuator
    assert actuator is not None
    assert actuator.lag_ci95_s[0] < 0.025
    assert actuator.lag_ci95_s[1] > 0.020
    assert actuator.delay_ci95_s[0] < 0.003


@pytest.mark.parametrize("name", thorough_but(SMALL[:1], SMALL))
def test_no_interval_of_a_small_quadrotor_excludes_what_cross_spectra_show(
    corpus: Path, analyzed: Analyzed, name: str
) -> None:
    """33 000 for roll and 31 000 for pitch, unless refused: slow air makes a fit from 0.3 Hz on 17 % low."""
    result = analyzed(corpus / "real" / f"cfbl-{name}-rotors.csv")
    for axis, gain in (("roll", 33_000.0), ("pitch", 31_000.0)):
        if result.diagnosis.axes[axis].verdict != "refused":
            low, high = interval(result, axis)
            assert low <= gain <= high


@pytest.mark.thorough
def test_roll_of_a_quadrotor_in_wind_holds_what_its_set_points_show(corpus: Path, analyzed: Analyzed) -> None:
    """105 to 148; with the roll torque left out of the search for a lag it was refused at 93."""
    result = analyzed(corpus / "real" / "ac34dev-erlebrain2-RATE50Hz-138s.bin")
    assert result.diagnosis.axes["roll"].verdict != "refused"
    low, high = interval(result, "roll")
    assert low < 127.0 < high


def test_the_small_quadrotor_has_a_gain_on_roll_and_pitch(corpus: Path, analyzed: Analyzed) -> None:
    """Refusing everything is no answer: this flight tells both."""
    result = analyzed(corpus / "real" / "cfbl-square3-rotors.csv")
    assert "refused" not in {result.diagnosis.axes[axis].verdict for axis in ("roll", "pitch")}


@pytest.mark.thorough
@pytest.mark.parametrize("axis", AXES)
def test_a_hover_whose_torque_is_the_inverse_controller_s_is_refused_by_that_name(
    corpus: Path, analyzed: Analyzed, axis: str
) -> None:
    """Between 5 and 20 Hz its coherence is high, and a fit there would be confident nonsense."""
    result = analyzed(corpus / "real" / "px4-1.15-quad-hover-80s.ulg")
    assert result.diagnosis.axes[axis].verdict == "refused"
    # Set-points drive its yaw, whose response is measured by them; of that nothing follows.
    assert result.diagnosis.axes[axis].reasons[0] == ("QL505" if axis == "yaw" else "QL516")


@pytest.mark.thorough
def test_a_hover_is_no_better_in_the_band_of_the_inverse_controller(corpus: Path) -> None:
    """Set by hand to where the coherence is; an axis that turned too little there says that first."""
    settings = Settings(identify=in_band((4.0, 12.0), IdentifySettings()))
    result = pipeline.analyze(corpus / "real" / "px4-1.15-quad-hover-80s.ulg", settings)
    assert {verdict.verdict for verdict in result.diagnosis.axes.values()} == {"refused"}
    assert {verdict.reasons[0] for verdict in result.diagnosis.axes.values()} <= {"QL516", "QL403"}


@pytest.mark.thorough
def test_yaw_of_a_small_quadrotor_is_explained_with_the_reaction_of_its_rotors(
    corpus: Path, analyzed: Analyzed
) -> None:
    """Without it, 0 %; its motion is in the last seconds, which held-out blocks of five seconds missed."""
    result = analyzed(corpus / "real" / "cfbl-multisine1-rotors.csv")
    model = result.identification.recommended
    assert model is not None
    assert model.yaw_reaction is not None
    assert model.validation.r2_acceleration["r_dot"] >= 0.8
    low, high = interval(result, "yaw")
    # Published: 3.2e-5 kg m^2.
    assert low < 1.0 / 3.2e-5 < high


@pytest.mark.thorough
def test_a_yaw_torque_that_answers_the_motion_is_refused_by_name(corpus: Path, analyzed: Analyzed) -> None:
    """A lead of -0.6 s explains 92 % of it: the inverse controller."""
    result = analyzed(corpus / "real" / "tailsitter-manual-stabilized-2.csv")
    assert "QL516" in result.diagnosis.axes["yaw"].reasons


@pytest.mark.thorough
@pytest.mark.parametrize("name", thorough_but(SLOW[:1], SLOW))
def test_yaw_of_a_held_heading_in_a_slow_log_is_refused_by_name(
    corpus: Path, analyzed: Analyzed, name: str
) -> None:
    """Its response is that of -1/C of the parameters, with whole and with cut propellers alike."""
    result = analyzed(corpus / "real" / f"ac413-quadx-{name}.bin")
    assert result.diagnosis.axes["yaw"].verdict == "refused"
    assert "QL516" in result.diagnosis.axes["yaw"].reasons


def test_yaw_of_firmware_with_default_logging_is_within_five_per_cent(
    corpus: Path, analyzed: Analyzed
) -> None:
    """10 Hz: roll and pitch stay refused."""
    result = analyzed(corpus / "firmware" / "ac47_quadx_default_logging.BIN")
    model = result.identification.recommended
    assert model is not None
    assert model.B[2, 2] == pytest.approx(14.2, rel=0.05)
    verdicts = {axis: found.verdict for axis, found in result.diagnosis.axes.items()}
    assert verdicts == {"roll": "refused", "pitch": "refused", "yaw": "caution"}
