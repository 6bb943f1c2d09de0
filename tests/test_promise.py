"""A promise is written, read, and held against the next flight."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.health import Health, Quantity, RotorBalance, Rotors
from quadid_logs.data.model import Model
from quadid_logs.data.off_nominal import AS_FLOWN, Ranges
from quadid_logs.data.promise import Check, Decision, Flown, Held, Obstacle, Outcome, Promise, QuantityKind
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD, Tuning, TuningVerdict
from quadid_logs.errors import PromiseFileError
from quadid_logs.maths.multiple_tests import holm
from quadid_logs.promise import check, promise_of
from quadid_logs.report.check_view import check_lines, check_text
from quadid_logs.report.promise_file import promise_text, read_promise
from quadid_logs.report.provenance import Provenance
from quadid_logs.tuning import recommend
from quadid_logs.vocabulary import ON_AXIS
from tests.tuned_flights import as_flown, flown

PROVENANCE = Provenance(version="0", command="quadid-log tune flight.bin", log_sha256="a" * 64)


@pytest.fixture(scope="module")
def advice() -> Tuning:
    """Raised gains of roll."""
    return recommend(flown("ardupilot"), GOOD, ["roll"])


@pytest.fixture(autouse=True, scope="module")
def _advised(advice: Tuning) -> Iterator[None]:
    """What the next flight recommends is not the matter here, and takes seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("quadid_logs.promise.tuning_of", lambda _result: advice)
        yield


@pytest.fixture(scope="module")
def promise(advice: Tuning) -> Promise:
    """Of these."""
    promised = promise_of(flown("ardupilot"), advice, "a" * 64)
    assert promised is not None
    return promised


@pytest.fixture(scope="module")
def followed(advice: Tuning) -> Result:
    """The same vehicle with the recommended gains."""
    return as_flown(flown("ardupilot"), **{name: one.next for name, one in advice.changes.items()})


@pytest.fixture(scope="module")
def kept(promise: Promise, followed: Result) -> Check:
    """That flight held against the promise."""
    return check(promise, followed)


@pytest.fixture(scope="module")
def written(promise: Promise) -> str:
    """The promise as a file."""
    return promise_text(promise, PROVENANCE)


def with_model(result: Result, model: Model) -> Result:
    """Return the result with another recommended model."""
    models = tuple(
        model if one is result.identification.recommended else one for one in result.identification.models
    )
    return replace(result, identification=replace(result.identification, models=models))


def with_entry(result: Result, key: tuple[str, str], factor: float, offset: float = 0.0) -> Result:
    """Return the result with one element of the model changed."""
    model = result.identification.recommended
    assert model is not None
    parameters = tuple(
        replace(
            one,
            value=factor * one.value + offset,
            ci95=(factor * one.ci95[0] + offset, factor * one.ci95[1] + offset),
        )
        if (one.target, one.regressor) == key
        else one
        for one in model.parameters
    )
    return with_model(result, replace(model, parameters=parameters))


def test_a_promise_is_read_as_it_was_written(promise: Promise, written: str, tmp_path: Path) -> None:
    """Every number, in the file or in its folder."""
    (tmp_path / "promise.json").write_text(written)
    assert read_promise(tmp_path / "promise.json") == promise
    assert read_promise(tmp_path) == promise


def test_a_flight_as_promised_keeps_the_promise(kept: Check) -> None:
    """Inside on its axis, with the gains that were to fly."""
    assert kept.outcome is Outcome.KEPT
    assert kept.axes["roll"].held is Held.INSIDE
    assert kept.axes["roll"].flown is Flown.NEXT


