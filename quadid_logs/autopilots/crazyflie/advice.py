"""What to log and fly with a Crazyflie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

from quadid_logs.autopilots.generic.advice import Advice, Version
from quadid_logs.sentences import listed

#: The deck reads it from the card's top folder. The firmware takes 20 variables an event.
CONFIG: Final = "config.txt"
SCRIPT: Final = "fly.py"
_VARIABLES: Final = (
    *(f"controller.cmd_{name}" for name in ("roll", "pitch", "yaw", "thrust")),
    *(f"controller.{name}Rate" for name in ("roll", "pitch", "yaw")),
    *(f"gyro.{axis}" for axis in "xyz"),
    *(f"acc.{axis}" for axis in "xyz"),
    *(f"stateEstimate.q{axis}" for axis in "wxyz"),
    "pm.vbat",
    "supervisor.info",
)
_CONFIG_TEXT: Final = "\n".join(
    (
        "1     # version of this file",
        "4096  # buffer in bytes",
        "log   # name of the logs",
        "0     # not before usd.logging is set",
        "on:fixedFrequency",
        "250   # Hz",
        "1     # in step with the control loop",
        *_VARIABLES,
        "",
    )
)
#: A doublet that gives back speed and place: a quarter of a second one way, half a second the other, a
#: quarter back; then two seconds of rest at one place. Roll and pitch in degrees, yaw in degrees per second.
_SCRIPT_TEXT: Final = '''"""Fly {axes} doublets with a Crazyflie that holds its place, and log them.

pip install cflib; python fly.py [radio://0/80/2M/E7E7E7E7E7]. Stop with Ctrl-C: it lands.
"""

import sys
import time

import cflib.crtp
from cflib.crazyflie.syncCrazyflie import SyncCrazyflie

URI = sys.argv[1] if len(sys.argv) > 1 else "radio://0/80/2M/E7E7E7E7E7"
HEIGHT_M, REPEATS = 1.0, 10
#: Roll and pitch [deg], yaw rate [deg/s].
SIZE = {{{sizes}}}


def hold(send, seconds):
    """Send a set-point again and again: the firmware stops without."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        send()
        time.sleep(0.01)


def doublet(commander, size):
    """Tilt or turn one way, the other way, back, and rest."""
    for sign, seconds in ((1, 0.25), (-1, 0.5), (1, 0.25)):
        roll, pitch, yaw = (sign * each for each in size)
        hold(lambda: commander.send_zdistance_setpoint(roll, pitch, yaw, HEIGHT_M), seconds)
    hold(lambda: commander.send_hover_setpoint(0.0, 0.0, 0.0, HEIGHT_M), 2.0)


cflib.crtp.init_drivers()
with SyncCrazyflie(URI) as link:
    crazyflie, fly = link.cf, link.cf.high_level_commander
    crazyflie.param.set_value("usd.logging", 1)
    crazyflie.platform.send_arming_request(True)
    time.sleep(1.0)
    fly.takeoff(HEIGHT_M, 2.0)
    time.sleep(4.0)
    try:
        for size in SIZE.values():
            for _ in range(REPEATS):
                doublet(crazyflie.commander, size)
    finally:
        crazyflie.commander.send_notify_setpoint_stop()
        fly.land(0.0, 3.0)
        time.sleep(4.0)
        # This writes the checksum: without it the end of the log may be missing.
        crazyflie.param.set_value("usd.logging", 0)
        time.sleep(1.0)
'''
_SIZES: Final = {
    "roll": '"roll": (12.0, 0.0, 0.0)',
    "pitch": '"pitch": (0.0, 12.0, 0.0)',
    "yaw": '"yaw": (0.0, 0.0, 150.0)',
}


class CrazyflieAdvice(Advice):
    """Variables for the card, and a script for the vendor's Python library."""

    remedies = MappingProxyType(
        {
            "QL510": (
                "Give mass_kg in --vehicle FILE.toml: the commanded thrust is then compared with the "
                "weight. The controller commands counts, or newton metres of the motors and propellers "
                "that its firmware assumes."
            ),
            "QL309": "Use the model per unit of command: the torque command is taken as it is.",
        }
    )
    room = (
        "Choose a room with positioning (Flow deck, Lighthouse or motion capture) and 1.5 m of free space "
        "on all sides. Use a full battery."
    )

    def _logging(self, log_format: str, parameters: Mapping[str, float], version: Version | None) -> str:
        """Say what to put on the card."""
        return (
            f"Put {CONFIG} of `quadid-log plan --autopilot crazyflie -o DIR` on the card of the deck. It "
            "logs commands, set-points, gyro and attitude of the PID controller at 250 Hz. For another "
            "controller, log its own group instead (ctrlMel, ctrlINDI, ctrlLee)."
        )

    def excitation(self, axes: Sequence[str], version: Version | None) -> str:
        """Say which script flies it."""
        return (
            f"Fly {SCRIPT} of `quadid-log plan --autopilot crazyflie -o DIR`: it makes quick {listed(axes)} "
            "doublets. Pool the logs of several short flights with --pool."
        )

    def whole_files(self, axes: Sequence[str]) -> dict[str, str]:
        """Return what the deck logs, and what flies."""
        sizes = ", ".join(_SIZES[axis] for axis in axes)
        return {CONFIG: _CONFIG_TEXT, SCRIPT: _SCRIPT_TEXT.format(axes=listed(axes), sizes=sizes)}

    def steps(self, axes: Sequence[str], sweeps: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
        """Return how to fly the script."""
        if sweeps:
            raise NotImplementedError
        return (
            f"Copy {CONFIG} into the top folder of the card, and put the card into the deck.",
            f"Run `python {SCRIPT} URI`: it takes off to 1 m, flies ten doublets on {listed(axes)}, lands, "
            "and ends the log. Press Ctrl-C to land at once.",
            "If the battery does not last, change it and run the script again. Every run makes a log.",
        )


ADVICE: Final = CrazyflieAdvice()
