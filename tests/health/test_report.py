"""What a log shows reaches the page, the terminal and the JSON, and promises nothing that is not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from quadid_logs import result_dict
from quadid_logs.data.health import Health
from quadid_logs.figures import CHAPTERS, figures_of
from quadid_logs.health.course import find_tilt
from quadid_logs.report.health_view import health_lines, health_view
from tests.health.flights import grid, series
from tests.synthetic_results import refused_result, synthetic_health, usable_result

TOPICS = {
    "tracking",
    "noise",
    "command_noise",
    "filters",
    "vibration",
    "motors",
    "battery",
    "oscillation",
    "rotors",
}


def test_the_json_has_every_topic_of_the_contract() -> None:
    """With a sentence, a level and findings; figures with value, interval, unit and what is normal."""
    health = result_dict(usable_result(8.0))["health"]
    assert set(health) >= TOPICS
    for name in TOPICS - {"filters", "rotors"}:
        assert {"sentence", "level", "findings"} <= set(health[name])
    assert health["motors"]["spread"] == {"value": 0.09, "unit": "1", "ci95": None, "normal": [0.0, 0.075]}
    assert health["oscillation"]["axes"][0]["axis"] == "roll"
    assert health["oscillation"]["axes"][0]["frequency"]["value"] == 85.0


def test_every_chart_of_the_chapter_is_captioned_by_its_judgement() -> None:
    """In the order of the page; the spectrogram belongs to the spectrum's sentence."""
    result = replace(usable_result(8.0), health=synthetic_health("This is the judgement."))
    figures = {figure.key: figure for figure in figures_of(result).shown}
    assert tuple(key for key in figures if key in CHAPTERS["shows"]) == CHAPTERS["shows"]
    for key in set(CHAPTERS["shows"]) - {"spectrogram"}:
        assert figures[key].caption.startswith("This is the judgement.")


def test_the_terminal_gets_the_judged_charts_only() -> None:
    """A number that nobody published a norm for stays on the page."""
    lines = health_lines(replace(refused_result(), health=synthetic_health()))
    assert [line.split(":")[0].strip() for line in lines] == ["oscillation", "motors", "vibration", "battery"]


def test_the_terminal_is_told_of_a_vehicle_that_turned_over() -> None:
    """It heard of every flight that stayed upright, and nothing of a crash."""
    t = grid(50.0)
    tilted = np.zeros((t.size, 3))
    tilted[t.size // 2 :, 0] = np.radians(120.0)
    tilt = find_tilt(series("attitude", t, tilted), ((t[0], t[-1]),))
    (line,) = health_lines(replace(refused_result(), health=Health(tilt=tilt)))
    assert "loss of control" in line


def test_an_oscillation_hints_at_gains_only_where_tuning_knows_the_way() -> None:
    """A refused axis has no recommended gains, so no direction is named."""
    (first, *_) = health_view(replace(refused_result(), health=synthetic_health())).lines
    assert first.name == "Oscillation"
    assert first.sentence == "All is well."


def test_a_log_without_a_flight_says_so_once() -> None:
    """Not once for every chart."""
    missing = dict.fromkeys(
        (
            "tracking",
            "attitude",
            "steps",
            "noise",
            "command_noise",
            "motors",
            "throttle",
            "vibration",
            "battery",
            "oscillation",
            "rotors",
        ),
        "the throttle never left idle",
    )
    view = health_view(replace(refused_result(), health=Health(missing=missing)))
    assert view.lines == ()
    assert view.missing == ("Nothing can be shown: the throttle never left idle.",)


def test_a_missing_signal_is_named_with_what_it_keeps_back() -> None:
    """One line for each reason."""
    missing = {"tracking": "the log holds no rate set-points", "steps": "the log holds no rate set-points"}
    view = health_view(replace(refused_result(), health=Health(missing=missing)))
    assert view.missing == (
        "Not shown: rates against set-points and step response, because the log holds no rate set-points.",
    )
