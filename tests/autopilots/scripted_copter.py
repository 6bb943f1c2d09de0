"""A copter whose firmware runs a Lua script: a stand-in for the interface that the script is written for.

What a name does is what ArduPilot's documentation of it says (libraries/AP_Scripting/docs/docs.lua) and, of
the System ID mode, what ArduCopter/mode_systemid.cpp does in each main loop. The main loop runs on while the
script sets a parameter, as it does in flight.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import lupa.lua53
import numpy as np

STABILIZE, ALT_HOLD, GUIDED, LAND, RTL, SYSTEM_ID = 0, 2, 4, 9, 6, 25
LOOP_S = 0.0025
#: ArduCopter's defaults: the magnitude is in degrees, and a hundred times what a mixer axis bears.
DEFAULTS = {
    "SID_AXIS": 0.0,
    "SID_MAGNITUDE": 15.0,
    "SID_F_START_HZ": 0.5,
    "SID_F_STOP_HZ": 40.0,
    "SID_T_FADE_IN": 15.0,
    "SID_T_REC": 70.0,
    "SID_T_FADE_OUT": 2.0,
    "MOT_THST_HOVER": 0.3,
    "RCMAP_ROLL": 1.0,
    "RCMAP_PITCH": 2.0,
    "RCMAP_YAW": 4.0,
}
#: uint32 and uint64 are userdata with their own arithmetic; a script must not take them for numbers.
_TYPES = """
local u32 = {}
u32.__index = u32
function new_u32(value) return setmetatable({ value = value }, u32) end
function u32.__sub(a, b) return new_u32(a.value - b.value) end
function u32:tofloat() return self.value * 1.0 end
"""


@dataclass
class Copter:
    """A vehicle in the air, what its firmware sees of it, and what System ID mode does to its mixer."""

    rng: np.random.Generator
    parameters: dict[str, float] = field(default_factory=DEFAULTS.copy)
    mode: int = STABILIZE
    time_s: float = 0.0
    switch: int = 0
    armed: bool = True
    link: bool = True
    roll_rad: float = 0.02
    height_m: float | None = 12.0
    battery_percent: int | None = 80
    battery_failsafe: bool = False
    #: Chance of a call to be refused, or to raise an error.
    refused: float = 0.0
    broken: float = 0.0
    modes_refused: bool = False
    rate_targets: bool = True
    testing: bool = False
    entered_s: float = 0.0
    #: Of each main loop in which System ID mode may add to the mixer: its axis and magnitude.
    injected: list[tuple[int, float]] = field(default_factory=list)
    targets: list[tuple[float, ...]] = field(default_factory=list)
    rows: list[tuple[Any, ...]] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)

    def main_loop(self) -> None:
        """Run the mode once: with no axis it stops for good, and after its sweep it has finished."""
        self.time_s += LOOP_S
        if self.mode != SYSTEM_ID or not self.testing:
            return
        if self.parameters["SID_AXIS"] == 0.0:
            self.testing = False
        elif 1.0 < self.time_s - self.entered_s < 1.0 + self.parameters["SID_T_REC"]:
            self.injected.append((int(self.parameters["SID_AXIS"]), self.parameters["SID_MAGNITUDE"]))

    def change_mode(self, mode: int) -> bool:
        """Enter a mode as the firmware does: System ID only with an axis."""
        if mode == SYSTEM_ID and self.parameters["SID_AXIS"] == 0.0:
            return False
        self.mode = mode
        self.testing, self.entered_s = mode == SYSTEM_ID, self.time_s
        return True

    def _call(self) -> None:
        """Fail where the firmware is made to, and let the main loop run meanwhile."""
        if self.rng.random() < 0.3:
            self.main_loop()
        if self.rng.random() < self.broken:
            raise RuntimeError("not enough memory")

    def set_parameter(self, name: str, value: float) -> bool:
        """Set what exists, in single precision."""
        self._call()
        if name not in self.parameters or self.rng.random() < self.refused:
            return False
        self.parameters[name] = float(np.float32(value))
        return True

    def set_mode(self, mode: int) -> bool:
        """Set a mode from the script."""
        self._call()
        refused = self.modes_refused or self.rng.random() < self.refused
        return not refused and self.change_mode(int(mode))

    def set_rates(self, *values: float) -> bool:
        """Take rate targets, in Guided mode only."""
        self._call()
        if self.mode == GUIDED:
            self.targets.append(tuple(values))
        return self.mode == GUIDED

    def run(self, script: str, seconds: float, event: Callable[[Copter], None], event_s: float) -> None:
        """Load a script and fly; at `event_s` something happens."""
        lua = lupa.lua53.LuaRuntime(unpack_returned_tuples=True)
        self._offer(lua)
        update, wait_ms = lua.execute(script)
        happened = False
        due_s = self.time_s + wait_ms / 1000.0
        while self.time_s < seconds:
            self.main_loop()
            if not happened and self.time_s >= event_s:
                event(self)
                happened = True
            if self.time_s >= due_s:
                update, wait_ms = update()
                due_s = self.time_s + wait_ms / 1000.0

    def _offer(self, lua: Any) -> None:
        """Put the firmware's names into the interpreter."""
        names = lua.globals()
        lua.execute(_TYPES)
        new_u32 = names.new_u32
        names.millis = lambda: new_u32(math.floor(1000.0 * self.time_s) + 123_000)
        vector = lua.table_from({"z": lambda _: 0.0})
        channel = lua.table_from({"norm_input_dz": lambda _: 0.0})
        tables: dict[str, dict[str, Callable[..., Any]]] = {
            "gcs": {"send_text": lambda _, _severity, text: self.texts.append(str(text))},
            "logger": {"write": lambda _, *values: self.rows.append(values)},
            "param": {
                "get": lambda _, name: self.parameters.get(name),
                "set": lambda _, name, value: self.set_parameter(name, value),
            },
            "arming": {"is_armed": lambda _: self.armed},
            "rc": {
                "has_valid_input": lambda _: self.link,
                "get_aux_cached": lambda _, option: self.switch if option == 300 else None,
                "get_channel": lambda *_: channel,
            },
            "ahrs": {
                "get_roll": lambda _: self.roll_rad,
                "get_pitch": lambda _: 0.01,
                "get_relative_position_D_home": lambda _: None if self.height_m is None else -self.height_m,
                "get_velocity_NED": lambda _: vector,
            },
            "battery": {
                "has_failsafed": lambda _: self.battery_failsafe,
                "capacity_remaining_pct": lambda *_: self.battery_percent,
            },
            "vehicle": {
                "get_mode": lambda _: self.mode,
                "set_mode": lambda _, mode: self.set_mode(mode),
            },
        }
        if self.rate_targets:
            tables["vehicle"]["set_target_rate_and_throttle"] = lambda _, *values: self.set_rates(*values)
        for name, functions in tables.items():
            names[name] = lua.table_from(functions)
