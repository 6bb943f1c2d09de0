"""Results made by hand for the tests of figures, report and command line: no log, no estimator."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from quadid_logs.control.closed_loop import close_loop
from quadid_logs.data.closed_loop import ClosedLoop
from quadid_logs.data.controller import AxisController, DiscreteFilter, FlownControllers, Replay
from quadid_logs.data.diagnosis import AxisVerdict, Diagnosis, Finding
from quadid_logs.data.flight import FlightData, GyroCheck, InputDescription, Overview, Segment, SourceChoice
from quadid_logs.data.health import (
    AxisCommandNoise,
    AxisOscillation,
    AxisSteps,
    AxisTracking,
    Battery,
    CommandNoise,
    Course,
    GyroSpectrum,
    Health,
    Line,
    Map,
    Motors,
    Noise,
    Oscillation,
    Quantity,
    StepCurve,
    Steps,
    Tracking,
    Vibration,
)
from quadid_logs.data.log import FlightLog, LogText, LostBytes, MessageCount, ModeChange
from quadid_logs.data.model import (
    Actuator,
    BandCheck,
    ChangeCheck,
    Discrete,
    Excitation,
    FitSeries,
    Identification,
    Inertia,
    Model,
    Parameter,
    Posterior,
    Validation,
    Windows,
)
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.data.torque import MixerCheck, TorqueModel
from quadid_logs.planning import Prediction
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, RATE_SYMBOLS, TORQUE_SYMBOLS

RATE_HZ = 400.0
TRUE_B = np.diag([440.0, 395.0, 61.0])
HOSTILE = (
    "<script>alert(1)</script><img src=x onerror=alert(2)>"
    "\x1b[31m\x00\u202e$\\frac$ {{7*7}} \u2028 & 'q' \"d\""
)


def usable_result(duration_s: float = 80.0, path: str = "flight.bin") -> Result:
    """Return a good flight: 80 s at 400 Hz, three structures, one caution on yaw."""
    made = _usable_result(duration_s)
    return replace(made, log=replace(made.log, path=path))


def synthetic_prediction() -> Prediction:
    """Return what a planned flight might give, without flying it, for tests of what stands around it."""
    made = usable_result(8.0)
    return Prediction(vehicle="a quadrotor", identification=made.identification, diagnosis=made.diagnosis)


@cache
def _usable_result(duration_s: float) -> Result:
    """Make a flight of each length once: its loop is closed around hundreds of vehicles, which takes long."""
    generator = np.random.default_rng(0)
    segments = _segments(generator, duration_s)
    model = _model("damped", segments, generator, recommended=True)
    data = _data(segments, duration_s)
    return Result(
        log=_log("flight.bin"),
        data=data,
        closed_loop=_closed_loop(data, model),
        identification=Identification(
            models=(
                model,
                _model("quadrotor-6", segments, generator, recommended=False),
                _model("linear-9", segments, generator, recommended=False),
            ),
            excitation=tuple(_excitation(axis, generator) for axis in AXES),
        ),
        diagnosis=_diagnosis(),
        settings=Settings(),
        health=synthetic_health(),
        timings_s={"read": 0.1, "align": 0.05, "identify": 0.9, "total": 1.05},
    )


def synthetic_health(sentence: str = "All is well.") -> Health:
    """Return every topic that a log can tell of, each with that sentence."""
    frequency_hz = np.arange(0.25, 200.0, 0.25)
    falling = 1e-4 / (1.0 + (frequency_hz / 4.0) ** 2)
    time_s = np.linspace(1.0, 50.0, 100)
    number = Quantity(0.02, "s", (0.018, 0.022))
    followed = AxisTracking(error_rms=Quantity(0.1, "rad/s"), setpoint_rms=Quantity(0.4, "rad/s"), lag=number)
    response = 1.0 - np.exp(-np.linspace(0.0, 10.0, 200))
    step = AxisSteps(
        time_s=np.linspace(-0.05, 0.5, 200),
        ideal=response,
        curves=(
            StepCurve(
                size="small", n_windows=20, response=response, low=response - 0.05, high=response + 0.05
            ),
            StepCurve(size="large", n_windows=12, response=response, low=response - 0.1, high=response + 0.1),
        ),
        split_rad_s=0.5,
        overshoot=Quantity(0.1, "1", (0.05, 0.15)),
        half_time=number,
    )
    line = Line(frequency_hz=85.0, height_db=12.0, p_value=1e-9, share=0.9, rms=0.01)
    spectrum = GyroSpectrum(
        source="RATE.R P Y", rate_hz=400.0, frequency_hz=frequency_hz, density=np.tile(falling[:, None], 3)
    )
    level_db = np.outer(np.linspace(0.0, -40.0, 60), np.ones(20))
    level_db[:, 3] = np.nan
    by_throttle = Map(
        x=np.linspace(0.3, 0.6, 20), frequency_hz=np.linspace(1.0, 199.0, 60), level_db=level_db
    )
    return Health(
        tracking=Tracking(sentence=sentence, axes=dict.fromkeys(AXES, followed)),
        **{
            name: Course(
                sentence=sentence,
                label=name,
                unit="deg",
                columns=("one",),
                figures={"one": number},
                limits=((0.5, "half"),),
                time_s=time_s,
                values=np.full((100, 1), 0.4),
            )
            for name in ("rates", "tilt", "torque", "throttle", "thrust")
        },
        attitude=Tracking(sentence=sentence, axes=dict.fromkeys(AXES, followed)),
        steps=Steps(sentence=sentence, axes=dict.fromkeys(AXES, step)),
        noise=Noise(
            sentence=sentence,
            after=spectrum,
            before=None,
            lines={"roll": (line,), "pitch": (), "yaw": ()},
            over_time=replace(by_throttle, x=np.linspace(1.0, 50.0, 20), level_db=np.nan_to_num(level_db)),
            over_throttle=by_throttle,
            rotor_hz=np.linspace(80.0, 90.0, 20),
            may_be_folded=False,
        ),
        command_noise=CommandNoise(
            sentence=sentence,
            axes=dict.fromkeys(
                AXES,
                AxisCommandNoise(
                    rms=Quantity(0.02, "1", normal=(0.0, 0.05)),
                    terms={"P": Quantity(0.005, "1"), "D": Quantity(0.019, "1")},
                    density=falling,
                    term_densities={"P": 0.1 * falling, "D": 0.9 * falling},
                ),
            ),
            above_hz=40.0,
            frequency_hz=frequency_hz,
        ),
        motors=Motors(
            sentence=sentence,
            level="high",
            names=tuple(f"motor {n + 1}" for n in range(4)),
            unit="1",
            mean=np.full(4, 0.5),
            low=np.full(4, 0.4),
            high=np.full(4, 0.6),
            spread=Quantity(0.09, "1", normal=(0.0, 0.075)),
            hardest=2,
            headroom=Quantity(0.3, "1"),
            at_high=Quantity(0.0, "1"),
            at_low=Quantity(0.0, "1"),
            time_s=time_s,
            output=np.full((100, 4), 0.5),
        ),
        vibration=Vibration(
            sentence=sentence,
            level="normal",
            measure="vibration",
            columns=("x", "y", "z"),
            figure=Quantity(12.0, "m/s^2", normal=(0.0, 30.0)),
            limits=(30.0, 60.0),
            clips=Quantity(0.0, "1", normal=(0.0, 100.0)),
            time_s=time_s,
            values=np.full((100, 3), 10.0),
        ),
        battery=Battery(
            sentence=sentence,
            level="severe",
            start_v=Quantity(16.4, "V"),
            lowest_v=Quantity(13.0, "V", normal=(14.0, 17.4)),
            n_cells=4,
            sag_v=Quantity(0.3, "V", (0.28, 0.32)),
            time_s=time_s,
            voltage=np.linspace(16.4, 13.0, 100),
        ),
        oscillation=Oscillation(
            sentence=sentence,
            level="high",
            axes=(AxisOscillation(axis="roll", line=line),),
            highest_hz=40.0,
            may_be_folded=False,
        ),
    )


def refused_result(path: str = "bench.bin") -> Result:
    """Return a log that never flew: no segment, no model, several findings."""
    usable = usable_result(8.0, path)
    findings = (
        Finding(
            code="QL001",
            level="error",
            title="No flight in this log",
            evidence={"armed_s": 0.0, "longest_motor_run_s": float("nan")},
            advice="Log a flight; set LOG_DISARMED = 0 to keep bench logs apart.",
        ),
        Finding(
            code="QL102",
            level="warning",
            title="The torque is logged too slowly",
            evidence={"rate_hz": 10.0, "needed_hz": 40.0},
            advice="Set bit 0 of LOG_BITMASK (ATTITUDE_FAST).",
        ),
    )
    verdict = AxisVerdict(verdict="refused", reasons=("QL001",), sentence="Refused: the vehicle never flew.")
    return Result(
        log=replace(usable.log, torque=None),
        data=FlightData(
            sample_period_s=float("nan"),
            segments=(),
            flights=(),
            sources=usable.data.sources,
            input=None,
            start_s=0.0,
            duration_s=52.0,
            on_ground_reason="The motors were never armed.",
        ),
        identification=Identification(skipped="There is no flight to identify from."),
        diagnosis=Diagnosis(findings=findings, axes=dict.fromkeys(AXES, verdict)),
        settings=Settings(),
        timings_s={"read": 0.02, "align": 0.01, "identify": 0.0, "total": 0.03},
    )


def hostile_result(path: str = "hostile.bin") -> Result:
    """Return a result in which every text that a log can set is an attack."""
    usable = replace(usable_result(8.0, path), health=synthetic_health(HOSTILE))
    source = next(iter(usable.data.sources.values()))
    bad_source = replace(source, source=HOSTILE, reason=HOSTILE, others=((HOSTILE, 10.0),))
    log = replace(
        usable.log,
        firmware=HOSTILE,
        frame=HOSTILE,
        vehicle_name=HOSTILE,
        hardware_id=HOSTILE,
        vehicle_type=HOSTILE,
        dialect=HOSTILE,
        parameters={HOSTILE: 1.0},
        modes=(ModeChange(time_s=0.0, position=0, name=HOSTILE),),
        texts=(LogText(time_s=0.0, position=0, text=HOSTILE),),
        lost=(LostBytes(offset=1, n_bytes=2, reason=HOSTILE),),
        counts=(MessageCount(name=HOSTILE, count=3),),
        remarks=(HOSTILE,),
    )
    data = replace(
        usable.data,
        sources={"body_rate": bad_source, HOSTILE: bad_source},
        input=InputDescription(kind="torque_command", unit="1", source=HOSTILE),
        modes=log.modes,
        texts=log.texts,
    )
    finding = Finding(
        code="QL999",
        level="error",
        title=HOSTILE,
        evidence={HOSTILE: HOSTILE, "list": [HOSTILE]},
        advice=HOSTILE,
    )
    axes = {
        axis: AxisVerdict(verdict="caution", reasons=("QL999",), sentence=HOSTILE)
        for axis in usable.diagnosis.axes
    }
    return replace(usable, log=log, data=data, diagnosis=Diagnosis(findings=(finding,), axes=axes))


def _log(path: str) -> FlightLog:
    return FlightLog(
        path=path,
        format="dataflash",
        autopilot="ardupilot",
        n_bytes=38_000_000,
        signals={},
        firmware="ArduCopter V4.7.0-dev (a1b2c3d4)",
        vehicle_type="multirotor",
        frame="quad X",
        modes=(
            ModeChange(time_s=20.0, position=1, name="STABILIZE"),
            ModeChange(time_s=40.0, position=2, name="LOITER"),
            ModeChange(time_s=70.0, position=3, name="ALT_HOLD"),
        ),
        texts=(LogText(time_s=20.0, position=0, text="Frame: QUAD/X"),),
        lost=(LostBytes(offset=123_456, n_bytes=512, reason="no message header"),),
        counts=(MessageCount(name="RATE", count=32_000, rate_hz=400.0),),
        remarks=("The first IMU was taken.",),
        torque=TorqueModel(
            frame="quad x",
            frame_source="FRAME_CLASS 1, FRAME_TYPE 1",
            position=np.array([[0.2, 0.2, 0.0], [-0.2, -0.2, 0.0], [0.2, -0.2, 0.0], [-0.2, 0.2, 0.0]]),
            position_unit="m",
            spin=np.array([1.0, 1.0, -1.0, -1.0]),
            channels=(1, 2, 3, 4),
            channel_source="SERVOn_FUNCTION",
            check=MixerCheck(
                n_samples=600,
                mean_us=0.001,
                std_us=0.04,
                largest_us=1.0,
                typical_us=0.03,
                density="BARO.AltAMSL",
            ),
            saturated_fraction=(0.0, 0.001, 0.05),
            needs=("mass_kg",),
        ),
    )


def _segments(generator: np.random.Generator, duration_s: float) -> tuple[Segment, ...]:
    n_samples = int(duration_s * RATE_HZ / 2)
    segments = []
    for number in range(2):
        time_s = 25.0 + number * (duration_s / 2 + 3.0) + np.arange(n_samples) / RATE_HZ
        frequency_hz = np.array([[0.7], [0.9], [0.4]]) * np.array([1.0, 2.3, 4.1])
        phase = generator.uniform(0.0, 2 * np.pi, (3, 3))
        angle = 2 * np.pi * frequency_hz[None] * time_s[:, None, None] + phase
        torque = 0.05 * np.sin(angle).sum(-1)
        rate = (-TRUE_B @ (0.05 * np.cos(angle) / (2 * np.pi * frequency_hz)).sum(-1).T).T * 0.2
        rate = rate + 0.02 * generator.standard_normal(rate.shape)
        segments.append(
            Segment(
                time_s=time_s,
                body_rate_rad_s=rate,
                torque=torque,
                attitude_rad=0.2 * np.sin(0.3 * time_s[:, None] + np.arange(3)),
                throttle=np.full(n_samples, 0.4),
                saturated=np.abs(torque[:, 2]) > 0.13,
                flight=0,
            )
        )
    return tuple(segments)


def _closed_loop(data: FlightData, model: Model) -> ClosedLoop:
    """Return loops around the model of a vehicle that is thought to follow its set-points a little late."""
    late = round(0.05 * RATE_HZ)
    segments = [
        replace(segment, reference=np.roll(segment.body_rate_rad_s, -late, axis=0))
        for segment in data.segments
    ]
    posterior = Posterior(
        mean=np.column_stack(
            [np.diag(model.B), np.full(3, -1.5), np.full(3, 0.03), np.full(3, 0.004), np.zeros(3)]
        ),
        covariance=np.tile(np.diag([3.0, 0.1, 1e-3, 1e-3, 0.0]) ** 2, (3, 1, 1)),
        lag_or_delay_s=0.0,
    )
    period_s = 1.0 / RATE_HZ
    integral = DiscreteFilter(np.array([0.05 + 0.03 * period_s, -0.05]), np.array([1.0, -1.0]), period_s)
    controller = AxisController(
        period_s=period_s,
        error=integral,
        target=DiscreteFilter(np.ones(1), np.ones(1), period_s),
        angle_gain_per_s=4.5,
        gains={"RATE_P": 0.05, "RATE_I": 0.03},
    )
    flown = FlownControllers(
        name="PI",
        firmware="ArduCopter V4.5.7 (2a3dc4b7)",
        version_read="nearest",
        version_note="4.7",
        axes=dict.fromkeys(AXES, controller),
    )
    replays = {axis: Replay(relative_rms={"P": 1e-5, "output": 2e-3}, agrees=True) for axis in AXES}
    with_setpoints = replace(data, segments=tuple(segments))
    return close_loop(with_setpoints, replace(model, posterior=posterior), flown, replays, low_hz=0.3)


def _data(segments: tuple[Segment, ...], duration_s: float) -> FlightData:
    time_s = np.concatenate([segment.time_s for segment in segments])
    columns = {
        "body_rate": np.concatenate([segment.body_rate_rad_s for segment in segments]),
        "attitude": np.concatenate(
            [segment.attitude_rad for segment in segments if segment.attitude_rad is not None]
        ),
        "torque_command": np.concatenate([segment.torque for segment in segments]),
        "body_rate_setpoint": 1.02 * np.concatenate([segment.body_rate_rad_s for segment in segments]),
    }
    choices = {
        "body_rate": ("RATE.R/P/Y", "full loop rate, filtered as the controller sees it", 400.0, 0.0049),
        "torque_command": ("RATE.ROut/POut/YOut", "the only torque in this log", 399.2, 0.0074),
        "attitude": ("ANG.Roll/Pitch/Yaw", "faster than ATT", 400.0, 0.005),
    }
    return FlightData(
        sample_period_s=1.0 / RATE_HZ,
        segments=segments,
        flights=((segments[0].start_s - 3.0, segments[-1].end_s + 1.0),),
        sources={
            signal: SourceChoice(
                signal=signal,
                source=source,
                reason=reason,
                n_samples=time_s.size,
                rate_hz=rate_hz,
                mean_rate_hz=rate_hz - 0.4,
                longest_gap_s=gap_s,
                others=(("IMU.GyrX/GyrY/GyrZ", 400.0),) if signal == "body_rate" else (),
            )
            for signal, (source, reason, rate_hz, gap_s) in choices.items()
        },
        input=InputDescription(
            kind="torque_command", unit="1", source="RATE.ROut/POut/YOut", saturated_fraction=0.02
        ),
        start_s=20.0,
        duration_s=duration_s + 15.0,
        overview={
            signal: Overview(signal=signal, columns=("x", "y", "z"), time_s=time_s, stored=values)
            for signal, values in {**columns, "attitude_setpoint": columns["attitude"]}.items()
        },
        gyro_check=_gyro_check(segments),
        modes=_log("x").modes,
        texts=_log("x").texts,
    )


def _gyro_check(segments: tuple[Segment, ...]) -> GyroCheck:
    change = np.concatenate([segment.body_rate_rad_s[:: int(RATE_HZ)] for segment in segments])
    return GyroCheck(
        length_s=1.0,
        start_s=np.concatenate([segment.time_s[:: int(RATE_HZ)] for segment in segments]),
        attitude_change=change,
        integrated_change=1.004 * change,
        matrix=np.diag([1.004, 0.998, 1.001]),
        half_width=np.full((3, 3), 0.003),
        explained=np.diag([0.999, 0.999, 0.99]),
        bias_rad_s=np.array([0.001, -0.002, 0.0]),
        lag_s=0.011,
        lag_half_width_s=0.0004,
    )


def _model(
    structure: str, segments: tuple[Segment, ...], generator: np.random.Generator, *, recommended: bool
) -> Model:
    regressors = {
        "damped": ("qr", "pr", "pq", "p", "q", "r", "1"),
        "quadrotor-6": ("qr", "pr", "pq"),
        "linear-9": ("p", "q", "r", "phi", "theta", "psi"),
    }[structure]
    A = 0.3 * generator.standard_normal((3, len(regressors)))
    B = TRUE_B + generator.standard_normal((3, 3))
    return Model(
        structure=structure,
        recommended=recommended,
        states=RATE_SYMBOLS,
        regressors=regressors,
        targets=ACCELERATION_SYMBOLS,
        inputs=TORQUE_SYMBOLS,
        A=A,
        B=B,
        parameters=_parameters(A, B, regressors),
        windows=_windows(segments, B, A, generator, wide=recommended),
        validation=Validation(
            held_out_s=24.0,
            r2_acceleration={"p_dot": 0.981, "q_dot": 0.975, "r_dot": 0.871},
            r2_simulated_rate={"p": 0.95, "q": 0.94, "r": 0.72},
            fit_percent={"p": 78.0, "q": 75.0, "r": 47.0},
            horizon_s=(0.1, 0.2, 0.5),
            horizon_rmse_rad_s={"p": (0.02, 0.05, 0.12), "q": (0.02, 0.04, 0.1), "r": (0.01, 0.03, 0.09)},
        ),
        actuator=_actuator() if recommended else None,
        inertia=_inertia() if recommended else None,
        discrete=_discrete(B) if recommended else None,
        fit=_fit(segments, generator) if recommended else None,
        smoothing_hz=12.0,
        condition_number=14.2,
        band=BandCheck(
            low_hz=np.array([0.3, 0.3, 0.3]),
            cutoff_hz=np.array([12.0, 6.0, 24.0]),
            on_axis_gain=np.diag(B) * np.array([[1.0], [0.99], [1.02]]),
        ),
        change=ChangeCheck(
            time_s=np.array([20.0, 31.0, 17.5]),
            before=1.01 * np.diag(B),
            after=0.98 * np.diag(B),
            statistic=np.array([2.0, 5.1, 3.3]),
        ),
    )


def _parameters(A: np.ndarray, B: np.ndarray, regressors: tuple[str, ...]) -> tuple[Parameter, ...]:
    parameters = []
    for matrix, letter, names, half in ((A, "A", regressors, 0.4), (B, "B", TORQUE_SYMBOLS, 6.0)):
        for row, target in enumerate(ACCELERATION_SYMBOLS):
            for column, regressor in enumerate(names):
                value = float(matrix[row, column])
                seen = abs(value) > half
                parameters.append(
                    Parameter(
                        name=f"{letter}{row + 1}{column + 1}",
                        target=target,
                        regressor=regressor,
                        value=value,
                        unit="rad/s^2",
                        ci95=(value - half, value + half),
                        identifiable=seen,
                        reason="" if seen else "its interval contains zero",
                    )
                )
    return tuple(parameters)


def _windows(
    segments: tuple[Segment, ...], B: np.ndarray, A: np.ndarray, generator: np.random.Generator, *, wide: bool
) -> Windows:
    time_s = np.concatenate([segment.time_s[:: 20 if wide else 1] for segment in segments])
    n_windows, n_unknowns = time_s.size, A.shape[1] + 3
    condition = 10.0 ** generator.normal(1.2 if wide else 4.0, 0.6, n_windows)
    spread = condition[:, None, None] * (0.5 if wide else 0.05)
    coefficients = np.hstack([A, B])[None] + spread * generator.standard_normal((n_windows, 3, n_unknowns))
    singular = np.sort(10.0 ** generator.normal(-1.0, 0.4, (n_windows, n_unknowns)), axis=1)[:, ::-1]
    condition[:3] = np.inf
    return Windows(
        time_s=time_s,
        coefficients=coefficients,
        condition_number=condition,
        rank=np.full(n_windows, n_unknowns),
        residual_rms=np.full((n_windows, 3), 0.4),
        singular_values=singular,
        noise_floor=np.full(n_windows, 0.01),
        used=singular[:, -1] > 0.01,
        weakest=np.eye(n_unknowns)[1],
        width=200 if wide else n_unknowns,
        stride=20 if wide else 1,
        period_s=1.0 / RATE_HZ,
    )


def _actuator() -> Actuator:
    lag_s, delay_s = np.linspace(0.0, 0.1, 21), np.linspace(0.0, 0.04, 11)
    loss = 0.02 + 30.0 * (lag_s[:, None] + delay_s[None] - 0.05) ** 2 + 4.0 * (lag_s[:, None] - 0.035) ** 2
    return Actuator(
        lag_s=0.035,
        lag_ci95_s=(0.031, 0.039),
        delay_s=0.0125,
        delay_ci95_s=(0.009, 0.015),
        acts_on="torque",
        lag_grid_s=lag_s,
        delay_grid_s=delay_s,
        loss=loss,
    )


def _inertia() -> Inertia:
    matrix = np.diag([0.0081, 0.0085, 0.0149])
    return Inertia(matrix=matrix, ci95_low=0.97 * matrix, ci95_high=1.03 * matrix)


def _discrete(B: np.ndarray) -> Discrete:
    return Discrete(sample_period_s=1.0 / RATE_HZ, states=RATE_SYMBOLS, A_d=np.eye(3), B_d=B / RATE_HZ)


def _fit(segments: tuple[Segment, ...], generator: np.random.Generator) -> FitSeries:
    gap = np.full((1, 3), np.nan)
    time_s = np.concatenate([part for item in segments for part in (item.time_s, [item.end_s + 1 / RATE_HZ])])
    acceleration = np.concatenate([part for item in segments for part in (item.torque @ TRUE_B.T, gap)])
    rate = np.concatenate([part for item in segments for part in (item.body_rate_rad_s, gap)])
    return FitSeries(
        time_s=time_s,
        acceleration=acceleration,
        modelled_acceleration=acceleration * 0.97 + 0.4 * generator.standard_normal(acceleration.shape),
        rate=rate,
        simulated_rate=rate + 0.05 * np.sin(time_s)[:, None],
        held_out=(time_s % 15.0) < 5.0,
    )


def _excitation(axis: str, generator: np.random.Generator) -> Excitation:
    frequency_hz = np.linspace(0.0, 100.0, 401)
    shape = 1.0 / (1.0 + (frequency_hz / 4.0) ** 4)
    return Excitation(
        axis=axis,
        torque_rms=0.06,
        rate_rms_rad_s=0.8,
        signal_to_noise=40.0,
        frequency_hz=frequency_hz,
        rate_psd=shape * generator.lognormal(0.0, 0.3, frequency_hz.size) + 1e-5,
        torque_psd=1e-3 * shape * generator.lognormal(0.0, 0.3, frequency_hz.size) + 1e-8,
        coherence=np.clip(shape * 0.98 + 0.02 * generator.standard_normal(frequency_hz.size), 0.0, 1.0),
    )


def _diagnosis() -> Diagnosis:
    finding = Finding(
        code="QL401",
        level="warning",
        title="The yaw torque was clipped",
        evidence={"fraction": 0.02, "where": [31.2, 58.9]},
        advice="Fly gentler yaw, or lower ATC_RAT_YAW_P.",
        axes=("yaw",),
    )
    note = Finding(
        code="QL110", level="info", title="512 bytes were lost", evidence={"bytes": 512}, advice=""
    )
    usable = AxisVerdict(verdict="usable", reasons=(), sentence="Usable: 98 % of the motion is explained.")
    caution = AxisVerdict(
        verdict="caution",
        reasons=("QL401",),
        sentence="With caution: the torque was clipped in 2 % of the flight.",
    )
    return Diagnosis(findings=(finding, note), axes={"roll": usable, "pitch": usable, "yaw": caution})


def write_placeholder_log(path: Path) -> Path:
    """Write a file to stand for the log, so that its hash can be computed."""
    path.write_bytes(b"\xa3\x95" * 1000)
    return path
