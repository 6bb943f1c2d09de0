"""Which airframe a log describes, and what to pass where it cannot tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from quadid_logs.actuation.airframe import Airframe, Unknown, with_rotors
from quadid_logs.autopilots import named
from quadid_logs.data.log import FlightLog
from quadid_logs.data.vehicle import Rotor, Vehicle
from quadid_logs.load import load, prepare
from tests.actuation.logs import PARAMETERS, ardupilot_log


def log_of(parameters: Mapping[str, float], autopilot: str = "ardupilot", frame: str = "") -> FlightLog:
    """Return a log with parameters and nothing else."""
    return FlightLog(
        path="made",
        format="ulog",
        autopilot=autopilot,
        n_bytes=1,
        signals={},
        parameters=parameters,
        frame=frame,
    )


def find_airframe(log: FlightLog, vehicle: Vehicle | None = None) -> Airframe | Unknown:
    """Return what the log's autopilot and the vehicle file say."""
    return with_rotors(named(log.autopilot).find_airframe(log), vehicle)


def rotors(count: int) -> dict[str, float]:
    """Return CA_ROTOR* of a ring of rotors with real arms."""
    values = {"CA_ROTOR_COUNT": float(count)}
    for number in range(count):
        angle = 2.0 * np.pi * (number + 0.5) / count
        values |= {
            f"CA_ROTOR{number}_PX": 0.2 * np.cos(angle),
            f"CA_ROTOR{number}_PY": 0.2 * np.sin(angle),
            f"CA_ROTOR{number}_KM": 0.016 if number % 2 else -0.016,
            f"CA_ROTOR{number}_CT": 9.0,
        }
    return values


def test_servo_functions_give_the_output_of_each_motor() -> None:
    """Motor 1 may sit on any channel; 82 to 85 are motors 9 to 12."""
    parameters = dict(PARAMETERS) | {"SERVO1_FUNCTION": 36.0, "SERVO4_FUNCTION": 33.0}
    found = find_airframe(log_of(parameters))
    assert isinstance(found, Airframe)
    assert found.channels == (4, 2, 3, 1)


def test_twelve_motors_use_the_second_range_of_functions() -> None:
    """A dodeca-hexa on outputs 1 to 12."""
    parameters = {"FRAME_CLASS": 12.0, "FRAME_TYPE": 1.0}
    parameters |= {f"SERVO{n}_FUNCTION": float(32 + n if n <= 8 else 73 + n) for n in range(1, 13)}
    found = find_airframe(log_of(parameters))
    assert isinstance(found, Airframe)
    assert found.channels == tuple(range(1, 13))


def test_a_motor_without_an_output_is_named() -> None:
    """No guess is made where SERVOn_FUNCTION leaves a motor out."""
    found = find_airframe(log_of(dict(PARAMETERS) | {"SERVO3_FUNCTION": 0.0}))
    assert isinstance(found, Airframe)
    assert found.channels == ()
    assert "motor 3" in found.channel_source


def test_a_quadplane_has_parameters_of_its_own() -> None:
    """Q_FRAME_CLASS counts, and Q_M_* are the motors'."""
    parameters = {f"Q_{name}" if "FRAME" in name else name: value for name, value in PARAMETERS.items()}
    parameters |= {"Q_ENABLE": 1.0, "Q_FRAME_CLASS": 2.0, "FRAME_CLASS": 0.0}
    found = find_airframe(log_of(parameters))
    assert isinstance(found, Airframe)
    assert found.n_rotors == 6
    assert found.source.startswith("Q_FRAME_CLASS 2")


def test_frame_alone_needs_the_number_of_motors() -> None:
    """FRAME 1 is an X of any number of arms; the start-up text may tell."""
    assert isinstance(find_airframe(log_of({"FRAME": 1.0})), Unknown)
    found = find_airframe(log_of({"FRAME": 1.0}, frame="hexa X"))
    assert isinstance(found, Airframe)
    assert found.n_rotors == 6


def test_untouched_px4_geometry_is_refused_as_calibration() -> None:
    """Arms of 1 m, CT 6.5 and KM 0.05 mix motors, but measure nothing."""
    values = {"CA_ROTOR_COUNT": 4.0}
    for number, (x, y, spin) in enumerate(((1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1))):
        values |= {f"CA_ROTOR{number}_PX": float(x), f"CA_ROTOR{number}_PY": float(y)}
        values |= {f"CA_ROTOR{number}_CT": 6.5, f"CA_ROTOR{number}_KM": 0.05 * spin}
    found = find_airframe(log_of(values, "px4"))
    assert isinstance(found, Airframe)
    assert not found.in_metres
    assert np.isnan([found.max_thrust_n, found.torque_to_thrust_m]).all()
    assert all(word in found.refused[0] for word in ("arms of 1 m", "6.5", "0.05"))


def test_touched_px4_geometry_is_taken_in_metres() -> None:
    """A careful owner's CA_ROTOR* are arms, newtons and a ratio."""
    found = find_airframe(log_of(rotors(6), "px4"))
    assert isinstance(found, Airframe)
    assert found.in_metres
    assert found.max_thrust_n == 9.0
    assert found.torque_to_thrust_m == pytest.approx(0.016)
    assert found.remarks == ()


