"""Write small MAVLink logs with pymavlink's own packing."""

from __future__ import annotations

import struct

from pymavlink.dialects.v20 import all as dialect

QUADROTOR, ROVER, GROUND_STATION = 2, 10, 6
ARDUPILOT, PX4, NO_AUTOPILOT = 3, 12, 8
HOST_EPOCH_US = 1_700_000_000_000_000


class Sender:
    """Packs messages of one system, each behind a host stamp."""

    def __init__(self, system: int = 1, component: int = 1, *, version: int = 2, key: bytes = b"") -> None:
        self.mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self.version = version
        self.host_us = HOST_EPOCH_US
        if key:
            self.mav.signing.secret_key = key
            self.mav.signing.sign_outgoing = True

    def packet(self, name: str, **fields: object) -> bytes:
        """Return one message as a packet; fields not given are zero."""
        kind = next(one for one in dialect.mavlink_map.values() if one.msgname == name)
        values = []
        for field, length, code in zip(
            kind.ordered_fieldnames, kind.array_lengths, kind.native_format[1:], strict=True
        ):
            empty: object = b"" if code == ord("c") else [0] * length if length else 0
            values.append((field, fields.pop(field, empty)))
        assert not fields, fields
        message = kind(**dict(values))
        return bytes(message.pack(self.mav, force_mavlink1=self.version == 1))

    def stamped(self, name: str, **fields: object) -> bytes:
        """Return a packet behind the host's stamp, which runs ten times too fast."""
        self.host_us += 100_000
        return struct.pack(">Q", self.host_us) + self.packet(name, **fields)

    def heartbeat(
        self, kind: int = QUADROTOR, autopilot: int = ARDUPILOT, mode: int = 0, base: int = 0
    ) -> bytes:
        """Return a stamped heartbeat."""
        return self.stamped(
            "HEARTBEAT", type=kind, autopilot=autopilot, custom_mode=mode, base_mode=base, mavlink_version=3
        )

    def attitude(self, k: int) -> bytes:
        """Return the attitude number `k`, every 10 ms since 1 s after boot."""
        return self.stamped(
            "ATTITUDE", time_boot_ms=1000 + 10 * k, roll=0.001 * k, rollspeed=float(k), yawspeed=-1.0
        )


def small_log(n_rows: int = 20) -> bytes:
    """Return a log of one copter: heartbeats and attitudes."""
    sender = Sender()
    return sender.heartbeat() + b"".join(
        sender.attitude(k) + (sender.heartbeat(mode=2, base=128) if k == n_rows // 2 else b"")
        for k in range(n_rows)
    )
