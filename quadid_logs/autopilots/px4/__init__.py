"""PX4: its topics, parameters and mixer, and nothing else."""

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
    from quadid_logs.data.outer_loops import AttitudeRows, OuterControllers
    from quadid_logs.data.tuning import FilterChoices, Tunable


class Px4(Autopilot):
    """PX4 from 1.0 on."""

    name = "px4"
    title = "PX4"
    system_parameters = ("MAV_SYS_ID",)
    airframe_parameters = ("SYS_AUTOSTART",)

    def formats(self) -> tuple[LogFormat, ...]:
        """ULog, and before 1.4 sdlog2, which has the magic bytes of DataFlash."""
        from quadid_logs.autopilots.px4.log import read
        from quadid_logs.autopilots.px4.sdlog2 import read as read_sdlog2
        from quadid_logs.containers import sdlog2, ulog

        return (
            LogFormat("ulog", "PX4 ULog", ulog.is_mine, read, (".ulg",)),
            LogFormat("dataflash", "PX4 sdlog2", sdlog2.is_mine, read_sdlog2, (".px4log",), "sdlog2"),
        )

    def find_airframe(self, log: FlightLog) -> Airframe | Unknown:
        """CA_ROTORn_*; SYS_AUTOSTART before 1.13."""
        from quadid_logs.autopilots.px4.airframe import find_airframe

        return find_airframe(log)

    def rebuild(self, log: CleanLog, airframe: Airframe) -> Rebuilt:
        """Take actuator_motors, the set-point through the allocation, or the outputs."""
        from quadid_logs.autopilots.px4.torque import rebuild

        return rebuild(log, airframe)

    def loop_rate_hz(self, parameters: Mapping[str, float]) -> float:
        """IMU_GYRO_RATEMAX; 0 there means as fast as the gyro, whose rate no parameter tells."""
        return parameters.get("IMU_GYRO_RATEMAX", 0.0)

    def angle_gains(self, mode: str, parameters: Mapping[str, float]) -> tuple[float, float, float] | None:
        """MC_ROLL_P, MC_PITCH_P and MC_YAW_P; none in ACRO."""
        from quadid_logs.autopilots.px4.controller import angle_gains

        return angle_gains(mode, parameters)

    def controllers(
        self,
        log: FlightLog,
        parameters: Mapping[str, float],
        *,
        period_s: float | None = None,
        axes: Sequence[str] = AXES,
    ) -> FlownControllers:
        """mc_rate_control and mc_att_control by MC_*."""
        from quadid_logs.autopilots.px4.controller import controllers

        return controllers(log, parameters, period_s=period_s, axes=axes)

    def replay_inputs(
        self, log: FlightLog, controllers: FlownControllers, intervals: Sequence[tuple[float, float]]
    ) -> Mapping[str, ReplayInput]:
        """Rows of vehicle_angular_velocity with set-points and torques."""
        from quadid_logs.autopilots.px4.replay import replay_inputs

        return replay_inputs(log, controllers, intervals)

    def outer_controllers(self, parameters: Mapping[str, float]) -> OuterControllers:
        """MC_REF_*, MPC_XY_*."""
        from quadid_logs.autopilots.px4.outer import outer_controllers

        return outer_controllers(parameters)

    def attitude_rows(
        self, log: FlightLog, parameters: Mapping[str, float], intervals: Sequence[tuple[float, float]]
    ) -> AttitudeRows | None:
        """vehicle_attitude and its set-point, with vehicle_rates_setpoint beside them."""
        from quadid_logs.autopilots.px4.outer import attitude_rows

        return attitude_rows(log, parameters, intervals)

    def tunable(self, parameters: Mapping[str, float], version: tuple[int, ...] | None = None) -> Tunable:
        """MC_*RATE_K, and the gains behind it."""
        from quadid_logs.autopilots.px4.gains import tunable

        return tunable(parameters, version)

    def thrust_law(self, log: FlightLog, parameters: Mapping[str, float]) -> ThrustLaw:  # noqa: ARG002
        """THR_MDL_FAC and MC_BAT_SCALE_EN."""
        from quadid_logs.autopilots.px4.thrust_law import thrust_law

        return thrust_law(parameters)

    def filter_choices(
        self, log: FlightLog, parameters: Mapping[str, float], lines: Sequence[Line]
    ) -> FilterChoices:
        """IMU_GYRO_CUTOFF, IMU_DGYRO_CUTOFF, IMU_GYRO_NF*, IMU_GYRO_DNF_*."""
        from quadid_logs.autopilots.px4.filter_choices import filter_choices

        return filter_choices(log, parameters, lines)

    @property
    def advice(self) -> Advice:
        """SDLOG_PROFILE and stick doublets."""
        from quadid_logs.autopilots.px4.advice import ADVICE

        return ADVICE


AUTOPILOT = Px4()
