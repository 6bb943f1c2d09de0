"""Each finding about a model from either side of its limit, everything else as in a good flight."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.model import BandCheck, ChangeCheck, Identification, Model
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.diagnose.advice import advice_for, next_steps
from quadid_logs.diagnose.model_findings import find_in_models
from quadid_logs.identify import identify
from tests.align.flights import flight_log
from tests.identify.vehicles import QUAD, fly, multisine


@pytest.fixture(scope="module")
def good() -> Identification:
    return identify(fly(QUAD, multisine(30.0), feedback=8.0), IdentifySettings())


def found(identification: Identification, change: Callable[[Model], Model]) -> dict[str, str]:
    """Return code and level of what is said of pitch, or of no axis, when the model is changed so."""
    first, *others = identification.models
    changed = dataclasses.replace(identification, models=(change(first), *others))
    findings = find_in_models(flight_log(), changed)
    return {one.code: one.level for one in findings if not one.axes or one.axes == ("pitch",)}


def with_gain(model: Model, low: float, high: float, value: float = 1.0) -> Model:
    """Return the model with this interval of B22, all in parts of its value."""
    own = next(one for one in model.parameters if (one.target, one.regressor) == ("q_dot", "M"))
    now = dataclasses.replace(
        own,
        value=value * own.value,
        ci95=(low * own.value, high * own.value),
        half_width=0.5 * (high - low) * own.value,
    )
    return dataclasses.replace(
        model, parameters=tuple(now if one is own else one for one in model.parameters)
    )


def with_setpoints(model: Model) -> Model:
    """Return the model as if set-points had told which motion was commanded."""
    assert model.structural is not None
    return dataclasses.replace(model, structural=dataclasses.replace(model.structural, instrumented=True))


def test_of_a_good_flight_nothing_is_said(good: Identification) -> None:
    """What follows is due to what was changed."""
    assert "QL5" not in "".join(code for code in found(good, lambda model: model) if code != "QL501")


@pytest.mark.parametrize(("half_width", "level"), [(0.29, None), (0.31, "warning"), (0.49, "warning")])
def test_an_interval_wider_than_three_tenths_is_a_caution(
    good: Identification, half_width: float, level: str | None
) -> None:
    """Half of it, on either side: the size of an effectiveness is worth more than silence."""
    said = found(good, lambda model: with_gain(model, 1.0 - half_width, 1.0 + half_width))
    assert said.get("QL505") == level


@pytest.mark.parametrize(("low", "high"), [(0.65, 1.35), (0.5, 1.6)])
def test_an_interval_that_effects_alone_make_wide_is_a_caution(
    good: Identification, low: float, high: float
) -> None:
    """What a flight leaves open of a dead zone or a limit is doubt, and no contradiction."""

    def widened(model: Model) -> Model:
        own = next(one for one in model.parameters if (one.target, one.regressor) == ("q_dot", "M"))
        now = dataclasses.replace(own, ci95=(low * own.value, high * own.value), half_width=0.2 * own.value)
        return dataclasses.replace(
            model, parameters=tuple(now if one is own else one for one in model.parameters)
        )

    assert found(good, widened)["QL505"] == "warning"


@pytest.mark.parametrize(
    ("low", "high", "level"),
    [(0.6, 1.7, "warning"), (0.6, 1.9, "error"), (-0.1, 0.8, "error"), (-0.5, 1.2, "error")],
)
def test_an_interval_whose_ends_are_a_factor_of_three_apart_is_refused(
    good: Identification, low: float, high: float, level: str
) -> None:
    """No gain margin bears that, nor a sign that may be either."""
    assert found(good, lambda model: with_gain(model, low, high))["QL505"] == level


@pytest.mark.parametrize(("log_format", "columns"), [("table", True), ("dataflash", False), ("ulog", False)])
def test_what_is_said_of_motion_that_was_enough_names_the_axes(
    good: Identification, log_format: str, *, columns: bool
) -> None:
    """Beside it stands what to fly on the others; of the columns only who made them can tell."""
    fast = np.radians([30.0, 25.0, 5.0])
    excitation = tuple(
        dataclasses.replace(each, rate_rms_rad_s=float(rms), signal_to_noise=0.9)
        for each, rms in zip(good.excitation, fast, strict=True)
    )
    weak = dataclasses.replace(good, excitation=excitation, responses=())
    log = dataclasses.replace(flight_log(), format=log_format)
    weak_axes = [(log, one) for one in find_in_models(log, weak) if one.code == "QL504"]
    (advice,) = (one for one in next_steps(weak_axes) if "would not help" in one)
    assert advice.startswith("Roll and pitch turned by more than 20 deg/s rms")
    assert ("units, signs and times of the table" in advice) == columns


@pytest.mark.parametrize(
    ("signal_to_noise", "high", "setpoints", "code"),
    [
        (1.1, 2.0, False, "QL404"),
        (0.9, 2.0, False, "QL504"),
        (1.1, 4.0, False, "QL504"),
        (1.1, 2.0, True, "QL504"),
        (2.9, 2.0, True, "QL504"),
    ],
)
def test_half_of_the_motion_is_enough_where_the_interval_holds_what_feedback_took(
    good: Identification, signal_to_noise: float, high: float, setpoints: bool, code: str
) -> None:
    """It does so without set-points alone; simulated in rough air, no such interval missed the truth."""
    excitation = tuple(dataclasses.replace(one, signal_to_noise=signal_to_noise) for one in good.excitation)

    def changed(model: Model) -> Model:
        wide = with_gain(model, 0.9, high)
        return with_setpoints(wide) if setpoints else wide

    said = found(dataclasses.replace(good, excitation=excitation), changed)
    assert {"QL404", "QL504"} & said.keys() == {code}


def commanded(model: Model, r2: float, axis: str = "q") -> Model:
    """Return the model as if it explained so much of what was commanded, by set-points, of pitch or yaw."""
    told = dataclasses.replace(model.validation, r2_commanded={f"{axis}_dot": r2})
    return dataclasses.replace(with_setpoints(model), validation=told)


@pytest.mark.parametrize(
    ("r2", "high", "code"), [(0.8, 1.5, "QL404"), (0.7, 1.5, "QL504"), (0.8, 3.5, "QL504")]
)
def test_rough_air_alone_refuses_no_axis_whose_commanded_motion_is_explained(
    good: Identification, r2: float, high: float, code: str
) -> None:
    """A third of the acceleration is explained, but all that was commanded; the interval must be of use."""
    excitation = tuple(dataclasses.replace(one, signal_to_noise=0.5) for one in good.excitation)
    said = found(
        dataclasses.replace(good, excitation=excitation),
        lambda model: with_gain(commanded(model, r2), 0.9, high),
    )
    assert {"QL404", "QL504"} & said.keys() == {code}


def test_rough_air_refuses_yaw_all_the_same(good: Identification) -> None:
    """It hides the reaction of the rotors, which then passes for effectiveness."""
    excitation = tuple(dataclasses.replace(one, signal_to_noise=0.5) for one in good.excitation)
    first, *others = good.models
    models = (commanded(first, 0.9, "r"), *others)
    changed = dataclasses.replace(good, excitation=excitation, models=models)
    assert "QL504" in {one.code for one in find_in_models(flight_log(), changed) if one.axes == ("yaw",)}


@pytest.mark.parametrize(("r2", "level"), [(0.8, "warning"), (0.7, "error")])
def test_a_rate_that_gusts_hide_is_a_caution_where_the_commanded_motion_is_explained(
    good: Identification, r2: float, level: str
) -> None:
    """Of the simulated rate over five seconds a third is left."""

    def hidden(model: Model) -> Model:
        model = commanded(model, r2)
        rate = {**model.validation.r2_high_passed_rate, "q": 0.3}
        return dataclasses.replace(
            model, validation=dataclasses.replace(model.validation, r2_high_passed_rate=rate)
        )

    assert found(good, hidden)["QL511"] == level


@pytest.mark.parametrize(("strength", "refused"), [(0.9, True), (1.1, False), (np.nan, False)])
def test_an_axis_whose_torque_hardly_follows_from_the_setpoints_is_refused(
    good: Identification, strength: float, refused: bool
) -> None:
    """Its instruments are weak: what they find leans towards the controller's answer to the air."""

    def driven(model: Model) -> Model:
        model = with_setpoints(model)
        assert model.structural is not None
        check = dataclasses.replace(model.structural, strength=np.array([9.0, strength, 9.0]))
        return dataclasses.replace(model, structural=check)

    assert (found(good, driven).get("QL403") == "error") is refused


