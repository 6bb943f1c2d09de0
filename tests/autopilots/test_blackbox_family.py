"""Logs of old Betaflight, Cleanflight and INAV: names, units, signs, laws, models of a known vehicle."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.autopilots import named
from quadid_logs.autopilots.betaflight.controller import controllers
from quadid_logs.autopilots.betaflight.dialect import firmware_of
from quadid_logs.autopilots.betaflight.header_names import gyro_scale, with_later_names
from quadid_logs.autopilots.betaflight.law import rate_gains
from quadid_logs.autopilots.betaflight.replay import replay_inputs
from quadid_logs.autopilots.betaflight.rotors import full_output
from quadid_logs.autopilots.modes import in_modes
from quadid_logs.cli import main
from quadid_logs.control.replay import replay
from quadid_logs.data.controller import RemarkKind
from quadid_logs.data.log import ControllerTerms, FlightLog, ModeChange, Rows, Signal
from quadid_logs.errors import UnknownFormatError
from quadid_logs.load import read_log
from quadid_logs.pipeline import analyze
from quadid_logs.simulator import Simulation, simulate
from quadid_logs.simulator.dialects import FIRMWARE, in_dialect
from quadid_logs.vocabulary import ON_AXIS
from quadid_logs.writers import write_log
from tests.containers import blackbox_maker as maker
from tests.marks import thorough, thorough_but

DEGREE = math.pi / 180.0
#: By dialect what rounding leaves of each signal: sticks count in 0.4 to 2 deg/s, old voltages in tenths.
LEFT = {
    "betaflight-3": {"body_rate": 0.5 * DEGREE, "body_rate_setpoint": 1.0 * DEGREE, "battery_voltage": 0.05},
    "cleanflight": {
        "body_rate": DEGREE / 32.8,
        "body_rate_setpoint": 1.0 * DEGREE,
        "battery_voltage": 0.0045,
    },
    "inav": {
        "body_rate": 0.5 * DEGREE,
        "body_rate_setpoint": 0.5 * DEGREE,
        "battery_voltage": 0.005,
        "attitude": 0.05 * DEGREE,
    },
}
COMMON = {
    "throttle": 0.6e-3,
    "motor_thrust": 0.51e-3,
    "specific_force": 0.5 * 9.80665 / 2048.0,
    "torque_command": 3e-3,
}


@pytest.fixture(scope="module")
def flown() -> Simulation:
    """Doublets in calm air."""
    return simulate("doublets", seed=1, duration_s=24.0, rate_hz=400.0, autopilot="betaflight")


@pytest.fixture(scope="module")
def written(flown: Simulation, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[FlightLog, Path]]:
    """The flight as each firmware would have logged it, and the file."""
    folder = tmp_path_factory.mktemp("family")
    found = {}
    for dialect in FIRMWARE:
        log, path = in_dialect(flown.log, dialect), folder / f"{dialect}.bbl"
        write_log(log, path)
        found[dialect] = (log, path)
    return found


@pytest.mark.parametrize(
    ("dialect", "name"),
    [(dialect, name) for dialect, left in LEFT.items() for name in (*left, *COMMON)],
)
def test_each_signal_is_read_in_its_unit_and_sign(
    dialect: str, name: str, written: dict[str, tuple[FlightLog, Path]]
) -> None:
    """Whatever the firmware counts in; the writer knows the flight, the reader the file alone."""
    log, path = written[dialect]
    found, expected = (each.candidates(name)[0].values for each in (read_log(path), log))
    away = (
        (found - expected + math.pi) % (2.0 * math.pi) - math.pi if name == "attitude" else found - expected
    )
    assert np.abs(away).max() <= (LEFT[dialect] | COMMON)[name] * 1.01


@pytest.mark.parametrize("dialect", sorted(FIRMWARE))
def test_a_log_is_its_own_autopilots(dialect: str, written: dict[str, tuple[FlightLog, Path]]) -> None:
    """All begin with the same line."""
    log, path = written[dialect]
    read = read_log(path)
    assert (read.autopilot, read.firmware) == (log.autopilot, log.firmware)
    assert named(read.autopilot).name == log.autopilot


@pytest.mark.parametrize("dialect", thorough_but(["betaflight-3"], sorted(FIRMWARE)))
def test_the_vehicle_is_found_from_each_dialect(
    dialect: str, flown: Simulation, written: dict[str, tuple[FlightLog, Path]]
) -> None:
    """Effectiveness of the truth, though set-points follow from sticks, and all counts are others."""
    model = analyze(written[dialect][1]).identification.recommended
    assert model is not None
    true = np.diag(np.array(flown.truth["models"]["damped"]["B"]))
    found = [model.entries[on_axis].value for on_axis in ON_AXIS.values()]
    np.testing.assert_allclose(found, true, rtol=0.03)


def test_set_points_that_4_x_was_told_not_to_log_are_not_made_of_sticks(
    written: dict[str, tuple[FlightLog, Path]], tmp_path: Path
) -> None:
    """It smooths them behind the sticks: made of these, they would not be what P was made of."""
    content = written["betaflight-3"][1].read_bytes()
    path = tmp_path / "later.bbl"
    path.write_bytes(content.replace(b"revision:Betaflight 3.4.0", b"revision:Betaflight 4.3.0"))
    log = read_log(path)
    assert log.candidates("throttle")
    assert not log.candidates("body_rate_setpoint")


@pytest.mark.parametrize("dialect", ["cleanflight", "inav"])
def test_a_law_that_nobody_read_closes_no_loop(
    dialect: str, written: dict[str, tuple[FlightLog, Path]]
) -> None:
    """The model stands by itself."""
    log = read_log(written[dialect][1])
    autopilot = named(log.autopilot)
    assert autopilot.controllers(log, log.parameters) is None
    assert autopilot.tunable(log.parameters) is None


@pytest.mark.parametrize(
    ("revision", "kind", "name", "version"),
    [
        ("Betaflight 3.4.0 (a5ba01666) OMNIBUSF4SD", "Cleanflight", "Betaflight", (3, 4, 0)),
        ("INAV 9.0.1 (d44f2cf6) F722", "Cleanflight", "INAV", (9, 0, 1)),
        ("bdaf8ec", "Cleanflight", "Cleanflight", None),
        ("Cleanflight 2.1.0 (abc) SPF3", "Cleanflight", "Cleanflight", (2, 1, 0)),
        ("bdaf8ec", "Baseflight", "Baseflight", None),
        ("bdaf8ec", "", "", None),
        ("", "Betaflight", "Betaflight", None),
        ("", "", "", None),
    ],
)
def test_a_header_names_its_firmware(
    revision: str, kind: str, name: str, version: tuple[int, ...] | None
) -> None:
    """By its revision, or by the type where that is of the source alone."""
    found = firmware_of({"Firmware revision": revision, "Firmware type": kind})
    assert (found.name, found.version) == (name, version)


def bits(number: float) -> float:
    """Return the bits of a number of single precision as 3.1 wrote them."""
    return float(struct.unpack("<I", struct.pack("<f", number))[0])


@pytest.mark.parametrize(
    ("old", "later"),
    [
        ({"rcRate": 140.0, "rcYawRate": 120.0}, {f"rc_rates[{k}]": (140, 140, 120)[k] for k in range(3)}),
        ({"rc_rate": 140.0, "rc_rate_yaw": 120.0}, {f"rc_rates[{k}]": (140, 140, 120)[k] for k in range(3)}),
        ({"rcExpo": 10.0, "rcYawExpo": 3.0}, {f"rc_expo[{k}]": (10, 10, 3)[k] for k in range(3)}),
        ({"rc_expo": 10.0, "rc_expo_yaw": 3.0}, {f"rc_expo[{k}]": (10, 10, 3)[k] for k in range(3)}),
        ({"dynThrPID": 10.0, "fast_pwm_protocol": 7.0}, {"tpa_rate": 10, "motor_pwm_protocol": 7}),
        ({"dterm_lpf_hz": 100.0, "yaw_lpf_hz": 80.0}, {"dterm_lowpass_hz": 100, "yaw_lowpass_hz": 80}),
        ({"minthrottle": 1160.0, "maxthrottle": 1900.0}, {"motorOutput[0]": 1160, "motorOutput[1]": 1900}),
        ({"yawRateAccelLimit": bits(10.0)}, {"acc_limit_yaw": 100}),
        (
            {"pidSumLimit": bits(0.5), "pidSumLimitYaw": bits(0.4)},
            {"pidsum_limit": 500, "pidsum_limit_yaw": 400},
        ),
    ],
)
def test_settings_have_their_later_names(old: dict[str, float], later: dict[str, float]) -> None:
    """And units: some were the bits of a floating point number."""
    found = with_later_names(old, (3, 1, 5))
    assert found.items() >= old.items()
    assert {name: found[name] for name in later} == pytest.approx(later)


def test_a_setting_keeps_the_value_of_its_later_name() -> None:
    """A header of 4.2 holds the minimum throttle too, of which its outputs are independent."""
    found = with_later_names({"minthrottle": 1070.0, "motorOutput[0]": 158.0}, (4, 2))
    assert found["motorOutput[0]"] == 158.0


def test_before_3_1_cut_offs_were_in_hundredths() -> None:
    """9000 was 90 Hz."""
    assert with_later_names({"gyro_lowpass_hz": 9000.0}, (3, 0, 1))["gyro_lowpass_hz"] == 90.0
    assert with_later_names({"gyro_lowpass_hz": 90.0}, (3, 1, 0))["gyro_lowpass_hz"] == 90.0


def test_before_3_2_yaw_had_the_limit_of_all() -> None:
    """500; the one of its own, 400, came with 3.2."""
    assert with_later_names({}, (3, 1, 3))["pidsum_limit_yaw"] == 500.0
    assert "pidsum_limit_yaw" not in with_later_names({}, (3, 2, 0))


def test_before_3_5_yaw_had_no_d() -> None:
    """The setting was there, and flew as 0."""
    gains = {f"yawPID[{place}]": 45.0 for place in range(3)}
    assert with_later_names(gains, (3, 4, 1))["yawPID[2]"] == 0.0
    assert with_later_names(gains, (3, 5, 0))["yawPID[2]"] == 45.0


def test_before_4_0_yaws_integral_had_the_scale_of_all() -> None:
    """The factor 2.5 came with the defaults of 4.0."""
    settings = {"p_yaw": 45.0, "i_yaw": 80.0, "d_yaw": 0.0}
    old, new = (rate_gains(settings, "yaw", version).integral for version in ((3, 5, 7), (4, 0, 0)))
    assert new == pytest.approx(2.5 * old)
    assert old == pytest.approx(0.244381 * 80.0 * math.degrees(1.0) * 1e-3)


@pytest.mark.parametrize(
    ("texts", "scale"),
    [
        ({}, 1.0),
        ({"gyro_scale": "0x3f800000"}, 1.0),
        ({"gyro.scale": "0x3d79c190"}, 1.0 / 16.4),
        ({"gyro.scale": "0x7fc00000"}, math.nan),
        ({"gyro_scale": "0x0"}, math.nan),
        ({"gyro_scale": "0x461c4000"}, math.nan),
        ({"gyro_scale": "0xffffffffff"}, math.nan),
        ({"gyro_scale": "fast"}, math.nan),
    ],
)
def test_the_gyros_scale_is_the_headers(texts: dict[str, str], scale: float) -> None:
    """A damaged one is none: rates in a wrong unit would be a wrong number in the report."""
    assert gyro_scale(texts) == pytest.approx(scale, rel=1e-6, nan_ok=True)


def test_a_damaged_scale_of_the_gyro_leaves_no_rates(tmp_path: Path) -> None:
    """Nor set-points that would have to be compared with them."""
    rows = np.zeros((64, len(maker.NAMES)), dtype=int)
    rows[:, 0], rows[:, 1] = np.arange(64), 1000 * np.arange(64)
    path = tmp_path / "damaged.bbl"
    path.write_bytes(maker.log(rows.tolist(), settings=maker.SETTINGS | {"gyro_scale": "0x7fc00000"}))
    assert not read_log(path).candidates("body_rate")


def test_modes_hold_until_the_next_one() -> None:
    """The first one from the beginning."""
    modes = [
        ModeChange(time_s=time_s, position=0, name=name) for time_s, name in ((1.0, "Acro"), (2.0, "Angle"))
    ]
    times = np.array([0.0, 1.5, 2.0, 9.0])
    np.testing.assert_array_equal(in_modes(modes, ("Angle",), times), [False, False, True, True])
    assert not in_modes((), ("Angle",), times).any()


def test_where_sticks_ask_for_angles_no_set_points_are_made_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their rates would be those that nobody asked for; the log says so."""
    stick = tuple((f"rcCommand[{k}]", 1, 0, 0, 1, 8) for k in range(4))
    fields = tuple(field for field in maker.FIELDS if not field[0].startswith("setpoint")) + stick
    monkeypatch.setattr(maker, "FIELDS", fields)
    monkeypatch.setattr(maker, "NAMES", tuple(field[0] for field in fields))
    rows = np.zeros((256, len(fields)), dtype=int)
    rows[:, 0], rows[:, 1] = np.arange(256), 1000 * np.arange(256)
    rows[:, maker.NAMES.index("rcCommand[0]")] = 250
    settings = {name: value for name, value in maker.SETTINGS.items() if name != "blackbox_high_resolution"}
    settings |= {"Firmware revision": "Betaflight 3.3.0 (abc) F4", "rc_rates": "100,100,100"}
    settings |= {"rc_expo": "0,0,0", "rates": "0,0,0"}
    body = maker.frames(rows.tolist(), settings=settings)
    slow = [b"S" + maker.unsigned(flags) + maker.unsigned(0) + maker.tag2_3s32([0, 1, 1]) for flags in (1, 3)]
    path = tmp_path / "modes.bbl"
    path.write_bytes(
        maker.header(settings) + slow[0] + b"".join(body[:128]) + slow[1] + b"".join(body[128:]) + maker.END
    )
    log = read_log(path)
    (found,) = log.candidates("body_rate_setpoint")
    np.testing.assert_allclose(found.values[:128, 0], 100.0 * DEGREE)
    assert np.isnan(found.values[128:]).all()
    assert any("sticks command angles" in remark for remark in log.remarks)


