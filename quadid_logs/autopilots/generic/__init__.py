"""What is not one autopilot's own: MAVLink, which several speak, and tables, which name none."""

from __future__ import annotations

from quadid_logs.autopilots import Autopilot, LogFormat


class Generic(Autopilot):
    """Of a log that names no autopilot, only the signals are known."""

    def formats(self) -> tuple[LogFormat, ...]:
        """MAVLink telemetry, whose messages name the autopilot; tables."""
        from quadid_logs.autopilots.generic import mavlink, table
        from quadid_logs.containers import tlog

        return (
            LogFormat("tlog", "MAVLink telemetry log", tlog.is_mine, mavlink.read, (".tlog",)),
            LogFormat("table", "table", table.is_mine, table.read, (".csv", ".parquet"), strict=False),
        )


AUTOPILOT = Generic()