def test_an_effectiveness_of_the_wrong_sign_is_refused(good: Identification) -> None:
    """However narrow its interval."""
    assert found(good, lambda model: with_gain(model, -1.01, -0.99, -1.0))["QL506"] == "error"


def test_an_effectiveness_that_may_have_either_sign_is_too_wide_and_not_of_the_wrong_one(
    good: Identification,
) -> None:
    """-0.5, from -6 to 6: nothing says that the torque turns the vehicle the other way."""
    told = found(good, lambda model: with_gain(model, -6.0, 6.0, -0.5))
    assert "QL506" not in told
    assert told["QL505"] == "error"


@pytest.mark.parametrize(
    ("spread", "level"), [(0.09, None), (0.12, "warning"), (0.24, "warning"), (0.27, "error")]
)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_effectiveness_that_depends_on_the_band_is_told(
    good: Identification, spread: float, level: str | None, sign: float
) -> None:
    """In the narrower or the wider band, below or above."""
    for row in (1, 2):
        gain = np.ones((3, 3))
        gain[row, 1] += sign * spread
        band = BandCheck(low_hz=np.full(3, 0.3), cutoff_hz=np.array([5.0, 2.5, 8.0]), on_axis_gain=gain)
        assert (
            found(good, lambda model, band=band: dataclasses.replace(model, band=band)).get("QL503") == level
        )