def test_digital_outputs_that_are_logged_as_pulses_are_pulses() -> None:
    """INAV's: with DShot too they go from 1000 to 2000 us."""
    settings = {"motor_pwm_protocol": 6.0, "motorOutput[0]": 1080.0, "motorOutput[1]": 2000.0}
    np.testing.assert_allclose(full_output(np.array([0.0, 0.5, 1.0]), settings), [0.08, 0.54, 1.0])


@pytest.mark.parametrize(
    ("version", "setting", "axes"),
    [("3.3.0", "2", 0), ("3.4.0", "2", 3), ("3.3.0", "1", 3)],
)
def test_an_average_behind_d_is_not_modelled(version: str, setting: str, axes: int, tmp_path: Path) -> None:
    """A filter of 3.0 to 3.3 whose number stands for another one later; no header holds its length."""
    rows = np.zeros((64, len(maker.NAMES)), dtype=int)
    rows[:, 0], rows[:, 1] = np.arange(64), 1000 * np.arange(64)
    pids = {"rollPID": "45,80,30", "pitchPID": "47,84,34", "yawPID": "45,80,0", "dterm_filter_type": setting}
    path = tmp_path / "log.bbl"
    path.write_bytes(
        maker.log(
            rows.tolist(),
            settings=maker.SETTINGS | pids | {"Firmware revision": f"Betaflight {version} (a) F4"},
        )
    )
    log = read_log(path)
    found = controllers(log, log.parameters)
    assert found is not None
    assert len(found.axes) == axes
    assert (RemarkKind.NOT_MODELLED in {one.kind for one in found.remarks}) == (axes == 0)


