"""Caveats about the file itself: damage, clocks, whose log it is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import PurePath

from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification
from quadid_logs.data.result import PooledLog
from quadid_logs.diagnose.findings import finding, rounded
from quadid_logs.maths.random_effect import random_effect
from quadid_logs.vocabulary import AXES, MULTIROTOR, vehicle_words

#: Under one per thousand of the rows what was repaired or left out changes no estimate.
_NOTABLE_REPAIRS = 1e-3
#: More lost bytes than this fraction of the file may well hide a part of the manoeuvre.
_NOTABLE_LOSS = 0.01


#: Messages of DataFlash and MAVLink are below 300 bytes.
_LONGEST_MESSAGE = 300
_ONLY_THE_END = "Nothing to do: only the last message is cut off, as happens when power is switched off."
#: MAV_AUTOPILOT_INVALID of MAVLink's minimal.xml: ground stations, cameras, gimbals.
_NO_AUTOPILOT = "invalid"
_LEAVE_OUT = "Leave out the pooled logs that add no flight: the evidence names them."
_COPY_AGAIN = "Copy the log from the card again, and analyze that copy."
_OTHERS_ARE_STATIONS = "Nothing to do: the others are ground stations or devices on board."


def find_in_file(log: FlightLog, data: FlightData) -> Iterator[Finding]:
    """Yield the findings about damage, dropped messages, clocks, systems and the kind of vehicle.

    Parameters
    ----------
    log : FlightLog
    data : FlightData

    Yields
    ------
    Finding
    """
    yield from _damage(log)
    yield from _clock(log, data)
    yield from _vehicle(log)


def find_in_pool(pooled: Sequence[PooledLog], identification: Identification) -> Iterator[Finding]:
    """Say which logs are behind the model, and warn of those that added nothing.

    Parameters
    ----------
    pooled : sequence of PooledLog
        Empty where the model is that of one log.
    identification : Identification
        Of its recommended model, what the flights differ by.

    Yields
    ------
    Finding
    """
    if not pooled:
        return
    flown = {PurePath(each.path).name: round(each.used_s, 1) for each in pooled}
    same = {PurePath(each.path).name: PurePath(each.same_as).name for each in pooled if each.same_as}
    # What repeats another flight is counted with that one, and asks nothing of anybody.
    idle = [name for name, used_s in flown.items() if not used_s and name not in same]
    title = f"{len(idle)} of {len(pooled)} pooled logs hold no usable flight" if idle else ""
    advice = _LEAVE_OUT if idle else ""
    if same and not idle:
        title = (
            f"{len(same)} of {len(pooled)} pooled logs repeat the flight of another log, which counts once"
        )
    evidence: dict[str, object] = {
        "used_s": flown,
        "same_as": same,
        "between_flights": _between_flights(identification),
    }
    yield finding("QL107", "warning" if idle else "info", evidence, title=title, advice=advice)


def _between_flights(identification: Identification) -> dict[str, object]:
    """Return by axis whether the flights are of one effectiveness, and how far it differs between them."""
    model = identification.recommended
    if model is None or model.structural is None or not len(model.structural.flight_gain):
        return {}
    gain, half_width = model.structural.flight_gain, model.structural.flight_half_width
    found = [random_effect(gain[:, axis], half_width[:, axis]) for axis in range(3)]
    return {
        axis: {
            "flights": each.n,
            "chi_square": rounded(each.chi_square, 3),
            "p_value": rounded(each.p_value, 2),
            "relative_sd": rounded(each.sd, 2),
        }
        for axis, each in zip(AXES, found, strict=True)
        if each.n > 1
    }


def _damage(log: FlightLog) -> Iterator[Finding]:
    if log.corrupt_bytes:
        largest = sorted(log.lost, key=lambda block: -block.n_bytes)[:5]
        fraction = log.corrupt_bytes / max(log.n_bytes, 1)
        yield finding(
            "QL101",
            "warning" if fraction > _NOTABLE_LOSS and not _only_the_end(log) else "info",
            {
                "corrupt_bytes": log.corrupt_bytes,
                "file_bytes": log.n_bytes,
                "lost_blocks": len(log.lost),
                "largest": [
                    f"{block.n_bytes} bytes at offset {block.offset}: {block.reason}" for block in largest
                ],
            },
            advice=_ONLY_THE_END if _only_the_end(log) else "",
        )
    if log.checksum_wrong:
        title = "The checksum of the file is wrong: some bytes are not those that were logged"
        evidence = {"file_bytes": log.n_bytes, "checksum": "wrong"}
        yield finding("QL101", "warning", evidence, title=title, advice=_COPY_AGAIN)
    if log.n_dropped:
        yield finding("QL102", "info", {"dropped_messages": log.n_dropped})


def _only_the_end(log: FlightLog) -> bool:
    """Say whether nothing but the beginning of one message at the end of the file is lost."""
    (first, *others) = log.lost
    return not others and first.n_bytes < _LONGEST_MESSAGE and first.offset + first.n_bytes >= log.n_bytes


def _clock(log: FlightLog, data: FlightData) -> Iterator[Finding]:
    if not log.has_time:
        yield finding("QL104", "error", {"format": log.format, "firmware": log.firmware})
    if data.clock_resets:
        yield finding("QL103", "info", {"clock_resets": data.clock_resets})
    repaired = {
        name: {
            "source": source.source,
            "rows": source.n_samples,
            "repeated": source.n_duplicate,
            "out_of_order": source.n_out_of_order,
            "impossible": source.n_outliers,
            "not_finite": source.n_not_finite,
        }
        for name, source in data.sources.items()
        if name in ("body_rate", "torque_command", "torque_n_m")
        and source.n_duplicate + source.n_out_of_order + source.n_outliers + source.n_not_finite
        > _NOTABLE_REPAIRS * source.n_samples
    }
    if repaired:
        yield finding("QL106", "info", repaired)


def _vehicle(log: FlightLog) -> Iterator[Finding]:
    if len(log.systems) > 1:
        vehicles = [each for each in log.systems if each.autopilot != _NO_AUTOPILOT]
        yield finding(
            "QL105",
            "info",
            advice="" if len(vehicles) > 1 else _OTHERS_ARE_STATIONS,
            evidence={
                "systems": [
                    f"system {s.system_id} component {s.component_id}: {s.vehicle_type} ({s.autopilot}), "
                    f"{s.n_messages} messages{', chosen' if s.chosen else ''}"
                    for s in log.systems
                ],
                **({"others": log.n_systems - len(log.systems)} if log.n_systems > len(log.systems) else {}),
            },
        )
    if log.vehicle_type == "unknown":
        yield finding("QL202", "info", {"firmware": log.firmware})
    elif log.vehicle_type != MULTIROTOR:
        yield finding(
            "QL201",
            "error",
            {"vehicle_type": log.vehicle_type, "firmware": log.firmware},
            title=f"This is not a multirotor but {vehicle_words(log.vehicle_type)}",
        )
