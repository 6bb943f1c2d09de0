"""ArduPilot: its messages, parameters and mixer, and nothing else."""

from __future__ import annotations

from quadid_logs.autopilots import Autopilot, LogFormat, entry


class ArduPilot(Autopilot):
    """ArduPilot from 2.9 on."""

    name = "ardupilot"
    title = "ArduPilot"
    serial_parameters = ("BRD_SERIAL_NUM",)
    system_parameters = ("SYSID_THISMAV", "MAV_SYSID")

    find_airframe = entry(f"{__name__}.airframe:find_airframe")
    rebuild = entry(f"{__name__}.torque:rebuild")
    thrust_law = entry(f"{__name__}.torque:thrust_law")
    loop_rate_hz = entry(f"{__name__}.controller:loop_rate_hz")
    angle_gains = entry(f"{__name__}.controller:angle_gains")
    controllers = entry(f"{__name__}.controller:controllers")
    replay_inputs = entry(f"{__name__}.replay:replay_inputs")
    outer_controllers = entry(f"{__name__}.outer:outer_controllers")
    attitude_rows = entry(f"{__name__}.outer:attitude_rows")
    shaper_rows = entry(f"{__name__}.outer:shaper_rows")
    tunable = entry(f"{__name__}.gains:tunable")
    filter_choices = entry(f"{__name__}.filter_choices:filter_choices")
    advice = entry(f"{__name__}.advice:ADVICE")

    def formats(self) -> tuple[LogFormat, ...]:
        """DataFlash as bytes and as text."""
        from quadid_logs.autopilots.ardupilot.log import read_binary, read_text
        from quadid_logs.containers import dataflash, dataflash_text

        text = "ArduPilot DataFlash as text"
        return (
            LogFormat("dataflash", "ArduPilot DataFlash", dataflash.is_mine, read_binary, (".bin",)),
            LogFormat("dataflash-text", text, dataflash_text.is_mine, read_text, (".log",), strict=False),
        )


AUTOPILOT = ArduPilot()