def test_the_law_before_3_1_is_not_taken_for_a_later_one(written: dict[str, tuple[FlightLog, Path]]) -> None:
    """It counted in other units."""
    log = read_log(written["betaflight-3"][1])
    assert controllers(log, log.parameters) is not None
    assert controllers(replace(log, firmware="Betaflight v3.0.1 (abc) F3"), log.parameters) is None


def test_other_firmware_in_the_second_log_of_a_file_is_refused(
    written: dict[str, tuple[FlightLog, Path]], tmp_path: Path
) -> None:
    """The first log decides who reads the file."""
    path = tmp_path / "both.bbl"
    path.write_bytes(written["inav"][1].read_bytes() + written["cleanflight"][1].read_bytes())
    with pytest.raises(UnknownFormatError, match="log of Cleanflight, not of INAV"):
        read_log(path, number=2)


def test_the_longest_log_of_a_file_is_analyzed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A dump of a flash chip ended at exit code 2: one of its logs was to be chosen."""

    def log(n_frames: int) -> bytes:
        rows = [[loop, 1000 * loop + 1_000_000] + [0] * (len(maker.NAMES) - 2) for loop in range(n_frames)]
        return maker.log(rows)

    path = tmp_path / "two.bbl"
    path.write_bytes(log(64) + log(96))
    assert main(["analyze", str(path), "-o", str(tmp_path / "out"), "--no-report"]) == 1
    assert "The longest one, log 2 (0.1 s), is analyzed" in capsys.readouterr().err


BLACKBOX = (
    "bf2025-eRPM-btfl027.bbl", "bf3-hiro-highP-lowD.bfl", "bf3-hiro-lowP-lowD.bfl", "bf3-log14.bfl",
    "bf3-log17.bfl", "bf3-log21.bfl", "bf3-log26.bfl", "bf3-log29.bfl", "bf3-log36.bfl",
    "bf3-plasmatree-smooth.bbl", "bf42-btfl002.bbl", "bf431-freestyle.bbl", "cleanflight-2016.txt",
    "inav901.txt", "several-logs-in-one-file.bbl",
)  # fmt: skip


@pytest.mark.parametrize(
    "name", thorough_but(("bf2025-eRPM-btfl027.bbl", "cleanflight-2016.txt", "inav901.txt"), BLACKBOX)
)
def test_every_flown_blackbox_log_is_read(
    corpus: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """24 of 33 public ones ended at exit code 2."""
    assert main(["info", str(corpus / "blackbox" / name)]) == 0
    assert capsys.readouterr().out


@pytest.mark.parametrize("axis", ["roll", "pitch", "yaw"])
@pytest.mark.parametrize(
    "name",
    ["log14.bfl", *map(thorough, ("plasmatree-smooth.bbl", "hiro-highP-lowD.bfl", "log36.bfl"))],
)
def test_the_law_of_3_1_and_3_4_makes_the_logged_terms(corpus: Path, name: str, axis: str) -> None:
    """By set-points made of the sticks: gains, attenuation and yaw's low-pass are those of the header."""
    log = read_log(corpus / f"blackbox/bf3-{name}")
    found = controllers(log, log.parameters)
    assert found is not None
    assert found.version_read == "read"
    assert replay(found, replay_inputs(log, found, ()))[axis].agrees


