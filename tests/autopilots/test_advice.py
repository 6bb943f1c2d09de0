"""What to log, set and fly, by autopilot and by the version of its firmware."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.autopilots import Autopilot, formats, known
from quadid_logs.autopilots.ardupilot.advice import ADVICE as ARDUPILOT
from quadid_logs.autopilots.betaflight.advice import ADVICE as BETAFLIGHT
from quadid_logs.autopilots.px4.advice import ADVICE as PX4
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.log import FlightLog
from quadid_logs.diagnose import remedied
from quadid_logs.diagnose.findings import finding
from quadid_logs.planning import make_plan
from quadid_logs.vocabulary import AXES

pytestmark = pytest.mark.usefixtures("quick_multisines")

Version = tuple[int, ...] | None


def ardupilot_logging(mask: float, version: Version = (4, 5, 7), log_format: str = "dataflash") -> str:
    return ARDUPILOT.logging(log_format, {"LOG_BITMASK": mask}, version)


def px4_logging(profile: float, version: Version = (1, 15, 4), log_format: str = "ulog") -> str:
    return PX4.logging(log_format, {"SDLOG_PROFILE": profile}, version)


def betaflight_logging(version: Version) -> str:
    return BETAFLIGHT.logging("blackbox", {}, version)


@pytest.mark.parametrize(
    ("version", "setting"), [((4, 2, 8), "blackbox_p_ratio = 32"), ((4, 3), "blackbox_sample_rate = 1/4")]
)
def test_betaflight_is_told_the_setting_that_its_version_has(version: Version, setting: str) -> None:
    """The rate of the Blackbox was another setting before 4.3."""
    assert f"set {setting} (1 kHz" in betaflight_logging(version)


@pytest.mark.parametrize(
    ("looptime", "denominator", "part"),
    [(125.0, 1.0, "1/8 (1 kHz with a PID loop of 8 kHz)"), (125.0, 2.0, "1/4 (1 kHz"),
     (312.0, 1.0, "1/2 (1.6 kHz"), (1000.0, 1.0, "1/1 (1 kHz"), (float("nan"), 1.0, "1/4 (1 kHz"),
     (1e-9, 1.0, "1/16")],
)  # fmt: skip
def test_the_part_of_the_loops_that_betaflight_logs_is_that_of_its_loop(
    looptime: float, denominator: float, part: str
) -> None:
    """1/4 of a loop of 8 kHz were 2 kHz, which fills a flash chip in half the time."""
    settings = {"looptime": looptime, "pid_process_denom": denominator}
    assert f"blackbox_sample_rate = {part}" in BETAFLIGHT.logging("blackbox", settings, (4, 5))


def test_betaflight_that_cannot_leave_fields_out_is_not_asked_to_log_them() -> None:
    """Fields can be chosen since 4.3."""
    assert "fields" not in betaflight_logging((4, 2, 8))
    assert "fields" in betaflight_logging((4, 3))


@pytest.mark.parametrize(("version", "told"), [((3, 1, 3), True), ((3, 2, 1), True), ((3, 4), False)])
def test_only_firmware_of_an_8_bit_board_is_told_where_it_ends(version: Version, *, told: bool) -> None:
    """3.3 and later run on no such board."""
    said = ARDUPILOT.logging("dataflash", {}, version)
    assert "Update the firmware to 4.0" in said
    assert ("8-bit" in said) == told


@pytest.mark.parametrize("code", ["QL603", "QL605", "QL614", "QL639"])
def test_no_firmware_is_told_to_fly_a_sweep_that_it_lacks(code: str) -> None:
    """ArduCopter before 4.0 and Betaflight before 2025.12 have none."""
    for autopilot, version in (("ardupilot", (3, 6, 4)), ("betaflight", (4, 5, 2))):
        (one,) = remedied([finding(code, "warning", {})], autopilot, version)
        assert "chirp" not in one.advice


def test_three_axes_are_listed_with_commas() -> None:
    """It said "roll and pitch and yaw"."""
    assert "roll, pitch and yaw in turn" in BETAFLIGHT.excitation(AXES, (2025, 12))


@pytest.mark.parametrize(
    ("version", "told"), [((4, 4, 3), False), ((4, 5), True), ((2025, 12), True), (None, True)]
)
def test_rotor_speeds_are_asked_of_firmware_that_logs_them(version: Version, *, told: bool) -> None:
    """The field eRPM is in the log since 4.5."""
    assert ("bidirectional DShot" in betaflight_logging(version)) == told


@pytest.mark.parametrize(
    ("code", "version", "told"),
    [
        ("QL620", (3, 3), "Update the firmware to 4.5"),
        ("QL620", (4, 2, 9), "Set debug_mode = GYRO_SCALED"),
        ("QL620", (2026, 6), "Keep the unfiltered gyro"),
        ("QL644", (4, 3, 2), "Update the firmware to 4.4"),
        ("QL644", (4, 5, 3), "Set blackbox_high_resolution"),
        ("QL620", None, "Keep the unfiltered gyro"),
        ("QL643", (4, 2, 9), "Fly the whole flight in Acro mode"),
        ("QL613", (4, 5, 2), "Keep gyro, PID and set-points"),
        ("QL613", (4, 2, 0), "Log rates"),
        ("QL603", (4, 5, 2), "Do not rely on the margins of this axis. Quicker manoeuvres"),
        ("QL603", (2025, 12), "Do not rely on the margins of this axis. Fly a system-ID chirp"),
        ("QL614", (4, 5, 2), "Fly quicker manoeuvres"),
    ],
)
def test_what_to_log_is_what_the_version_that_flew_can(code: str, version: Version, told: str) -> None:
    """4.2 was to leave a field in that it lacks, and 2026.6 was told of firmware before 4.5."""
    (one,) = remedied([finding(code, "warning", {})], "betaflight", version)
    assert one.advice.startswith(told)
    assert version is None or version < (4, 5) or "before" not in one.advice


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"iterm_relax": 1.0, "f_roll": 120.0}, "without feed-forward and iterm relax:"),
        ({"iterm_relax": 1.0, "f_roll": 0.0}, "without iterm relax:"),
        ({"iterm_relax": 0.0}, ""),
    ],
)
def test_a_computed_step_says_what_the_firmware_adds_while_a_stick_moves(
    settings: dict[str, float], told: str
) -> None:
    """The page of gains said that a flight overshot by 35 % whose measured step overshot by 7 %."""
    assert told in BETAFLIGHT.step_note(settings)
    assert bool(BETAFLIGHT.step_note(settings)) == bool(told)


def test_bidirectional_dshot_that_is_on_is_not_to_be_turned_on() -> None:
    """A header holds it, since 4.2."""
    assert "bidirectional" in BETAFLIGHT.logging("blackbox", {"dshot_bidir": 0.0}, (2026, 6))
    assert "bidirectional" not in BETAFLIGHT.logging("blackbox", {"dshot_bidir": 1.0}, (2026, 6))


@pytest.mark.parametrize(("mask", "to_set"), [(176126.0, 176127), (830.0, 831), (float("nan"), 176127)])
def test_the_bit_is_added_to_the_mask_of_the_log(mask: float, to_set: int) -> None:
    """To the default where it is no number."""
    assert f"Set LOG_BITMASK to {to_set} " in ardupilot_logging(mask)


def test_a_negative_mask_is_not_to_be_typed() -> None:
    """It has 16 bits and the highest is set: a person sets the bit in a list."""
    advice = ardupilot_logging(-22530.0)
    assert "Set bit 0 of LOG_BITMASK" in advice
    assert "-" not in advice


def test_a_mask_that_the_log_does_not_hold_is_not_said_to_be_the_default() -> None:
    """A telemetry log may hold no parameters at all."""
    advice = ARDUPILOT.logging("tlog", {}, None)
    assert "keep other bits" in advice
    assert "keep other bits" not in ardupilot_logging(176126.0)


@pytest.mark.parametrize(("mask", "verb"), [(32767.0, "keep"), (32766.0, "set")])
def test_old_firmware_is_not_told_to_set_a_bit_that_is_set(mask: float, verb: str) -> None:
    """Updating is what is missing."""
    assert f"Then {verb} bit 0 of LOG_BITMASK" in ardupilot_logging(mask, (3, 3))


def test_the_loop_rate_is_that_of_the_log() -> None:
    """SCHED_LOOP_RATE may be 300 Hz, or 800."""
    advice = ARDUPILOT.logging("dataflash", {"LOG_BITMASK": 176126.0, "SCHED_LOOP_RATE": 800.0}, (4, 5))
    assert "(800 Hz)" in advice
    assert "(400 Hz)" in ardupilot_logging(176126.0)


def test_a_version_that_nobody_knows_gets_system_id_mode_with_its_condition() -> None:
    """Telemetry logs often do not say the version."""
    assert "(4.0 and later)" in ARDUPILOT.excitation(AXES, None)
    assert "(4.0 and later)" not in ARDUPILOT.excitation(AXES, (4, 5))


def test_a_log_without_time_from_an_8_bit_board_is_not_promised_an_update() -> None:
    """The last firmware for it stamps its rows but logs no torque."""
    assert "An 8-bit APM board cannot run it: its last firmware, 3.2" in ARDUPILOT.remedies["QL104"]


def test_a_ulog_whose_parameters_know_no_profile_is_of_an_old_logger() -> None:
    """The firmware's version is a bare hash in development builds."""
    advice = PX4.logging("ulog", {"MC_ROLL_P": 6.5}, None)
    assert "Update the firmware" in advice
    assert "Update" not in PX4.logging("ulog", {"SDLOG_PROFILE": 1.0}, None)
    assert "Update" not in PX4.logging("tlog", {"MC_ROLL_P": 6.5}, None)


