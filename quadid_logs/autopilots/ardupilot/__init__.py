"""ArduPilot: its messages, parameters and mixer, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from quadid_logs.autopilots import Autopilot, LogFormat
from quadid_logs.data.log import FlightLog
from quadid_logs.vocabulary import AXES

if TYPE_CHECKING:
    from quadid_logs.actuation.airframe import Airframe, Unknown
    from quadid_logs.actuation.motors import Rebuilt
    from quadid_logs.align.series import CleanLog
    from quadid_logs.autopilots.generic.advice import Advice
    from quadid_logs.data.controller import FlownControllers, ReplayInput
    from quadid_logs.data.health import Line
    from quadid_logs.data.off_nominal import ThrustLaw
    from quadid_logs.data.outer_loops import AttitudeRows, OuterControllers, ShaperRows
    from quadid_logs.data.tuning import FilterChoices, Tunable


class ArduPilot(Autopilot):
    """ArduPilot from 2.9 on."""

    name = "ardupilot"
    title = "ArduPilot"
    serial_parameters = ("BRD_SERIAL_NUM",)
    system_parameters = ("SYSID_THISMAV", "MAV_SYSID")

    def formats(self) -> tuple[LogFormat, ...]:
        """DataFlash as bytes and as text."""
        from quadid_logs.autopilots.ardupilot.log import read_binary, read_text
        from quadid_logs.containers import dataflash, dataflash_text

        text = "ArduPilot DataFlash as text"
        return (
            LogFormat("dataflash", "ArduPilot DataFlash", dataflash.is_mine, read_binary, (".bin",)),
            LogFormat("dataflash-text", text, dataflash_text.is_mine, read_text, (".log",), strict=False),
        )

    def find_airframe(self, log: FlightLog) -> Airframe | Unknown:
        """FRAME_CLASS and FRAME_TYPE; FRAME before 3.5."""
        from quadid_logs.autopilots.ardupilot.airframe import find_airframe

        return find_airframe(log)

    def rebuild(self, log: CleanLog, airframe: Airframe) -> Rebuilt:
        """Take RATE through the mixer, or RCOU backwards."""
        from quadid_logs.autopilots.ardupilot.torque import rebuild

        return rebuild(log, airframe)

    def loop_rate_hz(self, parameters: Mapping[str, float]) -> float:
        """SCHED_LOOP_RATE, or that of the fast rate thread."""
        from quadid_logs.autopilots.ardupilot.controller import loop_period_s

        if {"SCHED_LOOP_RATE", "FSTRATE_ENABLE"}.isdisjoint(parameters):
            return 0.0
        return 1.0 / loop_period_s(parameters)

    def angle_gains(self, mode: str, parameters: Mapping[str, float]) -> tuple[float, float, float] | None:
        """ATC_ANG_*_P, STB_*_P before 3.4; ACRO, too, follows an attitude that it turns by the sticks."""
        from quadid_logs.autopilots.ardupilot.controller import angle_gains

        return angle_gains(mode, parameters)

    def controllers(
        self,
        log: FlightLog,
        parameters: Mapping[str, float],
        *,
        period_s: float | None = None,  # noqa: ARG002
        axes: Sequence[str] = AXES,
    ) -> FlownControllers:
        """AC_PID and the angle loop of ATC_*."""
        from quadid_logs.autopilots.ardupilot.controller import controllers

        return controllers(log, parameters, axes)

    def replay_inputs(
        self, log: FlightLog, controllers: FlownControllers, intervals: Sequence[tuple[float, float]]
    ) -> Mapping[str, ReplayInput]:
        """Rows of RATE, with PIDR, PIDP and PIDY beside them."""
        from quadid_logs.autopilots.ardupilot.replay import replay_inputs

        return replay_inputs(log, controllers, intervals)

    def outer_controllers(self, parameters: Mapping[str, float]) -> OuterControllers:
        """ATC_INPUT_TC, ATC_RATE_FF_ENAB, PSC_*."""
        from quadid_logs.autopilots.ardupilot.outer import outer_controllers

        return outer_controllers(parameters)

    def attitude_rows(
        self, log: FlightLog, parameters: Mapping[str, float], intervals: Sequence[tuple[float, float]]
    ) -> AttitudeRows | None:
        """ANG or ATT, with RATE beside it."""
        from quadid_logs.autopilots.ardupilot.outer import attitude_rows

        return attitude_rows(log, parameters, intervals)

    def shaper_rows(
        self, log: FlightLog, parameters: Mapping[str, float], intervals: Sequence[tuple[float, float]]
    ) -> ShaperRows | None:
        """Accelerations of PSCN and PSCE as lean angles, with ANG or ATT beside them."""
        from quadid_logs.autopilots.ardupilot.outer import shaper_rows

        return shaper_rows(log, parameters, intervals)

    def tunable(self, parameters: Mapping[str, float], version: tuple[int, ...] | None = None) -> Tunable:
        """ATC_RAT_* and ATC_ANG_*."""
        from quadid_logs.autopilots.ardupilot.gains import tunable

        return tunable(parameters, version)

    def thrust_law(self, log: FlightLog, parameters: Mapping[str, float]) -> ThrustLaw:  # noqa: ARG002
        """MOT_THST_EXPO, MOT_BAT_VOLT_*, and the density of the air."""
        from quadid_logs.autopilots.ardupilot.thrust_law import thrust_law

        return thrust_law(parameters)

    def filter_choices(
        self, log: FlightLog, parameters: Mapping[str, float], lines: Sequence[Line]
    ) -> FilterChoices:
        """INS_GYRO_FILTER, ATC_RAT_*_FLTD and _FLTE, INS_HNTCH_*."""
        from quadid_logs.autopilots.ardupilot.filter_choices import filter_choices

        return filter_choices(log, parameters, lines)

    @property
    def advice(self) -> Advice:
        """LOG_BITMASK and System ID mode."""
        from quadid_logs.autopilots.ardupilot.advice import ADVICE

        return ADVICE


AUTOPILOT = ArduPilot()