@pytest.mark.parametrize(
    "name", ["hiro-highP-lowD.bfl", thorough("log21.bfl"), thorough("plasmatree-smooth.bbl")]
)
def test_the_battery_of_old_logs_is_in_volts(corpus: Path, name: str) -> None:
    """Four cells, four, and two, of 3.2 to 4.3 V each."""
    cells = 2 if name.startswith("plasma") else 4
    voltage = read_log(corpus / f"blackbox/bf3-{name}").candidates("battery_voltage")[0].values
    assert 3.2 < float(np.median(voltage)) / cells < 4.3


def test_old_counts_of_the_converter_are_volts(corpus: Path) -> None:
    """1840 of them were a battery of four cells."""
    log = read_log(corpus / "blackbox/cleanflight-2016.txt", number=1)
    assert 3.2 < float(np.median(log.candidates("battery_voltage")[0].values)) / 4 < 4.3


def test_what_a_stick_of_cleanflight_asks_for_is_its_law(corpus: Path) -> None:
    """(rates + 27) / 16 / 4.1 deg/s a unit, with rates of 75 on both axes of this flight."""
    log = read_log(corpus / "blackbox/cleanflight-2016.txt", number=1)
    for column in log.candidates("body_rate_setpoint")[0].values[:, :2].T:
        step = np.diff(np.unique(np.round(np.degrees(np.abs(column)), 3)))
        assert np.median(step[step < 2.0]) == pytest.approx(102.0 / 16.0 / 4.1, rel=2e-3)