@pytest.mark.parametrize("mask", [176127.0, 407551.0, 32767.0, -1.0, -22529.0])
def test_a_bit_that_is_set_is_not_to_be_set_again(mask: float) -> None:
    """Then the card is what is too slow."""
    advice = ardupilot_logging(mask)
    assert "Set LOG_BITMASK" not in advice
    assert f"LOG_BITMASK is {mask:.0f}" in advice


@pytest.mark.parametrize(
    ("version", "limit"),
    [((3, 1, 3), "does not log the rate controller"), ((3, 3), "at 50 Hz"), ((3, 4), "at 25 Hz")],
)
def test_firmware_that_logs_too_slowly_whatever_the_mask_is_to_be_updated(
    version: tuple[int, ...], limit: str
) -> None:
    """A mask alone would cost the user a flight for nothing."""
    advice = ardupilot_logging(32767.0, version)
    assert limit in advice
    assert "Update the firmware to 4.0" in advice


@pytest.mark.parametrize("version", [(3, 6, 4), (4, 0), (4, 7, 0), None])
def test_firmware_that_logs_at_the_loop_rate_is_not_to_be_updated(version: Version) -> None:
    """Nor one that does not say its version."""
    assert "Update" not in ardupilot_logging(176126.0, version)


@pytest.mark.parametrize(("version", "has_it"), [((3, 6, 4), False), ((4, 0, 0), True), (None, True)])
def test_system_id_mode_is_advised_from_4_0_on(version: Version, has_it: bool) -> None:
    """And before it is said what it needs."""
    advice = ARDUPILOT.excitation(["yaw"], version)
    assert ("plan --autopilot ardupilot --axes yaw" in advice) == has_it
    assert ("This is ArduCopter 3.6" in advice) != has_it
    assert bool(ARDUPILOT.sweep_magnitudes(version)) == has_it


