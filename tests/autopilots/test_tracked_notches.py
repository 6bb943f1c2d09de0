"""ArduPilot's harmonic notches stand where what they follow stood in flight."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quadid_logs.autopilots.ardupilot.filters import follows_unknown, notch_sets, parameter_filter
from quadid_logs.autopilots.ardupilot.followed import followed
from quadid_logs.autopilots.instants import instants
from quadid_logs.containers.message_table import MessageTable
from quadid_logs.data.log import Places

SET = {
    "INS_HNTCH_ENABLE": 1.0,
    "INS_HNTCH_MODE": 3.0,
    "INS_HNTCH_REF": 1.0,
    "INS_HNTCH_FREQ": 80.0,
    "INS_HNTCH_BW": 40.0,
    "INS_HNTCH_ATT": 40.0,
    "INS_HNTCH_HMNCS": 1.0,
}


def centres(places: Places) -> list[list[float]]:
    return [[round(notch.frequency_hz, 6) for notch in one] for one in places]


def placed(followed: dict[str, np.ndarray], version: tuple[int, ...] = (4, 6), **changes: float) -> Places:
    return notch_sets(SET | changes, followed, version)["INS_HNTCH"]


def table(name: str, **columns: object) -> MessageTable:
    arrays = {label: np.asarray(values) for label, values in columns.items()}
    n_rows = len(next(iter(arrays.values())))
    return MessageTable(name=name, columns=arrays, position=np.arange(n_rows))


ROTORS = {"rotors_hz": np.array([[100.0, 120.0], [140.0, 160.0]])}


def test_the_mean_speed_of_all_rotors_moves_one_notch() -> None:
    assert centres(placed(ROTORS)) == [[110.0], [150.0]]


def test_the_reference_scales_the_mean_speed() -> None:
    assert centres(placed(ROTORS, INS_HNTCH_REF=0.9)) == [[99.0], [135.0]]


def test_each_rotor_has_its_notch_where_there_are_several_sources() -> None:
    assert centres(placed(ROTORS, INS_HNTCH_OPTS=2.0)) == [[100.0, 120.0], [140.0, 160.0]]


def test_harmonics_follow_at_multiples() -> None:
    assert centres(placed(ROTORS, INS_HNTCH_HMNCS=5.0)) == [[110.0, 330.0], [150.0, 450.0]]


def test_the_throttle_moves_a_notch_by_its_root() -> None:
    """Four ninths of the reference: two thirds of the frequency."""
    found = placed(
        {"throttle": np.array([[0.16], [0.36], [0.81]])},
        INS_HNTCH_MODE=1.0,
        INS_HNTCH_REF=0.36,
        INS_HNTCH_FM_RAT=0.5,
    )
    assert centres(found) == [[pytest.approx(160.0 / 3.0)], [80.0], [120.0]]


@pytest.mark.parametrize(("mode", "name"), [(2.0, "rpm1_hz"), (5.0, "rpm2_hz"), (4.0, "peak_hz")])
def test_each_mode_follows_its_own_sensor(mode: float, name: str) -> None:
    moved = np.array([[95.0], [115.0]])
    assert centres(placed({name: moved}, INS_HNTCH_MODE=mode)) == [[95.0], [115.0]]


@pytest.mark.parametrize("mode", [2.0, 3.0, 4.0, 5.0])
def test_a_notch_that_follows_what_was_not_logged_is_named(mode: float) -> None:
    parameters = SET | {"INS_HNTCH_MODE": mode}
    assert follows_unknown(parameters, {"throttle": np.full((9, 1), 0.3)}) == {"INS_HNTCH_MODE": mode}


@pytest.mark.parametrize(
    ("mode", "name"), [(2.0, "rpm1_hz"), (3.0, "rotors_hz"), (4.0, "peak_hz"), (5.0, "rpm2_hz")]
)
def test_a_notch_that_follows_what_was_logged_is_known(mode: float, name: str) -> None:
    assert follows_unknown(SET | {"INS_HNTCH_MODE": mode}, {name: np.full((9, 1), 90.0)}) == {}


def test_what_the_notch_itself_logged_counts_more_than_what_it_follows() -> None:
    assert centres(placed(ROTORS | {"centres1_hz": np.array([[90.0], [99.0]])})) == [[90.0], [99.0]]


def test_below_its_lowest_frequency_a_notch_stays_there_and_fades() -> None:
    """60 is a third of the way from 80 to 20 Hz: A goes from 0.1 to 0.4, and its square is left."""
    ((notch,),) = placed({"rotors_hz": np.array([[60.0]])})
    assert notch.frequency_hz == 80.0
    assert notch.depth == pytest.approx(0.4**2)


def test_below_a_quarter_of_its_lowest_frequency_there_is_no_notch() -> None:
    assert placed({"rotors_hz": np.array([[19.9]])}) == ((),)


def test_what_is_low_can_count_as_the_lowest() -> None:
    found = placed({"rotors_hz": np.array([[19.9]])}, INS_HNTCH_OPTS=32.0, INS_HNTCH_HMNCS=3.0)
    assert centres(found) == [[80.0, 160.0]]


def test_a_second_harmonic_is_not_held_up_by_the_lowest_frequency() -> None:
    found = placed({"rotors_hz": np.array([[60.0]])}, INS_HNTCH_HMNCS=3.0)
    assert centres(found) == [[80.0, 120.0]]


def test_before_4_5_the_harmonics_of_a_low_notch_stayed_with_it() -> None:
    found = placed({"rotors_hz": np.array([[60.0]])}, (4, 4), INS_HNTCH_HMNCS=3.0)
    assert centres(found) == [[80.0, 160.0]]
    assert found[0][0].depth == pytest.approx(0.01)


def test_double_notches_stand_on_both_sides() -> None:
    """Apart by BW / (32 FREQ) of the centre each: 1.5625 %."""
    found = placed({"rotors_hz": np.array([[100.0]])}, INS_HNTCH_OPTS=1.0)
    assert centres(found) == [[98.4375, 101.5625]]


def test_a_harmonic_above_what_the_gyros_rate_allows_is_switched_off() -> None:
    """0.48 of 1 kHz."""
    found = placed({"rotors_hz": np.array([[241.0]])}, INS_HNTCH_HMNCS=3.0)
    assert centres(found) == [[241.0]]


@pytest.mark.parametrize("name", ["FREQ", "BW", "ATT", "REF", "FM_RAT", "HMNCS", "OPTS", "MODE"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 0.0, 1e30])
def test_no_parameter_makes_a_tracked_notch_that_is_no_number(name: str, value: float) -> None:
    known = parameter_filter(SET | {f"INS_HNTCH_{name}": value}, ROTORS)
    for notch in (*known.notches, *(one for places in known.tracked for each in places for one in each)):
        assert all(map(math.isfinite, notch))


def test_idling_on_the_ground_is_no_part_of_a_flight() -> None:
    speeds = np.r_[np.full(400, 20.0), np.full(600, 100.0)][:, np.newaxis]
    assert set(instants(speeds)[:, 0].tolist()) == {100.0}


def test_instants_stand_for_the_flight_by_how_long_it_was_there() -> None:
    speeds = np.r_[np.full(300, 80.0), np.full(600, 110.0)][:, np.newaxis]
    found = instants(speeds)[:, 0]
    assert np.mean(found == 80.0) == pytest.approx(1.0 / 3.0)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), max_size=60))
def test_any_numbers_make_instants_or_none(values: list[float]) -> None:
    found = instants(np.array(values, dtype=float).reshape(-1, 1))
    assert np.isfinite(found).all()


def test_a_sensor_of_older_firmware_has_a_column_of_its_own() -> None:
    found = followed({"RPM": table("RPM", rpm1=np.full(20, 6000.0), rpm2=np.full(20, 0.0))}, {})
    np.testing.assert_allclose(found["rpm1_hz"], 100.0)
    assert "rpm2_hz" not in found


def test_a_sensor_of_newer_firmware_has_rows_of_its_own() -> None:
    sensors = np.tile([0, 1], 20)
    found = followed({"RPM": table("RPM", I=sensors, RPM=np.where(sensors == 1, 3000.0, 6000.0))}, {})
    np.testing.assert_allclose(found["rpm1_hz"], 100.0)
    np.testing.assert_allclose(found["rpm2_hz"], 50.0)


def test_peaks_of_roll_and_pitch_count_by_their_energy() -> None:
    """3 to 1: a quarter of the way from roll's 100 to pitch's 120 Hz."""
    same = dict.fromkeys(("PkX", "PkY", "EnX", "EnY"))
    values = {"PkX": 100.0, "PkY": 120.0, "EnX": 3.0, "EnY": 1.0}
    columns = {label: np.full(10, values[label]) for label in same}
    found = followed({"FTN2": table("FTN2", Id=np.zeros(10, int), **columns)}, {})
    np.testing.assert_allclose(found["peaks_hz"], 105.0)


def test_centres_of_the_second_set_are_not_those_of_the_first() -> None:
    sets = np.tile([0, 1], 10)
    found = followed({"FCNS": table("FCNS", I=sets, CF=np.where(sets == 1, 150.0, 90.0))}, {})
    np.testing.assert_allclose(found["centres1_hz"], 90.0)
    np.testing.assert_allclose(found["centres2_hz"], 150.0)