@pytest.mark.parametrize(("axis", "p"), [("roll", 32.0), ("pitch", 35.0)])
def test_p_of_inav_is_its_gain_by_the_logged_set_point(corpus: Path, axis: str, p: float) -> None:
    """A 31st of the header's gain per degree per second: so `axisRate` is the set-point, in deg/s."""
    log = read_log(corpus / "blackbox/inav901.txt", number=1)
    number = ("roll", "pitch").index(axis)
    error = (log.candidates("body_rate_setpoint")[0].values - log.candidates("body_rate")[0].values)[
        :, number
    ]
    terms = next(one for one in log.controller_terms if one.axis == axis)
    moved = np.abs(error) > 7.0 * DEGREE
    gain = float(np.median(terms.values["P"][moved] / error[moved])) * 1e3 * DEGREE
    assert gain == pytest.approx(p / 31.0, rel=0.06)


def test_inavs_attitude_has_the_sign_of_gravity(corpus: Path) -> None:
    """Pitch is logged positive with the nose down."""
    log = read_log(corpus / "blackbox/inav901.txt", number=3)
    phi, theta, _ = np.median(log.candidates("attitude")[0].values, axis=0)
    ax, ay, az = np.median(log.candidates("specific_force")[0].values, axis=0) / 9.80665
    assert az == pytest.approx(-1.0, abs=0.02)
    assert math.asin(ax) * theta > 0.0
    assert -math.asin(ay) * phi > 0.0
    assert theta == pytest.approx(math.asin(ax), abs=2.0 * DEGREE)
    assert phi == pytest.approx(-math.asin(ay), abs=2.0 * DEGREE)