@pytest.mark.parametrize(
    ("relative", "statistic", "level"),
    [
        (0.09, 99.0, "info"),
        (0.12, 99.0, "warning"),
        (0.27, 99.0, "error"),
        (0.27, 15.0, None),
        (0.27, 17.0, "error"),
    ],
)
def test_a_change_in_flight_is_told_where_it_is_no_chance_and_a_warning_where_it_is_large(
    good: Identification, relative: float, statistic: float, level: str | None
) -> None:
    """Relative to the mean of before and after."""
    before, after = np.full(3, 100.0 * (1.0 - 0.5 * relative)), np.full(3, 100.0 * (1.0 + 0.5 * relative))
    change = ChangeCheck(time_s=np.full(3, 9.0), before=before, after=after, statistic=np.full(3, statistic))
    assert found(good, lambda model: dataclasses.replace(model, change=change)).get("QL509") == level


@pytest.mark.parametrize(("changed", "warned"), [((0, 2), True), ((0,), False), ((0, 1, 2), False)])
def test_an_axis_is_a_caution_where_both_others_change_in_flight(
    good: Identification, changed: tuple[int, ...], warned: bool
) -> None:
    """Pitch was commanded for some seconds in which all effectiveness was low, and was 12 % low itself."""
    statistic = np.zeros(3)
    statistic[list(changed)] = 50.0
    change = ChangeCheck(
        time_s=np.full(3, 9.0), before=np.full(3, 90.0), after=np.full(3, 110.0), statistic=statistic
    )
    assert ("QL532" in found(good, lambda model: dataclasses.replace(model, change=change))) is warned


@pytest.mark.parametrize(
    ("r2", "level"), [(0.85, None), (0.75, "warning"), (0.55, "warning"), (0.45, "error"), (np.nan, "error")]
)
def test_an_axis_whose_torque_does_not_reproduce_its_motion_is_told(
    good: Identification, r2: float, level: str | None
) -> None:
    """Less than 0.8 of the rate in the fitted band is a warning, less than half of it an error."""

    def worse(model: Model) -> Model:
        known = {**model.validation.r2_high_passed_rate, "q": r2}
        return dataclasses.replace(
            model, validation=dataclasses.replace(model.validation, r2_high_passed_rate=known)
        )

    assert found(good, worse).get("QL511") == level


@pytest.mark.parametrize(
    ("signal_to_noise", "code"), [(2.9, "QL504"), (3.1, "QL404"), (8.9, "QL404"), (9.1, None)]
)
def test_an_axis_is_judged_by_what_the_model_explains_of_it(
    good: Identification, signal_to_noise: float, code: str | None
) -> None:
    """Three times as much as it leaves at least, nine times to be without caution."""
    roll, pitch, yaw = good.excitation
    weak = dataclasses.replace(pitch, signal_to_noise=signal_to_noise)
    said = found(dataclasses.replace(good, excitation=(roll, weak, yaw)), with_setpoints)
    assert {"QL504", "QL404"} & set(said) == ({code} if code else set())


def findings_at(
    good: Identification, rate_deg_s: float, signal_to_noise: float, change: Callable[[Model], Model]
) -> list[Finding]:
    """Return what is said of pitch that turns so much and is explained so well."""
    roll, pitch, yaw = good.excitation
    moved = dataclasses.replace(
        pitch, rate_rms_rad_s=float(np.radians(rate_deg_s)), signal_to_noise=signal_to_noise
    )
    first, *others = good.models
    changed = dataclasses.replace(good, excitation=(roll, moved, yaw), models=(change(first), *others))
    return [one for one in find_in_models(flight_log(), changed) if one.axes == ("pitch",)]


@pytest.mark.parametrize(("signal_to_noise", "code"), [(2.0, "QL504"), (6.0, "QL404")])
@pytest.mark.parametrize(("rate_deg_s", "helps"), [(19.0, True), (21.0, False), (100.0, False)])
def test_an_axis_that_turned_a_lot_is_not_told_to_turn_more(
    good: Identification, rate_deg_s: float, helps: bool, signal_to_noise: float, code: str
) -> None:
    """At 100 deg/s rms it is not excitation that lacks."""
    (said,) = findings_at(good, rate_deg_s, signal_to_noise, with_setpoints)
    assert said.code == code
    assert ("doublets" in said.advice) is helps
    assert (said.step is None) is helps
    assert helps or "weakly" not in said.title


