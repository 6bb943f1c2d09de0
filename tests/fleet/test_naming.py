"""Whose log it is, and when it was flown."""

from __future__ import annotations

import dataclasses
import datetime
import math

import pytest

from quadid_logs.data.log import FlightLog, LoggedSystem
from quadid_logs.errors import SettingsError
from quadid_logs.fleets.log_files import LogFile
from quadid_logs.fleets.naming import NamingRules, clock_zero, identify_unread, identify_vehicle, number_in

SOURCE = LogFile(url="/data/quad-07/2026-05-01/00000012.BIN", n_bytes=10, modified_s=1.75e9)
BUILT = "(ardupilot quad X)"
CUBE = "CubeOrange 003A0027 3130510A 34383704"
PX4_ID = "000600000000383638393239510d0035002d"


def log(**changes):
    bare = FlightLog(
        path="x", format="dataflash", autopilot="ardupilot", n_bytes=10, signals={}, frame="quad X"
    )
    return dataclasses.replace(bare, **changes)


@pytest.mark.parametrize(
    ("found", "name", "taken_from"),
    [
        (log(hardware_id=CUBE), CUBE, "hardware id"),
        (log(hardware_id=PX4_ID), PX4_ID, "hardware id"),
        (
            log(hardware_id="PX4FMU_V2", parameters={"BRD_SERIAL_NUM": 42.0}),
            f"serial 42 {BUILT}", "BRD_SERIAL_NUM",
        ),
        (log(hardware_id="0" * 36, parameters={"MAV_SYS_ID": 9.0}), f"system 9 {BUILT}", "MAV_SYS_ID"),
        (log(vehicle_name="Gecko", parameters={"BRD_SERIAL_NUM": 42.0}), f"Gecko {BUILT}", "craft name"),
        (log(hardware_id=CUBE, vehicle_name="Gecko"), CUBE, "hardware id"),
        (log(parameters={"SYSID_THISMAV": math.nan}), f"2026-05-01 {BUILT}", "folder"),
        (log(parameters={"SYSID_THISMAV": 1.0}), f"2026-05-01 {BUILT}", "folder"),
    ],
)  # fmt: skip
def test_the_first_name_that_tells_vehicles_apart_is_taken(found, name, taken_from):
    """A type of board, an id of zeros, and the default MAVLink id do not."""
    identity = identify_vehicle(found, SOURCE, NamingRules())
    assert (identity.vehicle, identity.vehicle_from) == (name, taken_from)


@pytest.mark.parametrize(
    "other",
    [
        {"autopilot": "px4"},
        {"vehicle_type": "rover", "frame": ""},
        {"frame": "hexa X"},
        {"autopilot": "px4", "parameters": {"SYS_AUTOSTART": 4001.0}},
        {"autopilot": "px4", "parameters": {"SYS_AUTOSTART": 4010.0}},
    ],
)
@pytest.mark.parametrize("weak", [{}, {"BRD_SERIAL_NUM": 42.0}, {"SYSID_THISMAV": 9.0}])
def test_vehicles_that_are_built_differently_are_not_merged(other, weak):
    """A folder, a number that people gave, a radio's id: several vehicles may have the same."""
    parameters = other.get("parameters", {}) | weak
    found = [log(vehicle_type="multirotor", parameters=weak), log(**other | {"parameters": parameters})]
    names = {identify_vehicle(one, SOURCE, NamingRules()).vehicle for one in found}
    assert len(names) == 2


def test_two_vehicles_of_one_craft_name_that_are_built_differently_are_not_merged():
    """Many are called "quad"."""
    found = [log(vehicle_name="quad"), log(vehicle_name="quad", frame="hexa X")]
    assert len({identify_vehicle(one, SOURCE, NamingRules()).vehicle for one in found}) == 2


def test_the_number_of_a_mavlink_system_is_no_craft_name():
    """Every ground station's first vehicle is system 1."""
    system = LoggedSystem(
        system_id=1,
        component_id=1,
        autopilot="ardupilotmega",
        vehicle_type="multirotor",
        n_messages=9,
        chosen=True,
    )
    one = log(format="tlog", vehicle_name="system 1", systems=(system,))
    assert identify_vehicle(one, SOURCE, NamingRules()).vehicle_from == "folder"


def test_logs_without_any_identity_are_not_merged():
    """Dropped on a page there is no folder: two quads became one "unknown (ardupilot quad X)"."""
    names = [
        identify_vehicle(log(), LogFile(url=url), NamingRules(), sha256).vehicle
        for url, sha256 in (("a.bin", "1" * 64), ("b.bin", "2" * 64), ("a.bin", "3" * 64))
    ]
    assert len(set(names)) == 3
    assert names[0].startswith("a.bin")