@pytest.mark.parametrize(
    ("verdict", "decision"),
    [("keep", Decision.KEEP), ("change", Decision.GO_ON), ("refused", Decision.NO_ADVICE)],
)
def test_what_to_do_is_what_the_next_flight_recommends(
    verdict: TuningVerdict,
    decision: Decision,
    promise: Promise,
    followed: Result,
    advice: Tuning,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One source of advice: its own tuning."""
    told = replace(advice, axes={"roll": replace(advice.axes["roll"], verdict=verdict)})
    monkeypatch.setattr("quadid_logs.promise.tuning_of", lambda _result: told)
    assert check(promise, followed).decision is decision


def test_gains_that_were_not_loaded_are_noticed(promise: Promise) -> None:
    """The pilot flew with the earlier ones."""
    found = check(promise, flown("ardupilot"))
    assert found.outcome is Outcome.BROKEN
    assert found.axes["roll"].flown is Flown.BACK


def test_other_gains_than_promised_are_noticed(promise: Promise, followed: Result) -> None:
    """A wrong file: neither the next gains nor the earlier ones."""
    found = check(promise, as_flown(followed, ATC_RAT_RLL_P=0.09))
    assert found.outcome is Outcome.BROKEN
    assert found.axes["roll"].obstacle is Obstacle.OTHER_GAINS
    assert set(found.axes["roll"].other_gains) == {"ATC_RAT_RLL_P"}


def test_another_filter_is_another_loop(promise: Promise, followed: Result) -> None:
    """The promise is that of the filters, too."""
    found = check(promise, as_flown(followed, ATC_RAT_RLL_FLTD=10.0))
    assert found.axes["roll"].obstacle is Obstacle.OTHER_GAINS


@pytest.mark.thorough
def test_gains_that_are_written_as_another_product_are_those_promised() -> None:
    """PX4 multiplies P, I and D by K: twice K is twice all three."""
    before = flown("px4")
    # Of the vehicle as it flew one factor on all three is enough; in other air each gain changes by itself.
    advice = recommend(before, GOOD, ["roll"], apart=False, ranges=AS_FLOWN)
    promised = promise_of(before, advice)
    assert promised is not None
    factor = advice.changes["MC_ROLLRATE_K"].next
    gains = {name: factor * before.log.parameters[name] for name in (f"MC_ROLLRATE_{one}" for one in "PID")}
    assert check(promised, as_flown(before, **gains)).axes["roll"].flown is Flown.NEXT


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_another_propeller_is_recognised_by_its_effectiveness(
    factor: float, promise: Promise, followed: Result
) -> None:
    """The margins may even be better: the vehicle is another one."""
    found = check(promise, with_entry(followed, ON_AXIS["roll"], factor))
    assert found.outcome is Outcome.BROKEN
    assert [one.axis for one in found.vehicle_changes] == ["roll"]


def sharply_known(result: Result) -> Result:
    """Return the result as if its flight had been so long that it tells effectiveness to 0.1 %."""
    model = result.identification.recommended
    assert model is not None
    parameters = tuple(
        replace(one, ci95=(one.value - 1e-3 * abs(one.value), one.value + 1e-3 * abs(one.value)))
        if (one.target, one.regressor) in ON_AXIS.values()
        else one
        for one in model.parameters
    )
    return with_model(result, replace(model, parameters=parameters))


def test_a_battery_that_pulls_a_little_less_breaks_no_promise(advice: Tuning, followed: Result) -> None:
    """Two flights of one vehicle differ by some per cent, however well each of them is known."""
    promised = promise_of(sharply_known(flown("ardupilot")), advice)
    assert promised is not None
    weaker = with_entry(sharply_known(followed), ON_AXIS["roll"], 0.98)
    assert check(promised, weaker).outcome is Outcome.KEPT


def test_one_weak_motor_is_recognised_by_its_coupling(promise: Promise, followed: Result) -> None:
    """A fifth less of one motor of four turns pitch by a twentieth of a roll command."""
    gain = next(one.value for one in promise.quantities if one.kind is QuantityKind.EFFECTIVENESS)
    found = check(promise, with_entry(followed, ("q_dot", "L"), 1.0, 0.05 * gain))
    assert {one.kind for one in found.vehicle_changes} == {QuantityKind.COUPLING}
    assert found.outcome is Outcome.BROKEN
    assert any(
        "find out what changed before you fly again" in line for line in check_lines(promise, followed, found)
    )


@pytest.mark.parametrize(
    ("changes", "obstacle"),
    [
        ({"autopilot": "px4"}, Obstacle.OTHER_AUTOPILOT),
        ({"frame": "HEXA/X"}, Obstacle.OTHER_FRAME),
        ({"hardware_id": "another"}, Obstacle.OTHER_HARDWARE),
        ({"log_sha256": "b" * 64}, Obstacle.SAME_LOG),
    ],
)
def test_another_vehicle_is_not_compared(
    changes: dict[str, str], obstacle: Obstacle, promise: Promise, followed: Result
) -> None:
    """And the same flight is no next one."""
    after = replace(followed, log=replace(followed.log, hardware_id="mine"))
    mine = replace(promise, hardware_id="mine")
    found = check(replace(mine, **changes), after, "b" * 64)
    assert found.obstacle is obstacle
    assert found.outcome is Outcome.NOT_COMPARABLE
    assert found.decision is Decision.NO_ADVICE


def test_a_flight_that_tells_no_margins_is_not_comparable(promise: Promise, followed: Result) -> None:
    """Neither kept nor broken."""
    assert followed.closed_loop is not None
    axes = {axis: replace(one, margins=None, plants=None) for axis, one in followed.closed_loop.axes.items()}
    found = check(promise, replace(followed, closed_loop=replace(followed.closed_loop, axes=axes)))
    assert found.outcome is Outcome.NOT_COMPARABLE


def test_nothing_is_promised_where_nothing_is_recommended(advice: Tuning) -> None:
    """No file then."""
    refused = replace(advice, axes={"roll": replace(advice.axes["roll"], verdict="refused")})
    assert promise_of(flown("ardupilot"), refused) is None


def test_a_hostile_log_reaches_neither_terminal_nor_json_as_it_is(
    promise: Promise, followed: Result, kept: Check
) -> None:
    """Control characters are hidden, and JSON is strict."""
    hostile = replace(followed, log=replace(followed.log, path="a\x1b[31m\nb.bin"))
    assert all(line.isprintable() for line in check_lines(replace(promise, log="x\x1b\n"), hostile, kept))
    assert json.loads(check_text(promise, hostile, kept))["verdict"] == "kept"


def test_an_open_interval_survives_the_file(promise: Promise, tmp_path: Path) -> None:
    """JSON knows no infinity."""
    margins = promise.axes["roll"].margins
    assert margins is not None
    assert margins.rate.gain_margin_db is not None
    figure = margins.rate.gain_margin_db._replace(ci95=(3.0, math.inf))
    loops = replace(margins, rate=replace(margins.rate, gain_margin_db=figure))
    axes = {"roll": replace(promise.axes["roll"], margins=loops)}
    (tmp_path / "promise.json").write_text(promise_text(replace(promise, axes=axes), PROVENANCE))
    read = read_promise(tmp_path).axes["roll"].margins
    assert read is not None
    assert read.rate.gain_margin_db == figure


def _paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the way to every value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(one for key, each in items for one in _paths(each, (*path, key)))]


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_promise_that_was_tampered_with_is_read_or_refused(data: st.DataObject) -> None:
    """Whatever stands in it, there is one clear error and no traceback."""
    content = json.loads(_TAMPERED[0])
    *way, last = data.draw(st.sampled_from([one for one in _paths(content) if one]))
    place = content
    for key in way:
        place = place[key]
    place[last] = data.draw(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.just([]) | st.just({})
        | st.just(10**400)
    )  # fmt: skip
    path = _TAMPERED[1] / "promise.json"
    path.write_text(json.dumps(content))
    with contextlib.suppress(PromiseFileError):
        read_promise(path)


_TAMPERED: list[Any] = []


@pytest.fixture(autouse=True, scope="module")
def _tampered(written: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    _TAMPERED[:] = [written, tmp_path_factory.mktemp("tampered")]


def test_a_promise_holds_the_ranges_that_its_gains_were_made_for(promise: Promise, tmp_path: Path) -> None:
    """The next flight is advised with the same ones."""
    ranges = Ranges(mass=(1.0, 1.5))
    (tmp_path / "promise.json").write_text(promise_text(replace(promise, ranges=ranges), PROVENANCE))
    assert read_promise(tmp_path).ranges == ranges


@pytest.mark.parametrize("mass", [[1.1, 1.2], [1.0], [0.9, "1.2"], None])
def test_a_promise_with_ranges_that_are_none_is_refused(mass: object, written: str, tmp_path: Path) -> None:
    """A range holds what flew."""
    content = json.loads(written)
    content["ranges"]["mass"] = mass
    (tmp_path / "promise.json").write_text(json.dumps(content))
    with pytest.raises(PromiseFileError):
        read_promise(tmp_path)


def test_a_promise_of_numbers_that_are_none_is_refused(written: str, tmp_path: Path) -> None:
    """Python reads NaN in JSON, and nothing compares with it."""
    content = json.loads(written)
    content["vehicle"]["quantities"][0]["value"] = math.nan
    (tmp_path / "promise.json").write_text(json.dumps(content))
    with pytest.raises(PromiseFileError):
        read_promise(tmp_path)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"[" * 100_000, b"\xff\xfe", b"9" * 5000, b" " * 2_000_000]
)
def test_what_is_no_promise_is_refused(content: bytes, tmp_path: Path) -> None:
    """Other files, damaged ones, large ones."""
    path = tmp_path / "promise.json"
    path.write_bytes(content)
    with pytest.raises(PromiseFileError):
        read_promise(path)


@given(st.lists(st.floats(0.0, 1.0), max_size=12))
def test_holm_rejects_what_bonferroni_rejects_and_nothing_above_the_level(p_values: list[float]) -> None:
    """Between the two, and in the order of the p-values."""
    rejected = holm(p_values, 0.05)
    assert all(one or p > 0.05 / len(p_values) for one, p in zip(rejected, p_values, strict=True))
    assert not any(one and p > 0.05 for one, p in zip(rejected, p_values, strict=True))
    highest = max((p for one, p in zip(rejected, p_values, strict=True) if one), default=-1.0)
    assert all(one for one, p in zip(rejected, p_values, strict=True) if p < highest)


def rotor_balance(gives: float) -> RotorBalance:
    """Return the balance of a quad X whose front right rotor gives so much of its thrust."""
    half = 0.5**0.5
    place = ((half, half, 1.0), (-half, -half, 1.0), (half, -half, -1.0), (-half, half, -1.0))
    sent = (1.0 / gives, 1.0, 1.0, 1.0)
    centre = [
        sum(one * row[column] for one, row in zip(sent, place, strict=True)) / sum(sent)
        for column in range(3)
    ]
    forward, right, yaw = (
        Quantity(value, "1", (value - width, value + width))
        for value, width in zip(centre, (0.002, 0.002, 0.012), strict=True)
    )
    return RotorBalance((forward, right, yaw), place)


def with_rotors(result: Result, gives: float) -> Result:
    """Return a result whose log shows that balance."""
    names = ("front right motor", "back left motor", "front left motor", "back right motor")
    nothing = (None,) * 4
    rotors = Rotors(
        sentence="",
        names=names,
        effectiveness=nothing,
        change=nothing,
        mass_offset=None,
        thrust_change=None,
        shaking=nothing,
        faults=(),
        searched=(),
        balance=rotor_balance(gives),
    )
    return replace(result, health=replace(result.health or Health(), rotors=rotors))


def test_a_rotor_that_gives_a_fifth_less_breaks_the_promise(promise: Promise, followed: Result) -> None:
    promised = replace(promise, balance=rotor_balance(1.0))
    found = check(promised, with_rotors(followed, 0.8))
    assert found.outcome is Outcome.BROKEN
    assert found.rotor is not None
    assert found.rotor.loss.value == pytest.approx(0.2, abs=0.005)
    lines = " ".join(check_lines(promised, followed, found))
    assert "Front right motor gives" in lines
    assert CATALOGUE["QL430"].advice in lines
    assert json.loads(check_text(promised, followed, found))["vehicle"]["rotor"]["number"] == 1


def test_the_balance_of_the_rotors_is_written_and_read(promise: Promise, tmp_path: Path) -> None:
    promised = replace(promise, balance=rotor_balance(0.9))
    (tmp_path / "promise.json").write_text(promise_text(promised, PROVENANCE), encoding="ascii")
    assert read_promise(tmp_path).balance == promised.balance
