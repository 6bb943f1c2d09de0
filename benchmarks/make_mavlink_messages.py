"""Write quadid_logs/containers/mavlink_messages.json anew, from the installed pymavlink.

A table of 90 kB is all that reading and writing telemetry needs of a package of 90 MB.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

TABLE = Path(__file__).parents[1] / "quadid_logs" / "containers" / "mavlink_messages.json"
#: The enumerations whose entries are told by name.
ENUMS = ("MAV_AUTOPILOT", "MAV_TYPE", "COPTER_MODE", "PLANE_MODE", "ROVER_MODE", "SUB_MODE", "TRACKER_MODE")


def messages_table() -> dict[str, Any]:
    """Return every message of the dialect "all", by number, and some enumerations.

    A message is its name, the struct format of its payload, its fields in wire order and in the order of its
    definition, and the byte that its checksum ends with.
    """
    from pymavlink.dialects.v20 import all as generated

    messages = {
        str(number): [
            str(message.msgname),
            str(message.unpacker.format),
            list(message.ordered_fieldnames),
            [message.ordered_fieldnames.index(name) for name in message.fieldnames],
            int(message.crc_extra),
        ]
        for number, message in sorted(generated.mavlink_map.items())
        if 0 <= number < 1 << 16
    }
    enums = {
        name: {str(value): str(entry.name) for value, entry in generated.enums[name].items()}
        for name in ENUMS
        if name in generated.enums
    }
    return {"enums": enums, "messages": messages}


if __name__ == "__main__":
    table = messages_table()
    parts = [f'"enums": {json.dumps(table["enums"])}']
    rows = ",\n".join(f'"{number}": {json.dumps(row)}' for number, row in table["messages"].items())
    parts.append('"messages": {\n' + rows + "\n}")
    TABLE.write_text("{\n" + ",\n".join(parts) + "\n}\n", encoding="utf-8")