def test_two_airframes_of_one_frame_are_not_merged():
    """Their numbers differ, their rotors stand alike."""
    names = {
        identify_vehicle(
            log(autopilot="px4", parameters={"SYS_AUTOSTART": number}), SOURCE, NamingRules()
        ).vehicle
        for number in (4001.0, 4010.0)
    }
    assert len(names) == 2


def test_an_airframe_that_is_the_frame_is_named_once():
    """PX4 before 1.13 says no more of its frame than the airframe's number."""
    one = log(autopilot="px4", frame="quadrotor, airframe 10020", parameters={"SYS_AUTOSTART": 10020.0})
    assert identify_vehicle(one, SOURCE, NamingRules()).vehicle.count("10020") == 1


def test_an_airframe_within_the_frame_is_named_once():
    """PX4 since 1.13 tells its rotors behind the airframe."""
    frame = "quadrotor, airframe 10040, 4 rotors in CA_ROTOR*"
    one = log(autopilot="px4", frame=frame, parameters={"SYS_AUTOSTART": 10040.0})
    assert identify_vehicle(one, SOURCE, NamingRules()).vehicle.count("10040") == 1


def test_a_vehicle_of_unknown_type_is_said_to_be_that():
    """The page read "px4 unknown"."""
    found = identify_vehicle(log(autopilot="px4", frame=""), SOURCE, NamingRules())
    assert found.model == "px4 vehicle of unknown type"


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("00000012.BIN", 12),
        ("log_3.ulg", 3),
        ("sess001/log100.ulg", 100),
        ("2026-03-04 05-06-07.bin", None),
        ("a.bin", None),
    ],
)
def test_the_number_of_a_log_is_read_from_its_name(name, number):
    """A date is none."""
    assert number_in(f"/data/2026-05-01/{name}") == number


def test_the_users_rule_wins():
    """He knows his folders."""
    rules = NamingRules(vehicle_from=r"/(quad-\d+)/", model_from="quad")
    identity = identify_vehicle(log(hardware_id=CUBE), SOURCE, rules)
    assert (identity.vehicle, identity.model) == ("quad-07", "quad")
    assert identify_unread(SOURCE, rules).vehicle == "quad-07"


def test_the_model_is_autopilot_and_frame():
    """What its gains can be compared with."""
    assert identify_vehicle(log(), SOURCE, NamingRules()).model == "ardupilot quad X"


def test_a_rule_that_is_no_expression_is_refused():
    """Before the work."""
    with pytest.raises(SettingsError, match="--vehicle-from"):
        NamingRules(vehicle_from="(")


def utc(*parts):
    return datetime.datetime(*parts, tzinfo=datetime.UTC).timestamp()


def test_a_flight_that_is_yet_to_come_is_dated_by_its_file() -> None:
    """Fourteen logs of one vehicle, flown on six days, all said 2041-06-28T01:04: its clock was never set."""
    never_set = log(utc_offset_s=utc(2100, 6, 28))
    assert clock_zero(never_set, 30.0, SOURCE) == (utc(2026, 5, 1) - 30.0, "file name")


def test_the_receiver_knows_the_time_best():
    """Then the name of the file, then its modification."""
    assert clock_zero(log(utc_offset_s=1.6e9), 30.0, SOURCE) == (1.6e9, "receiver")
    assert clock_zero(log(), 30.0, SOURCE) == (utc(2026, 5, 1) - 30.0, "file name")
    plain = dataclasses.replace(SOURCE, url="/data/00000012.BIN")
    assert clock_zero(log(), 30.0, plain) == (1.75e9 - 30.0, "modification")
    unknown, says = clock_zero(log(), 30.0, LogFile(url="/data/1.bin"))
    assert math.isnan(unknown)
    assert says == ""


@pytest.mark.parametrize(
    ("name", "date"),
    [
        ("2021-03-04 05-06-07.bin", utc(2021, 3, 4, 5, 6, 7)),
        ("log_3_2021-3-4-15-06-07.ulg", utc(2021, 3, 4, 15, 6, 7)),
        ("20210304_150607.tlog", utc(2021, 3, 4, 15, 6, 7)),
        ("2021-03-04/11_22_33.ulg", utc(2021, 3, 4, 11, 22, 33)),
        ("flight 2021.03.04.bin", utc(2021, 3, 4)),
        ("2019-01-01/copied 2021-03-04.bin", utc(2021, 3, 4)),
    ],
)
def test_dates_are_read_as_ground_stations_write_them(name, date):
    """Mission Planner, QGroundControl, PX4's own folders, people."""
    assert clock_zero(log(), 0.0, LogFile(url=f"/data/{name}"))[0] == date


@pytest.mark.parametrize("name", ["00000123.bin", "2021-13-45.bin", "120210304999.bin", "v2021.bin"])
def test_numbers_that_are_no_date_are_none(name):
    """Counters, impossible months, serial numbers."""
    assert math.isnan(clock_zero(log(), 0.0, LogFile(url=f"/data/{name}"))[0])
