"""PX4: its topics, parameters and mixer, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from quadid_logs.autopilots import Autopilot, LogFormat, entry
from quadid_logs.data.log import FlightLog


def _read_ulog(path: str | Path, *, system: int = 0) -> FlightLog:
    """Read a ULog by what is imported for that alone: every log is asked first whether it is one."""
    from quadid_logs.autopilots.px4.log import read

    return read(path, system=system)


def _read_sdlog2(path: str | Path, *, system: int = 0) -> FlightLog:
    """Read a log of sdlog2, as `_read_ulog` does."""
    from quadid_logs.autopilots.px4.sdlog2 import read

    return read(path, system=system)


class Px4(Autopilot):
    """PX4 from 1.0 on."""

    name = "px4"
    title = "PX4"
    system_parameters = ("MAV_SYS_ID",)
    airframe_parameters = ("SYS_AUTOSTART",)

    find_airframe = entry(f"{__name__}.airframe:find_airframe")
    rebuild = entry(f"{__name__}.torque:rebuild")
    thrust_law = entry(f"{__name__}.torque:thrust_law")
    angle_gains = entry(f"{__name__}.controller:angle_gains")
    controllers = entry(f"{__name__}.controller:controllers")
    replay_inputs = entry(f"{__name__}.replay:replay_inputs")
    outer_controllers = entry(f"{__name__}.outer:outer_controllers")
    attitude_rows = entry(f"{__name__}.outer:attitude_rows")
    tunable = entry(f"{__name__}.gains:tunable")
    filter_choices = entry(f"{__name__}.filter_choices:filter_choices")
    advice = entry(f"{__name__}.advice:ADVICE")

    def formats(self) -> tuple[LogFormat, ...]:
        """ULog, and before 1.4 sdlog2, which has the magic bytes of DataFlash."""
        from quadid_logs.containers import sdlog2, ulog_header

        return (
            LogFormat("ulog", "PX4 ULog", ulog_header.is_mine, _read_ulog, (".ulg",)),
            LogFormat("dataflash", "PX4 sdlog2", sdlog2.is_mine, _read_sdlog2, (".px4log",), "sdlog2"),
        )

    def loop_rate_hz(self, parameters: Mapping[str, float]) -> float:
        """IMU_GYRO_RATEMAX; 0 there means as fast as the gyro, whose rate no parameter tells."""
        return parameters.get("IMU_GYRO_RATEMAX", 0.0)


AUTOPILOT = Px4()