def with_response(good: Identification, gain: np.ndarray) -> Identification:
    """Return the flight as if pitch had answered to torque with this response."""
    roll, pitch, yaw = good.responses
    known = dataclasses.replace(pitch, gain=gain, error=np.full(gain.shape, 0.05))
    return dataclasses.replace(good, responses=(roll, known, yaw))


def test_torque_that_follows_rate_is_refused_by_name(good: Identification) -> None:
    """However well the model explains it, and however much the axis turned: with what to fly."""
    frequency_hz = good.responses[1].frequency_hz
    inverse = with_response(good, -2j * np.pi * frequency_hz / 0.3)
    (said,) = findings_at(inverse, 100.0, 2.0, lambda model: model)
    assert (said.code, said.level) == ("QL516", "error")
    assert "the log shows the pitch controller, not the vehicle" in said.title
    assert said.evidence["phase_deg"] == pytest.approx(-90.0)
    assert said.evidence["grows_with_power_of_frequency"] == pytest.approx(1.0)
    assert "doublets" in said.advice


def test_a_level_response_is_no_inverse_controller(good: Identification) -> None:
    """As a rigid body has it."""
    level = with_response(good, np.full(good.responses[1].gain.shape, 80.0 + 0j))
    assert "QL516" not in found(level, lambda model: model)


@pytest.mark.parametrize(("rate_deg_s", "said"), [(1.0, False), (3.0, True)])
def test_the_lag_of_a_vehicle_at_rest_is_not_judged(
    good: Identification, rate_deg_s: float, said: bool
) -> None:
    """Any lag fits noise: the clocks are not to be suspected."""
    still = tuple(
        dataclasses.replace(each, rate_rms_rad_s=float(np.radians(rate_deg_s))) for each in good.excitation
    )

    def late(model: Model) -> Model:
        assert model.actuator is not None
        return dataclasses.replace(model, actuator=dataclasses.replace(model.actuator, delay_s=0.06))

    assert ("QL507" in found(dataclasses.replace(good, excitation=still), late)) is said


@pytest.mark.parametrize(("rate_deg_s", "refused"), [(1.9, True), (2.1, False)])
def test_an_axis_that_turns_no_more_than_in_hover_is_refused(
    good: Identification, rate_deg_s: float, refused: bool
) -> None:
    """2 deg/s rms."""
    roll, pitch, yaw = good.excitation
    still = dataclasses.replace(pitch, rate_rms_rad_s=float(np.radians(rate_deg_s)))
    said = found(dataclasses.replace(good, excitation=(roll, still, yaw)), lambda model: model)
    assert (said.get("QL403") == "error") is refused


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [("lag_s", 0.24, False), ("lag_s", 0.25, True), ("delay_s", 0.059, False), ("delay_s", 0.06, True)],
)
def test_a_lag_or_delay_at_the_end_of_its_range_is_told(
    good: Identification, name: str, value: float, told: bool
) -> None:
    """250 ms of lag, 60 ms of delay."""

    def late(model: Model) -> Model:
        assert model.actuator is not None
        return dataclasses.replace(model, actuator=dataclasses.replace(model.actuator, **{name: value}))

    assert ("QL507" in found(good, late)) is told


@pytest.mark.parametrize(("r2", "level"), [(0.4, "warning"), (-0.3, "error")])
def test_a_yaw_of_a_slow_log_that_explains_nothing_is_not_offered_for_comparisons(
    good: Identification, r2: float, level: str
) -> None:
    """It was refused, and the advice spoke of comparing it."""
    first, *others = good.models
    validation = dataclasses.replace(
        first.validation, r2_acceleration={**first.validation.r2_acceleration, "r_dot": r2}
    )
    slow = dataclasses.replace(
        good, only_yaw=True, models=(dataclasses.replace(first, validation=validation), *others)
    )
    (one,) = (one for one in find_in_models(flight_log(), slow) if one.code == "QL531")
    assert one.level == level
    assert ("Compare" in one.advice) == (level == "warning")


def test_a_yaw_that_a_slow_log_cannot_confirm_asks_for_what_roll_and_pitch_ask_for(
    good: Identification,
) -> None:
    """Two steps stood for one: to set the log's rate, and to log faster."""
    first, *others = good.models
    nothing = {**first.validation.r2_acceleration, "r_dot": -0.3}
    validation = dataclasses.replace(first.validation, r2_acceleration=nothing)
    slow = dataclasses.replace(
        good, only_yaw=True, models=(dataclasses.replace(first, validation=validation), *others)
    )
    log = dataclasses.replace(flight_log(), autopilot="px4", format="ulog")
    (one,) = (one for one in find_in_models(log, slow) if one.code == "QL531")
    assert one.advice == advice_for("px4").logging("ulog", log.parameters, None)
    assert "SDLOG_PROFILE" in one.advice