def test_rotors_of_the_vehicle_file_win() -> None:
    """Positions and spin are taken, and a wrong number of them is refused with the number that is needed."""
    four = tuple(
        Rotor(position_m=(x, y, 0.0), spin=spin)
        for x, y, spin in ((0.1, 0.2, "ccw"), (-0.1, -0.2, "ccw"), (0.1, -0.2, "cw"), (-0.1, 0.2, "cw"))
    )
    found = find_airframe(log_of(PARAMETERS), Vehicle(rotors=four))
    assert isinstance(found, Airframe)
    assert found.in_metres
    np.testing.assert_allclose(found.position[0], [0.1, 0.2, 0.0])
    wrong = find_airframe(log_of(PARAMETERS), Vehicle(rotors=four[:3]))
    assert isinstance(wrong, Unknown)
    assert "4 [[rotor]] tables" in wrong.need


@pytest.mark.parametrize(
    ("name", "n_motors", "word"),
    [
        ("px4-1.14-octocoax-cubeorange-75s.ulg", 8, "8 rotors"),
        ("ac313-y6b-331s.bin", 6, "y6b"),
        ("ac41-quadplus-mission-113s.bin", 4, "quad plus"),
        ("ac30-quadV-underpowered.log", 4, "quad v"),
        ("ac311-quadx-nan.log", 4, "quad x"),
        ("ac33dev-erle-quadx-RATE50Hz-2015-03-31.bin", 4, "quad x"),
        ("ac34rc2-erlebrain3-quadx-265s.bin", 4, "quad x"),
        ("ac413-quadx-goodprop-hover1.bin", 4, "quad x"),
        ("px4-1.16-quad-v6c-indoor-85s.ulg", 4, "4 rotors"),
        ("px4-1.9-quad-escstatus-39s.ulg", 4, "quad x"),
        ("sdlog2-quad-70s.px4log", 8, "octaquad"),
    ],
)
def test_flown_logs_tell_their_airframe(corpus: Path, name: str, n_motors: int, word: str) -> None:
    """Number of motors and frame of the logs of the corpus."""
    model = load(corpus / "real" / name).log.torque
    assert model is not None
    assert model.n_rotors == n_motors
    assert word in model.frame


def test_a_log_that_cannot_tell_says_what_to_pass(corpus: Path) -> None:
    """Eight motors of an old build may be an octa or an octa-quad."""
    model = load(corpus / "real" / "ac301-octo-apm2-MOT.log").log.torque
    assert model is not None
    assert model.n_rotors == 0
    assert "[[rotor]]" in model.needs[0]
    assert "octa-quad" in model.remarks[0]


_CORRUPTED = st.one_of(st.floats(), st.sampled_from([1e300, -1e300, 0.0, 1.0, -1.0, 33.0]))


# A slow machine needs long for the first draws, the first of which imports the autopilots.
@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(
    st.dictionaries(
        st.sampled_from([*PARAMETERS, "FRAME", "Q_ENABLE", "RC3_MIN", "RCMAP_THROTTLE"]), _CORRUPTED
    )
)
def test_no_ardupilot_parameter_value_breaks_the_reconstruction(corrupted: dict[str, float]) -> None:
    """NaN, infinities and numbers of any size are caveats about the vehicle, never an exception."""
    log = ardupilot_log(parameters={**PARAMETERS, **corrupted}, n=200)
    assert prepare(log, Vehicle(mass_kg=2.0, arm_length_m=0.2)).log.torque is not None


@given(
    st.dictionaries(
        st.sampled_from([*rotors(4), "CA_ROTOR0_AX", "CA_ROTOR0_AZ", "SYS_AUTOSTART"]), _CORRUPTED
    )
)
def test_no_px4_parameter_value_breaks_the_reconstruction(corrupted: dict[str, float]) -> None:
    """The same for CA_ROTOR*."""
    model = prepare(log_of({**rotors(4), **corrupted}, "px4")).log.torque
    assert model is not None


def test_a_command_turns_a_vehicle_of_unequal_rotors_about_its_own_axis_only() -> None:
    """Rotors of 6 and 11 N at unequal arms: what each gives for the command, added up at its place."""
    known = rotors(6)
    thrust = np.array([6.0, 11.0, 8.0, 6.5, 10.0, 7.0])
    known |= {f"CA_ROTOR{number}_CT": float(value) for number, value in enumerate(thrust)}
    known["CA_ROTOR0_PX"] = 0.27
    found = find_airframe(log_of(known, "px4"))
    assert isinstance(found, Airframe)
    places = np.array([[known[f"CA_ROTOR{number}_P{axis}"] for axis in "XY"] for number in range(6)])
    ratio_m = np.array([known[f"CA_ROTOR{number}_KM"] for number in range(6)])
    given = thrust[:, np.newaxis] * found.factors
    turned = np.vstack([-places[:, 1], places[:, 0], ratio_m, np.ones(6)]) @ given
    np.testing.assert_allclose(turned - np.diag(np.diag(turned)), 0.0, atol=2e-2)
    assert (np.diag(turned) > [0.5, 0.5, 0.05, 30.0]).all()


@pytest.mark.parametrize(("vehicle_type", "kind"), [("rover", Unknown), ("multirotor", Airframe)])
def test_the_frame_class_of_a_rover_is_no_quad(vehicle_type: str, kind: type) -> None:
    """FRAME_CLASS 1 of a rover is a rover; `info` listed four motors."""
    log = log_of({"FRAME_CLASS": 1.0, "FRAME_TYPE": 0.0})
    assert isinstance(find_airframe(replace(log, vehicle_type=vehicle_type)), kind)