@pytest.mark.parametrize(("weight", "as_logged"), [(0.0, False), (60.0, True)])
def test_a_d_that_holds_the_slope_of_set_points_is_taken_as_logged(weight: float, as_logged: bool) -> None:
    """Before 3.5: of the gyro alone it would be another one."""
    rng = np.random.default_rng(0)
    rows = Rows(1e-3 * np.arange(8000), np.arange(8000))
    rate = np.cumsum(rng.normal(0.0, 0.05, (8000, 3)), axis=0) * 0.5
    columns = {
        "body_rate": rate,
        "body_rate_setpoint": rate + rng.normal(0.0, 1.0, (8000, 3)),
        "throttle": np.full((8000, 1), 0.4),
    }
    gains = {f"{short}_{axis}": 45.0 for short in "pid" for axis in ("roll", "pitch", "yaw")}
    log = FlightLog(
        path="",
        format="blackbox",
        autopilot="betaflight",
        n_bytes=0,
        firmware="Betaflight v3.4.0 (a) F4",
        signals={
            name: (Signal(name=name, rows=rows, values=values, source=f"main.{name}"),)
            for name, values in columns.items()
        },
        parameters=gains | {"looptime": 500.0, "dterm_setpoint_weight": weight},
        controller_terms=(
            ControllerTerms(
                axis="roll",
                rows=rows,
                values={"P": rng.normal(0.0, 0.1, 8000), "D": rng.normal(0.0, 0.1, 8000)},
            ),
        ),
    )
    found = controllers(log, log.parameters)
    assert found is not None
    assert ("D" in replay_inputs(log, found, ())["roll"].as_logged) == as_logged
