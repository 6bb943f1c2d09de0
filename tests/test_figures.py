"""Figures as data: what is shown, what is left out, and that nothing is lost on the way to the eye."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from quadid_logs import figures
from quadid_logs.data.flight import Segment
from quadid_logs.data.health import Health
from quadid_logs.data.log import NO_GYRO_FILTER, GyroFilter, ModeChange, Notch
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings, in_band
from quadid_logs.figures import FIGURE_KEYS, REGISTERED
from quadid_logs.figures.bode import frequency_response, model_response
from quadid_logs.figures.closed_loop import loop_figures
from quadid_logs.figures.end_labels import labelled, names_at_ends
from quadid_logs.figures.health import health_figures
from quadid_logs.figures.interactive import interactive
from quadid_logs.figures.palette import DARK, LIGHT
from quadid_logs.figures.png import draw, write_png
from quadid_logs.figures.spec import Figure, Panel
from quadid_logs.figures.thinning import break_at_gaps, thin_line, thin_points
from quadid_logs.figures.ticks import log_ticks
from quadid_logs.figures.time_series import flight_overview
from quadid_logs.health.battery import find_battery
from quadid_logs.health.motors import find_motors
from quadid_logs.health.noise import find_noise
from quadid_logs.health.vibration import find_vibration
from tests.health.flights import series
from tests.marks import thorough, thorough_but
from tests.synthetic_results import hostile_result, refused_result, usable_result

#: Of the result that most tests look at, figures are made once.
figures_of = lru_cache(maxsize=2)(figures.figures_of)


@pytest.fixture(scope="module")
def usable() -> Result:
    """Return a good flight."""
    return usable_result()


def shown(result: Result, key: str) -> Figure:
    """Return a figure of a result."""
    return next(figure for figure in figures_of(result).shown if figure.key == key)


def test_a_good_flight_shows_every_figure(usable: Result) -> None:
    """Nothing is left out, and each promised figure is there once."""
    figures = figures_of(usable)
    keys = [figure.key for figure in figures.shown]
    assert figures.left_out == ()
    assert len(keys) == len(set(keys))
    assert set(keys) <= set(FIGURE_KEYS)
    assert {
        "flight",
        "aligned",
        "excitation",
        "condition-quadrotor-6",
        "condition-linear-9",
        "over-time",
    } <= {*keys}
    assert {"singular", "structures", "lag", "held-out", "fit", "simulation", "residuals", "horizon"} <= {
        *keys
    }


def test_figures_come_in_the_order_of_the_page(usable: Result) -> None:
    """Each function's together, where its first one stands."""
    keys = [figure.key for figure in figures_of(usable).shown]
    first = [row.keys[0] for row in REGISTERED if row.keys[0] in keys and row.chapter != "loop-detail"]
    wanted = [key for key in first if key != "residuals"]
    assert [key for key in keys if key in wanted] == wanted


def test_every_figure_is_registered_by_the_function_that_makes_it(usable: Result) -> None:
    """A key without a row would be drawn on no page."""
    for maker in {row.maker for row in REGISTERED}:
        keys = {key for row in REGISTERED if row.maker == maker for key in row.keys}
        assert {figure.key for figure in figures._made(maker, usable)} <= keys


def test_a_figure_with_nothing_to_show_is_left_out_with_a_reason() -> None:
    """A bench log has no series, no windows and no fit, and the reasons say so."""
    figures = figures_of(refused_result())
    assert figures.shown == ()
    assert all(item.reason for item in figures.left_out)
    assert "never armed" in next(item.reason for item in figures.left_out if item.key == "aligned")


def test_every_axis_has_a_label_and_every_physical_one_a_unit(usable: Result) -> None:
    """Only words, counts and ratios go without a unit."""
    without_unit = {
        "",
        "coherence",
        "gain",
        "imaginary part",
        "motor",
        "rate divided by set-point",
        "real part",
        "condition number of H_k",
        "singular value",
        "singular value, strongest first",
    }
    for figure in figures_of(usable).shown:
        for panel in figure.panels:
            for axis in (panel.x, panel.y):
                assert axis.unit or axis.label in without_unit or "1 − R²" in axis.label, (figure.key, axis)