@pytest.mark.parametrize(("profile", "to_set"), [(1.0, 25), (11.0, 27), (0.0, 25), (3.0, 27)])
def test_bits_of_the_profile_are_added(profile: float, to_set: int) -> None:
    """Default, system identification and high rate; what was chosen beside stays."""
    assert f"Set SDLOG_PROFILE to {to_set} " in px4_logging(profile)


def test_what_else_a_profile_logs_stays_and_is_not_called_the_three() -> None:
    """ "155 (default + system identification + high rate)" is 25 by its words."""
    assert "155 (default + system identification + high rate; the others as they are)" in px4_logging(131.0)
    assert "25 (default + system identification + high rate)," in px4_logging(1.0)


def test_a_profile_of_high_rate_is_not_to_be_set_again() -> None:
    """25, and more than it."""
    assert "Set SDLOG_PROFILE" not in px4_logging(25.0)
    assert "Set SDLOG_PROFILE" not in px4_logging(59.0)


@pytest.mark.parametrize(("version", "log_format"), [((1, 6, 0), "ulog"), (None, "dataflash")])
def test_a_logger_without_profiles_is_to_be_updated(version: Version, log_format: str) -> None:
    """Before 1.8, and sdlog2, whose framing is that of DataFlash."""
    assert "Update the firmware" in px4_logging(1.0, version, log_format)


