"""Every flown log opens with charts that say what is normal, whatever it was flown with."""

from __future__ import annotations

from pathlib import Path

import pytest

from quadid_logs.align import cut
from quadid_logs.data.health import Health
from quadid_logs.data.settings import AlignSettings
from quadid_logs.health import health_of
from quadid_logs.load import prepare, read_log
from tests.marks import thorough_but

#: Topics that have no chart of their own.
WITHOUT_CHART = {"oscillation", "rotors"}
FEWEST = 4
#: Nothing flew, or no multirotor did, in the others of these folders.
FLOWN = (
    "real/ac30-quadV-underpowered.log",
    "real/ac301-octo-apm2-MOT.log",
    "real/ac311-quadx-nan.log",
    "real/ac313-y6b-331s.bin",
    "real/ac33dev-erle-quadx-RATE50Hz-2015-03-31.bin",
    "real/ac34dev-erlebrain2-RATE50Hz-138s.bin",
    "real/ac34rc2-erlebrain3-quadx-265s.bin",
    "real/ac364-quadx-RATE1Hz-700s.bin",
    "real/ac41-quadplus-mission-113s.bin",
    "real/ac413-quadx-25mmcut-hover1.bin",
    "real/ac413-quadx-25mmcut-hover2.bin",
    "real/ac413-quadx-goodprop-hover1.bin",
    "real/ac413-quadx-goodprop-hover2.bin",
    "real/ac413-quadx-goodprop-line1.bin",
    "real/ac457-quadx-noATT-noRATE-50s.bin",
    "real/cf21-1khz-log15.csv",
    "real/cfbl-melon1-rotors.csv",
    "real/cfbl-multisine1-command.csv",
    "real/cfbl-multisine1-rotors.csv",
    "real/cfbl-square3-command.csv",
    "real/cfbl-square3-rotors.csv",
    "real/cfbl-square4-rotors.csv",
    "real/px4-1.14-octocoax-cubeorange-75s.ulg",
    "real/px4-1.15-quad-hover-80s.ulg",
    "real/px4-1.16-quad-v6c-indoor-85s.ulg",
    "real/px4-1.9-quad-escstatus-39s.ulg",
    "real/sdlog2-quad-70s.px4log",
    "real/tailsitter-manual-altitude-2.csv",
    "real/tailsitter-manual-position-1.csv",
    "real/tailsitter-manual-stabilized-2.csv",
    "real/tailsitter-step-size2-2.csv",
    "real/x8coax_moments_hover.csv",
    "blackbox/bf2025-eRPM-btfl027.bbl",
    "blackbox/bf3-hiro-highP-lowD.bfl",
    "blackbox/bf3-hiro-lowP-lowD.bfl",
    "blackbox/bf3-log14.bfl",
    "blackbox/bf3-log17.bfl",
    "blackbox/bf3-log21.bfl",
    "blackbox/bf3-log26.bfl",
    "blackbox/bf3-log29.bfl",
    "blackbox/bf3-log36.bfl",
    "blackbox/bf3-plasmatree-smooth.bbl",
    "blackbox/bf42-btfl002.bbl",
    "blackbox/bf431-freestyle.bbl",
    "blackbox/cleanflight-2016.txt 1",
    "blackbox/several-logs-in-one-file.bbl 4",
    "blackbox/several-logs-in-one-file.bbl 12",
    "flown/crazyswarm2/logs/log09",
    "flown/crazyswarm2/logs/log129",
    "flown/nanobench/B2_circle_fast_rep1.parquet",
)
#: Of each kind of log the one with least in it.
OF_EACH_KIND = (
    "real/ac30-quadV-underpowered.log",
    "real/ac311-quadx-nan.log",
    "real/px4-1.9-quad-escstatus-39s.ulg",
    "real/cf21-1khz-log15.csv",
    "real/x8coax_moments_hover.csv",
    "blackbox/cleanflight-2016.txt 1",
    "flown/crazyswarm2/logs/log129",
)


def health(corpus: Path, name: str) -> Health:
    """Return what a log shows; behind a space stands which one of a file."""
    path, _, number = name.partition(" ")
    prepared = prepare(read_log(corpus / path, number=int(number or 0)))
    return health_of(prepared, cut(prepared, AlignSettings()))


@pytest.mark.parametrize("name", thorough_but(OF_EACH_KIND, FLOWN))
def test_a_flown_log_shows_four_charts_that_say_what_is_normal(corpus: Path, name: str) -> None:
    """Also one that gives no number of its vehicle."""
    judged = [
        topic
        for topic, found in health(corpus, name).topics.items()
        if topic not in WITHOUT_CHART and found.says_what_is_normal
    ]
    assert len(judged) >= FEWEST, judged


def test_a_vehicle_without_power_is_told_so(corpus: Path) -> None:
    """It would not climb: 79 % throttle, at its end in a tenth of the flight, and 3 V for a cell."""
    found = health(corpus, "real/ac30-quadV-underpowered.log")
    assert found.throttle is not None
    assert found.throttle.level == "severe"
    assert found.battery is not None
    assert found.battery.level == "severe"


def test_a_thrust_that_is_measured_carries_what_the_vehicle_weighs(corpus: Path) -> None:
    """By rotor speeds and the published thrust curve: 45 g on the scale."""
    found = health(corpus, "real/cfbl-square3-rotors.csv")
    assert found.thrust is not None
    assert found.thrust.figures["mass"].value == pytest.approx(0.045, rel=0.02)


def test_newtons_of_other_motors_are_told_by_the_mass_that_they_carry(corpus: Path) -> None:
    """Moments and thrust of this log are not calibrated: its vehicle has 1.92 kg."""
    found = health(corpus, "real/x8coax_moments_hover.csv")
    assert found.thrust is not None
    assert found.thrust.figures["mass"].value == pytest.approx(2.64, rel=0.02)


def test_rates_of_a_table_are_not_said_to_be_a_gyro_s(corpus: Path) -> None:
    """Motion capture measured these."""
    found = health(corpus, "real/tailsitter-manual-position-1.csv")
    assert found.noise is not None
    assert "The body rates show distinct lines" in found.noise.sentence
    assert "gyro" not in found.noise.sentence


def test_newton_metres_are_no_percentage_of_a_range(corpus: Path) -> None:
    """The Lee controller commands some 1e-4 N m: of a range of 1 that would be next to nothing."""
    found = health(corpus, "flown/crazyswarm2/logs/log09")
    assert found.command_noise is None
    assert "newton metres" in found.missing["command_noise"]