def test_every_role_has_a_colour_in_both_palettes(usable: Result) -> None:
    """A figure never names a role that a palette lacks."""
    assert LIGHT.keys() == DARK.keys()
    for figure in figures_of(usable).shown:
        for panel in figure.panels:
            for item in (*panel.curves, *panel.bands, *panel.levels):
                assert item.role in LIGHT


def test_rates_are_shown_in_degrees(usable: Result) -> None:
    """The panel's values are those of the log times 180 / pi, and its axis says so."""
    panel = shown(usable, "flight").panels[0]
    truth = np.degrees(usable.data.overview["body_rate"].values[:, 0])
    assert panel.y.unit == "deg/s"
    assert np.nanmax(panel.curves[0].y) == pytest.approx(truth.max())
    assert np.nanmin(panel.curves[0].y) == pytest.approx(truth.min())


def test_lines_bear_their_names_at_their_ends_and_not_in_a_legend(usable: Result) -> None:
    """In the page and on paper; what is no line, as the band of errors, is explained in the legend."""
    evidence = shown(usable, "evidence")
    drawn = interactive(evidence)["data"]
    assert [trace["name"] for trace in drawn if trace["showlegend"]] == ["95 % of validation errors"]
    assert [trace["name"] for trace in drawn if trace.get("meta", {}).get("end")] == [
        "measured",
        "predicted",
    ] * 3
    canvas = draw(evidence)
    assert [text.get_text() for text in canvas.legends[0].get_texts()] == ["95 % of validation errors"]
    assert {"measured", "predicted"} <= {text.get_text() for text in canvas.axes[-1].texts}


def test_a_drawing_and_long_names_keep_their_legend(usable: Result) -> None:
    """Lines of a drawing end anywhere; a name as long as a file's would take the chart's place."""
    assert names_at_ends(shown(usable, "airframe")) == frozenset()
    panel = shown(usable, "evidence").panels[2]
    long = tuple(replace(curve, label=curve.label + " in the flight before") for curve in panel.curves)
    assert labelled(replace(panel, curves=long)) == ()


@pytest.mark.parametrize("n_modes", thorough_but([0, 60, 61], [0, 1, 59, 60, 61, 500]))
def test_any_number_of_mode_changes_is_shaded_within_reason(usable: Result, n_modes: int) -> None:
    """A table has no modes at all; a broken log has thousands, and the caption says what is left out."""
    modes = tuple(ModeChange(time_s=20.0 + 0.1 * i, position=i, name=f"M{i % 7}") for i in range(n_modes))
    figure = shown(replace(usable, data=replace(usable.data, modes=modes)), "flight")
    assert len(figure.panels[0].bands) == min(n_modes, 60)
    assert ("Only the first" in figure.caption) == (n_modes > 60)


def test_a_pause_in_the_log_is_left_blank() -> None:
    """A NaN stands where samples are missing, and nowhere else."""
    time_s = np.concatenate([np.arange(10.0), np.arange(30.0, 40.0)])
    broken_s, values = break_at_gaps(time_s, np.ones((20, 3)))
    assert broken_s.shape == (21,)
    assert np.flatnonzero(np.isnan(values[:, 0])).tolist() == [10]


def paused(times: np.ndarray) -> Health:
    """Return what two flights show, ten minutes apart."""
    rng, intervals = np.random.default_rng(0), ((10.0, 70.0), (670.0, 730.0))
    spread = np.linspace(0.2, 0.6, times.size)[:, None] + 0.01 * rng.standard_normal((times.size, 4))
    level = 3.0 + rng.random((times.size, 1))
    volts = 16.0 - 0.001 * times[:, None] + 0.05 * rng.standard_normal((times.size, 1))
    noise = find_noise(
        [series("body_rate", times, rng.standard_normal((times.size, 3)))], None, None, None, intervals, {}
    )
    return Health(
        noise=noise,
        motors=find_motors(series("motor_thrust", times, spread), None, intervals),
        vibration=find_vibration(
            {"vibration_level": series("vibration_level", times, level)}, (), intervals, {}
        ),
        battery=find_battery(series("battery_voltage", times, volts), None, intervals),
    )