@pytest.mark.parametrize("autopilot", known(), ids=lambda one: one.name)
def test_every_autopilot_answers_every_question(autopilot: Autopilot) -> None:
    """In whole sentences, whatever format and version."""
    advice = autopilot.advice
    for version in (None, (0,), (1, 20), (9, 9, 9)):
        assert all(advice.logging(each.name, {}, version).endswith(".") for each in formats())
        assert all(advice.excitation(AXES[:n], version).endswith(".") for n in (1, 2, 3))
        assert all(note.endswith(".") for note in advice.version_notes(version))
        assert set(advice.sweep_magnitudes(version)) in (set(), set(AXES))
    assert advice.remedies.keys() <= CATALOGUE.keys()
    assert all(step.endswith(".") for step in advice.steps(AXES, {}))


@pytest.mark.parametrize(
    ("firmware", "version"),
    [
        ("ArduCopter V4.5.7 (2a3dc4b7)", (4, 5, 7)),
        ("APM:Copter V3.4-rc2 (f46a31d0)", (3, 4)),
        ("PX4 v1.15.0-beta (b589596a)", (1, 15, 0)),
        ("v4.6.0", (4, 6, 0)),
        ("PX4 44d2c4a1e5c0", None),
        ("", None),
        ("V99999999999999999999.1", None),
    ],
)
def test_the_version_is_read_from_what_the_firmware_calls_itself(firmware: str, version: Version) -> None:
    """As the corpus has it."""
    log = FlightLog(path="", format="ulog", autopilot="px4", n_bytes=0, signals={}, firmware=firmware)
    assert log.version == version


def test_the_chirp_of_a_plan_is_set_and_set_back_by_lines_for_the_command_line() -> None:
    """Betaflight: amplitudes in deg/s, frequencies in tenths of a hertz; what flew comes back."""
    planned = make_plan("betaflight", [], None, {"chirp_amplitude_roll": 111.0})
    files = planned.script_files()
    lines = dict(line[4:].split(" = ") for line in files["chirp.txt"].splitlines() if line.startswith("set"))
    assert lines["debug_mode"] == "CHIRP"
    lowest = min(each.start_hz for each in planned.excitations.values())
    assert 0.0 <= lowest - int(lines["chirp_frequency_start_deci_hz"]) / 10.0 < 0.1
    for axis, each in planned.excitations.items():
        assert 1 <= int(lines[f"chirp_amplitude_{axis}"]) <= max(np.degrees(each.magnitude), 1.0)
    assert "set chirp_amplitude_roll = 111" in files["chirp-off.txt"]
    assert "set chirp_amplitude_yaw = 180" in files["chirp-off.txt"]
    assert any("six times" in step for step in planned.steps())
