"""Several flights of one vehicle: whether they agree, and which one does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.result import Result
from quadid_logs.errors import SettingsError
from quadid_logs.repetition import Repeatability, RepeatedQuantity, repeat, strangers
from quadid_logs.report.repetition import headline, repetition_lines
from tests.synthetic_results import refused_result, usable_result

ROLL = 440.0


def flown(place: int, path: str = "") -> Result:
    """Return a good flight that is a copy of no other one."""
    result = usable_result(8.0, path or f"flight{place}.bin")
    segments = tuple(
        replace(each, body_rate_rad_s=each.body_rate_rad_s + 1e-9 * place) for each in result.data.segments
    )
    return replace(result, data=replace(result.data, segments=segments))


def with_roll(result: Result, value: float, half_width: float) -> Result:
    """Return the result with another roll effectiveness."""
    model = result.identification.models[0]
    parameters = tuple(
        replace(item, value=value, ci95=(value - half_width, value + half_width))
        if item.name == "B11"
        else item
        for item in model.parameters
    )
    models = (replace(model, parameters=parameters), *result.identification.models[1:])
    return replace(result, identification=replace(result.identification, models=models))


def flights(values: Sequence[float], half_width: float = 8.0) -> list[Result]:
    return [with_roll(flown(place), value, half_width) for place, value in enumerate(values)]


def roll_of(found: Repeatability) -> RepeatedQuantity:
    (own,) = (each for each in found.quantities if each.axis == "roll" and each.kind == "effectiveness")
    return own


def test_flights_that_agree_are_told_to_agree() -> None:
    """Five flights with ± 8 that lie within ± 4 of each other."""
    found = repeat(flights([438.0, 441.0, 440.0, 442.0, 439.0]))
    assert found.verdict == "agree"
    assert set(found.axes.values()) == {"agree"}
    assert headline(found).startswith("5 flights agree: roll 440.0 ± 3.")
    assert headline(found).endswith("no flight is an outlier")


def test_the_flight_that_differs_is_named_with_its_difference() -> None:
    """Flight 3 has a tenth less; the four others agree."""
    found = repeat(flights([438.0, 441.0, 396.0, 442.0, 439.0]))
    assert found.verdict == "differ"
    assert found.axes == {"roll": "differ", "pitch": "agree", "yaw": "agree"}
    (outlier,) = roll_of(found).outliers
    assert outlier.flight == 2
    assert outlier.difference == pytest.approx(-44.0, abs=0.5)
    assert headline(found) == "flight2.bin is the outlier: 10 % less roll effectiveness than the others"


def test_of_three_flights_the_one_that_two_disagree_with_is_the_outlier() -> None:
    """Two others are the fewest that can agree."""
    found = repeat(flights([440.0, 500.0, 441.0]))
    assert [one.flight for one in roll_of(found).outliers] == [1]


def test_of_two_flights_that_differ_neither_is_the_outlier() -> None:
    """Nothing tells which one changed."""
    found = repeat(flights([440.0, 500.0]))
    assert found.verdict == "differ"
    assert roll_of(found).outliers == ()
    assert "no single flight is the outlier" in headline(found)
    assert "flight0.bin" in headline(found)
    assert "flight1.bin" in headline(found)


def test_flights_that_all_differ_have_no_outlier() -> None:
    """Two vehicles of two flights each: no one flight is to blame."""
    found = repeat(flights([400.0, 402.0, 440.0, 441.0], 4.0))
    assert found.verdict == "differ"
    assert not roll_of(found).outliers


def test_where_two_flights_could_each_be_the_outlier_neither_is_named() -> None:
    """440 and 480 with ± 4, and between them one that agrees with both."""
    alike = flights([440.0, 460.0, 480.0], 4.0)
    found = repeat([alike[0], with_roll(alike[1], 460.0, 40.0), alike[2]])
    assert found.verdict == "differ"
    assert roll_of(found).outliers == ()


@pytest.mark.thorough
def test_flights_of_one_vehicle_are_seldom_called_different() -> None:
    """At most 5 % of families of six flights whose intervals are right, and whose vehicle is one."""
    random = np.random.default_rng(4)
    wrong = []
    for _ in range(100):
        half = random.uniform(4.0, 40.0, 6)
        results = [
            with_roll(flown(place), ROLL + half[place] / 1.96 * random.standard_normal(), half[place])
            for place in range(6)
        ]
        wrong.append(roll_of(repeat(results)).differs)
    assert np.mean(wrong) <= 0.06


@pytest.mark.thorough
def test_the_prediction_from_the_others_holds_the_flight_left_out() -> None:
    """93 % and more of flights that differ by 5 % beyond their own errors."""
    random = np.random.default_rng(5)
    held, n = 0, 0
    for _ in range(60):
        values = ROLL * (1.0 + 0.05 * random.standard_normal(6)) + 5.0 / 1.96 * random.standard_normal(6)
        own = [each.held for each in roll_of(repeat(flights(values.tolist(), 5.0))).estimates]
        held, n = held + sum(map(bool, own)), n + len(own)
    assert 0.93 <= held / n <= 1.0


def test_what_two_vehicles_by_is_measured_with_an_interval() -> None:
    """Five per cent between twelve flights, known to one per cent each."""
    random = np.random.default_rng(6)
    values = ROLL * (1.0 + 0.05 * random.standard_normal(12))
    mean = roll_of(repeat(flights(values.tolist(), 4.4))).mean
    low, high = mean.sd_ci95
    assert low < 0.05 * ROLL < high
    assert low > 0.02 * ROLL
    assert high < 0.12 * ROLL


def test_a_pair_is_told_with_its_z_and_corrected_for_all_pairs() -> None:
    """Two flights with ± 8 that differ by 16: z is 16 / (8 sqrt 2) * 1.96, and p grows with the pairs."""
    one, more = (roll_of(repeat(flights([440.0, 456.0, *others]))).pairs for others in ([], [447.0, 449.0]))
    assert abs(one[0].z) == pytest.approx(1.96 * np.sqrt(2.0), rel=1e-3)
    assert more[0].z == one[0].z
    assert more[0].p_value > one[0].p_value


def test_a_flight_that_is_given_twice_counts_once() -> None:
    """Under another name it is still the same rates and torque."""
    found = repeat([*flights([440.0, 442.0]), replace(flights([440.0])[0])])
    assert len(roll_of(found).estimates) == 2
    assert found.reasons[2]["roll"] == "it repeats the flight of log 1"


def test_a_refused_flight_is_left_out_and_says_why() -> None:
    """Two others still agree, and the advice is that of the refused one."""
    found = repeat([*flights([440.0, 441.0]), refused_result()])
    assert len(roll_of(found).estimates) == 2
    assert set(found.reasons[2]) == {"roll", "pitch", "yaw"}
    assert found.axes["roll"] == "agree"
    assert found.advice


def test_two_refused_flights_are_not_comparable() -> None:
    """Nothing is compared, and nothing is called alike."""
    found = repeat([refused_result(), flown(0)])
    assert found.verdict == "not comparable"
    assert found.quantities == ()
    assert any("only flight0.bin identifies it" in line for line in repetition_lines(found))


def test_one_flight_repeats_nothing() -> None:
    with pytest.raises(SettingsError, match="One flight"):
        repeat([flown(0)])


def test_newton_metres_and_commands_are_not_compared() -> None:
    """Numbers in different units are no repetition."""
    one, two = flown(0), flown(1)
    assert two.data.input is not None
    other = replace(two, data=replace(two.data, input=replace(two.data.input, unit="N m", kind="torque_n_m")))
    with pytest.raises(SettingsError, match="a normalised command"):
        repeat([one, other])


def test_a_log_of_another_vehicle_is_named_by_what_it_says() -> None:
    """The hardware id of one of three is another one."""
    logs = [replace(flown(place).log, hardware_id=text) for place, text in enumerate(("A1", "A1", "B2"))]
    assert strangers(logs) == {2: "hardware id B2 instead of A1"}
    found = repeat([replace(flown(place), log=log) for place, log in enumerate(logs)])
    assert found.verdict == "differ"
    assert "not flights of one vehicle: flight2.bin has hardware id B2" in headline(found)


def test_what_a_log_does_not_say_makes_no_other_vehicle() -> None:
    said = ("A1", "", "A1", "B2")
    logs = [replace(flown(place).log, hardware_id=text) for place, text in enumerate(said)]
    assert set(strangers(logs)) == {3}


def test_what_another_throttle_makes_of_yaw_is_no_difference() -> None:
    """A tenth more throttle may make a fifth more of yaw, and nothing of roll here."""
    one, two = flown(0), flown(1)
    segments = tuple(
        replace(each, throttle=None if each.throttle is None else 1.1 * each.throttle)
        for each in two.data.segments
    )
    more = replace(two, data=replace(two.data, segments=segments))

    def yaw(results: list[Result]) -> float:
        (own,) = (
            each for each in repeat(results).quantities if each.axis == "yaw" and each.kind == "effectiveness"
        )
        return sum(each.allowed for each in own.estimates)

    assert yaw([one, more]) > yaw([one, two])


def test_the_sentences_hold_no_control_characters() -> None:
    """Names of logs are untrusted."""
    found = repeat([flown(0, "a\x1b[31m\u202e<b>.bin"), flown(1)])
    assert all(line.isprintable() for line in repetition_lines(found))