@pytest.mark.parametrize("key", ["motors", "vibration", "battery", "spectrogram"])
def test_between_two_flights_nothing_is_drawn(key: str, usable: Result) -> None:
    """Lines crossed ten minutes on the ground, and the spectrum of a window filled half of them."""
    times = np.concatenate([np.arange(10.0, 70.0, 0.02), np.arange(670.0, 730.0, 0.02)])
    drawn = {one.key: one for one in health_figures(replace(usable, health=paused(times)))}[key]
    assert isinstance(drawn, Figure)
    panel = next(one for one in drawn.panels if one.x.unit == "s")
    lines = [(curve.x, curve.y[None, :]) for curve in panel.curves]
    lines += [] if panel.heat is None else [(panel.heat.x, panel.heat.z)]
    assert lines
    for x, values in lines:
        known = np.isfinite(values).any(axis=0)
        # Every line and cell ends where its flight does.
        across = [
            (first, last)
            for first, last, both in zip(x[:-1], x[1:], known[:-1] & known[1:], strict=True)
            if both and first < 370.0 < last
        ]
        assert across == []
        assert not known[(x > 75.0) & (x < 665.0)].any()


@pytest.mark.thorough
@given(
    values=hnp.arrays(np.float64, st.integers(0, 3000), elements=st.floats(-1e6, 1e6) | st.just(np.nan)),
    buckets=st.integers(1, 200),
)
def test_thinning_keeps_the_peaks_and_the_order(values: np.ndarray, buckets: int) -> None:
    """Highest and lowest value survive, time rises, and there are few points."""
    x, y = thin_line(np.arange(float(values.size)), values, buckets)
    assert (np.diff(x) > 0.0).all()
    assert x.size <= 4 * buckets + 4
    if np.isfinite(values).any():
        assert np.nanmax(y) == np.nanmax(values)
        assert np.nanmin(y) == np.nanmin(values)
    assert np.array_equal(y, values[x.astype(int)], equal_nan=True)
    for start, end in zip(x[:-1].astype(int), x[1:].astype(int), strict=True):
        if np.isfinite(values[start]) and np.isfinite(values[end]):
            assert not np.isnan(values[start:end]).any(), "a gap was bridged"


def test_thinning_keeps_a_gap() -> None:
    """One missing sample among a million is still a break in the line."""
    values = np.sin(np.arange(1e6))
    values[123_456] = np.nan
    assert np.isnan(thin_line(np.arange(1e6), values)[1]).any()


def test_a_thinned_scatter_covers_the_same_area() -> None:
    """No region of the cloud is emptied."""
    points = np.random.default_rng(0).standard_normal((2, 100_000))
    x, y = thin_points(points[0], points[1])
    assert x.size < 7000
    assert x.min() == pytest.approx(points[0].min(), abs=0.1)
    assert y.max() == pytest.approx(points[1].max(), abs=0.2)


@pytest.mark.thorough
def test_windows_that_could_not_be_solved_do_not_stop_the_figures(usable: Result, tmp_path: Path) -> None:
    """Infinite condition numbers and NaN coefficients are left out of the picture."""
    model = usable.identification.models[1]
    assert model.windows is not None
    broken = replace(
        model,
        windows=replace(
            model.windows,
            condition_number=np.full_like(model.windows.condition_number, np.inf),
            coefficients=np.full_like(model.windows.coefficients, np.nan),
            singular_values=np.zeros_like(model.windows.singular_values),
        ),
    )
    result = replace(usable, identification=replace(usable.identification, models=(broken,)))
    figures = {figure.key: figure for figure in figures_of(result).shown}
    for key in ("condition-quadrotor-6", "over-time", "singular"):
        write_png(figures[key], tmp_path / "figure.png")
    figure = figures["condition-quadrotor-6"]
    assert all(curve.mark != "points" for panel in figure.panels for curve in panel.curves)


#: Series, bands, a complex plane, bars, and a map.
DRAWN = ("flight", "condition-linear-9", "loop-nyquist", "structures", "spectrogram")


@pytest.mark.parametrize("keys", [DRAWN, thorough(FIGURE_KEYS)], ids=["some", "all"])
def test_the_png_of_every_figure_is_a_picture(keys: tuple[str, ...], usable: Result, tmp_path: Path) -> None:
    """Every file is a PNG with content: more than one colour over more than an empty frame."""
    from PIL import Image

    for figure in (each for each in figures_of(usable).shown if each.key in keys):
        path = tmp_path / f"{figure.key}.png"
        write_png(figure, path)
        with Image.open(path) as image:
            assert image.width >= 1200, figure.key
            # A ninth of the pixels is enough, and counted in a ninth of the time.
            part = image.convert("RGB").resize(
                (image.width // 3, image.height // 3), Image.Resampling.NEAREST
            )
            colours = part.getcolors(maxcolors=1 << 24) or []
            assert len(colours) > 50, figure.key


def test_powers_of_ten_are_written_as_such(usable: Result) -> None:
    """A logarithmic axis has its decades labelled, the same on paper and in the browser; nothing is TeX."""
    figure = next(item for item in figures_of(usable).shown if item.key == "condition-linear-9")
    name = "x" if figure.panels[0].x.log else "y"
    paper = [text.get_text() for text in getattr(draw(figure).axes[0], f"get_{name}ticklabels")()]
    assert paper == interactive(figure)["layouts"]["wide"][f"{name}axis"]["ticktext"]
    assert [tick.text for tick in log_ticks(1e-3, 1e12)] == ["10⁻³", "10⁰", "10³", "10⁶", "10⁹", "10¹²"]


@pytest.mark.thorough
def test_a_hostile_mode_name_is_drawn_as_text(tmp_path: Path) -> None:
    """TeX, control characters and unknown letters neither raise nor warn."""
    result = hostile_result()
    overview = shown(result, "flight")
    assert any("script" in band.label for band in overview.panels[0].bands)
    write_png(overview, tmp_path / "flight.png")
    assert (tmp_path / "flight.png").stat().st_size > 10_000


def test_the_browser_gets_the_same_points_as_the_paper(usable: Result) -> None:
    """Every curve of the figure arrives unchanged but for the rounding to single precision."""
    figure = next(item for item in figures_of(usable).shown if item.key == "lag")
    content = interactive(figure)
    curves = [curve for panel in figure.panels for curve in panel.curves]
    for curve, trace in zip(curves, content["data"], strict=False):
        values = np.frombuffer(base64.b64decode(trace["y"]["bdata"]), dtype="<f4")
        np.testing.assert_allclose(values, curve.y, rtol=1e-6)


def test_the_browser_s_content_is_strict_json(usable: Result) -> None:
    """No NaN and no infinity outside the typed arrays."""
    for figure in figures_of(usable).shown:
        json.dumps(interactive(figure), allow_nan=False)


def test_time_late_on_the_clock_keeps_its_resolution(usable: Result) -> None:
    """With an uptime of weeks, neighbouring samples still have different times."""
    figure = shown(usable, "aligned")
    late = replace(figure.panels[0].curves[0], x=figure.panels[0].curves[0].x + 3e6)
    panel = replace(figure.panels[0], curves=(late,))
    content = interactive(replace(figure, panels=(panel,), columns=1))
    assert content["data"][0]["x"]["dtype"] == "f8"


def test_the_model_s_frequency_response_is_the_transfer_function_of_its_numbers(usable: Result) -> None:
    """B / (s - A) behind first-order lag, delay and a second-order Butterworth, written out for roll."""
    model = usable.identification.models[0]
    assert model.actuator is not None
    a, b = np.zeros_like(model.A), np.diag([400.0, 300.0, 50.0])
    a[0, model.regressors.index("p")] = -2.0
    model = replace(model, A=a, B=b, actuator=replace(model.actuator, lag_s=0.03, delay_s=0.005))
    frequency_hz = np.array([0.3, 2.0, 12.0])
    s = 2j * np.pi * frequency_hz
    w = 2.0 * np.pi * 40.0
    gyro = w**2 / (s**2 + np.sqrt(2.0) * w * s + w**2)
    expected = 400.0 / (s + 2.0) / (1.0 + 0.03 * s) * np.exp(-0.005 * s) * gyro
    np.testing.assert_allclose(
        model_response(model, frequency_hz, GyroFilter(40.0))[:, 0], expected, rtol=1e-12
    )
    np.testing.assert_allclose(
        model_response(model, frequency_hz, NO_GYRO_FILTER)[:, 1],
        300.0 / s / (1.0 + 0.03 * s) * np.exp(-0.005 * s),
        rtol=1e-12,
    )


@lru_cache(maxsize=1)
def _simulated() -> Result:
    """Return what is found in a simulated flight of 25 s."""
    from quadid_logs.align import cut
    from quadid_logs.diagnose import diagnose
    from quadid_logs.identify import identify
    from quadid_logs.load import prepare
    from quadid_logs.simulator import simulate

    settings = Settings()
    log = simulate("sysid-quad-x", seed=2, duration_s=25.0, rate_hz=200.0).log
    data = cut(prepare(log), settings.align)
    found = identify(data, settings.identify)
    return Result(
        log=log,
        data=data,
        identification=found,
        diagnosis=diagnose(log, data, found),
        settings=settings,
    )


@pytest.mark.thorough
def test_the_frequency_response_of_a_simulated_flight_lies_on_the_model() -> None:
    """Where the multisine moves roll, 1 to 5 Hz, gain within 3 % and phase within 3 degrees."""
    figure = frequency_response(_simulated())
    assert isinstance(figure, Figure)
    for panel, relative in ((figure.panels[0], True), (figure.panels[3], False)):
        points, line, *_ = panel.curves
        band = (points.x > 1.0) & (points.x < 5.0)
        expected = np.interp(points.x[band], line.x, line.y)
        assert np.count_nonzero(band) > 10
        error = np.median(np.abs(points.y[band] - expected) / (np.abs(expected) if relative else 1.0))
        assert error < (0.03 if relative else 3.0)


@pytest.mark.thorough
def test_the_third_octaves_of_the_response_lie_on_the_model_where_the_vehicle_moved() -> None:
    """Those that the band is chosen from, behind the gyro's filter as the logged rates are."""
    figure = frequency_response(_simulated())
    assert isinstance(figure, Figure)
    _, line, third_octaves = figure.panels[0].curves
    band = (third_octaves.x > 1.0) & (third_octaves.x < 4.0)
    assert np.count_nonzero(band) >= 5
    np.testing.assert_allclose(
        third_octaves.y[band], np.interp(third_octaves.x[band], line.x, line.y), rtol=0.05
    )
    assert third_octaves.low is not None
    assert (third_octaves.low < third_octaves.y).all()


@pytest.mark.thorough
def test_the_response_shades_the_band_that_was_fitted_and_says_who_chose_it() -> None:
    """0.3 to 5 Hz here, by default."""
    result = _simulated()
    figure = frequency_response(result)
    assert isinstance(figure, Figure)
    assert {(band.start, band.end) for panel in figure.panels for band in panel.bands} == {(0.3, 5.0)}
    assert "the fitted band, 0.3 to 5 Hz" in figure.caption
    by_hand = replace(result.settings, identify=in_band((0.3, 5.0), result.settings.identify))
    figure = frequency_response(replace(result, settings=by_hand))
    assert isinstance(figure, Figure)
    assert "the fitted band that was set by hand" in figure.caption


def test_a_heading_that_passes_south_draws_no_line_across(usable: Result) -> None:
    """From 180 to -180 degrees is no turn."""
    overview = usable.data.overview["attitude"]
    turned = overview.values.copy()
    turned[:, 2] = np.linspace(3.0, 9.0, turned.shape[0])
    turned[:, 2] = np.arctan2(np.sin(turned[:, 2]), np.cos(turned[:, 2]))
    data = replace(
        usable.data, overview={**usable.data.overview, "attitude": replace(overview, stored=turned)}
    )
    figure = flight_overview(replace(usable, data=data))
    assert isinstance(figure, Figure)
    yaw = next(curve for panel in figure.panels for curve in panel.curves if curve.label == "yaw angle")
    steps = np.abs(np.diff(yaw.y))
    assert np.nanmin(yaw.y) < -150.0
    assert np.nanmax(yaw.y) > 150.0
    assert np.nanmax(steps) < 180.0


def test_what_was_commanded_lies_over_what_was_flown(usable: Result) -> None:
    """The thin line on the wide one, by axis, in degrees."""
    for column, panel in enumerate(shown(usable, "tracking").panels):
        actual, desired = panel.curves
        assert (actual.mark, desired.mark) == ("wide", "line")
        commanded = np.degrees(usable.data.overview["body_rate_setpoint"].values[:, column])
        assert np.nanmax(desired.y) == pytest.approx(commanded.max())


def _gyro_panel(result: Result, gyro_filter: GyroFilter) -> Panel:
    data = replace(result.data, gyro_filter=gyro_filter)
    return shown(replace(result, data=data), "gyro-spectrum").panels[0]


def test_the_gyro_s_noise_before_its_filter_is_what_the_filter_took(usable: Result) -> None:
    """As a Butterworth takes it: 1 / (1 + (f / fc)^4); beyond a tenth of its gain, nothing is said."""
    before, after = _gyro_panel(usable, GyroFilter(40.0)).curves
    place = int(np.argmin(np.abs(before.x - 35.0)))
    took = after.y[place] / before.y[place]
    assert took == pytest.approx(1.0 / (1.0 + (before.x[place] / 40.0) ** 4), rel=1e-6)
    assert before.x.max() < 40.0 * 10.0**0.5 < after.x.max()


def test_the_model_s_yaw_has_the_reaction_of_its_rotors(usable: Result) -> None:
    """B + s b: without it the line fell where the log's response rose, on an axis that is usable."""
    model = usable.identification.models[0]
    a = np.column_stack([np.zeros_like(model.A), [0.0, 0.0, 3.0]])
    regressors = (*model.regressors, "N_dot")
    model = replace(model, A=a, B=np.diag([400.0, 300.0, 50.0]), regressors=regressors, actuator=None)
    frequency_hz = np.array([0.5, 5.0])
    s = 2j * np.pi * frequency_hz
    found = model_response(model, frequency_hz, NO_GYRO_FILTER)
    np.testing.assert_allclose(found[:, 2], (50.0 + 3.0 * s) / s, rtol=1e-12)
    np.testing.assert_allclose(found[:, 0], 400.0 / s, rtol=1e-12)


def test_of_two_lines_near_to_each_other_the_higher_one_is_labelled(usable: Result) -> None:
    """Side by side their labels cover each other; one a decade away has its own."""
    health = usable.health
    assert health is not None
    assert health.noise is not None
    (line,) = health.noise.lines["roll"][:1]
    near = replace(line, frequency_hz=1.3 * line.frequency_hz, height_db=line.height_db - 3.0)
    far = replace(line, frequency_hz=line.frequency_hz / 10.0, height_db=line.height_db - 3.0)
    for other, labels in ((near, {"85 Hz", ""}), (far, {"85 Hz", "8.5 Hz"})):
        noise = replace(health.noise, lines={"roll": (line, other)})
        panel = _gyro_panel(replace(usable, health=replace(health, noise=noise)), GyroFilter(40.0))
        assert {level.label for level in panel.levels} == labels


def test_the_notches_of_the_gyro_are_marked_in_its_spectrum(usable: Result) -> None:
    levels = _gyro_panel(usable, GyroFilter(notches=(Notch(90.0, 0.5, 0.2),))).levels
    notches = [(level.value, level.along) for level in levels if level.label == "notch"]
    assert notches == [(90.0, "x")]
    # The line that the flight shows is marked with its frequency.
    assert [level.label for level in levels if level.value == 85.0] == ["85 Hz"]


def test_the_band_of_the_prediction_holds_nineteen_of_twenty_held_out_errors(usable: Result) -> None:
    """Of all held-out samples, not of those that are shown."""
    panel = shown(usable, "evidence").panels[0]
    (ribbon,) = panel.ribbons
    width = float(np.nanmax(ribbon.high - ribbon.low)) / 2.0
    fit = usable.identification.models[0].fit
    assert fit is not None
    assert 0.0 < width < 3.0 * float(np.degrees(np.nanstd(fit.rate[:, 0])))


def test_a_caption_says_why_a_line_leaves_its_chart(usable: Result) -> None:
    """Ten times the measured rate leaves its scale; a prediction that fits needs no such words."""
    model, *others = usable.identification.models
    assert model.fit is not None
    away = replace(model.fit, simulated_rate=10.0 * model.fit.rate)
    identification = replace(usable.identification, models=(replace(model, fit=away), *others))
    leaves = {
        name: "leaves the chart" in shown(each, "evidence").caption
        for name, each in {"fits": usable, "away": replace(usable, identification=identification)}.items()
    }
    assert leaves == {"fits": False, "away": True}


def test_a_refused_axis_has_no_band_of_errors(usable: Result) -> None:
    verdict = replace(usable.diagnosis.axes["pitch"], verdict="refused")
    diagnosis = replace(usable.diagnosis, axes={**usable.diagnosis.axes, "pitch": verdict})
    roll, pitch, _yaw = shown(replace(usable, diagnosis=diagnosis), "evidence").panels
    assert pitch.title == "Pitch: refused"
    assert pitch.ribbons == ()
    assert roll.ribbons != ()


def test_gyro_and_attitude_are_shown_against_each_other(usable: Result) -> None:
    """One panel an angle, with the line on which they agree, and the lag in words."""
    figure = next(item for item in figures_of(usable).shown if item.key == "gyro")
    assert [panel.title for panel in figure.panels] == ["Roll angle", "Pitch angle", "Yaw angle"]
    for panel in figure.panels:
        line, points = panel.curves
        np.testing.assert_array_equal(line.x, line.y)
        np.testing.assert_allclose(points.x, 1.004 * points.y)
    assert "The rates come 11.00 ± 0.40 ms after the attitude" in figure.caption


def test_the_frequency_response_of_a_long_flight_is_that_of_the_minutes_that_were_fitted() -> None:
    """The log's points come from the same part as the model's line, and the caption says so."""
    from quadid_logs.data.settings import IdentifySettings
    from quadid_logs.identify.select import most_excited

    whole = usable_result()
    settings = Settings(identify=IdentifySettings(most_samples=whole.data.n_samples // 2))
    data = replace(whole.data, segments=tuple(_halves(whole.data.segments)))
    chosen = most_excited(data, settings.identify.most_samples)
    assert chosen.n_samples < whole.data.n_samples
    long = frequency_response(replace(whole, data=data, settings=settings))
    fitted = frequency_response(replace(whole, data=chosen))
    assert isinstance(long, Figure)
    assert isinstance(fitted, Figure)
    assert "minutes that the model was fitted to" in long.caption
    assert "minutes" not in fitted.caption
    for one, other in zip(long.panels, fitted.panels, strict=True):
        np.testing.assert_array_equal(one.curves[0].y, other.curves[0].y)


def _halves(segments: tuple[Segment, ...]) -> Iterator[Segment]:
    for segment in segments:
        middle = segment.n_samples // 2
        yield from (segment.rows(slice(0, middle)), segment.rows(slice(middle, None)))


def test_the_predicted_torque_of_a_calibrated_log_is_shown_as_the_command_that_it_is() -> None:
    """The loop is closed per unit of command: newton metres would be wrong by a factor."""
    result = usable_result()
    assert result.data.input is not None
    calibrated = replace(result.data.input, kind="torque_n_m", unit="N m")
    result = replace(result, data=replace(result.data, input=calibrated))
    figure = loop_figures(result)[0]
    assert isinstance(figure, Figure)
    torques = [panel.y for panel in figure.panels if panel.title.endswith("torque")]
    assert torques
    assert {axis.unit for axis in torques} == {"normalised"}


def test_the_open_loop_is_drawn_in_the_units_of_its_margins(usable: Result) -> None:
    """In decibels: the gain where the phase passes -180 degrees lies below zero by the gain margin."""
    figure = shown(usable, "loop-bode")
    assert usable.closed_loop is not None
    margin = usable.closed_loop.margins["roll"].full
    assert margin is not None
    assert margin.gain_margin_db is not None
    gain, phase = (
        next(panel for panel in figure.panels if panel.title == f"Roll: {what}") for what in ("gain", "phase")
    )
    assert gain.y.unit == "dB"
    assert not gain.y.log
    (decibels,), (degrees,) = (
        [curve.y for curve in panel.curves if curve.label == "model"] for panel in (gain, phase)
    )
    crossing = np.flatnonzero((degrees[:-1] > -180.0) & (degrees[1:] <= -180.0))[0]
    assert -decibels[crossing] == pytest.approx(margin.gain_margin_db.value, abs=0.5)


def test_a_zoom_over_frequency_moves_every_chart_that_shows_the_same_frequencies(usable: Result) -> None:
    """Gain and phase of one loop; a chart over anything else stays."""
    figure = shown(usable, "loop-bode")
    for layout in interactive(figure)["layouts"].values():
        axes = [layout[name] for name in layout if name.startswith("xaxis")]
        assert len(axes) == len(figure.panels)
        assert "matches" not in axes[0]
        assert {axis["matches"] for axis in axes[1:]} == {"x"}
    plane = interactive(shown(usable, "loop-nyquist"))["layouts"]["wide"]
    assert not any("matches" in plane[name] for name in plane if name.startswith("xaxis"))
