"""From a file to a log with its torque: what the user chose and what the log tells reaches every stage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs import autopilots, pipeline
from quadid_logs.align import cut
from quadid_logs.data.settings import AlignSettings, Settings
from quadid_logs.errors import SettingsError
from quadid_logs.load import load, prepare, read_log
from quadid_logs.vocabulary import AXES
from tests.align.flights import flown
from tests.analyses import Analyzed
from tests.conftest import REPOSITORY
from tests.containers import mavlink_maker as make
from tests.directed_flights import SETTINGS

STAMPS = np.arange(10.0, 40.0, 0.0025)


@pytest.mark.parametrize(("loop_hz", "every"), [(400.0, True), (800.0, False), (None, False)])
def test_the_loops_rate_among_the_parameters_says_whether_each_step_was_logged(
    loop_hz: float | None, every: bool
) -> None:
    """SCHED_LOOP_RATE beside a torque at 400 Hz."""
    parameters = {} if loop_hz is None else {"SCHED_LOOP_RATE": loop_hz}
    log = replace(flown(STAMPS), parameters=parameters)
    given = cut(prepare(log), AlignSettings()).input
    assert given is not None
    assert given.every_step is every


def two_systems(folder: Path) -> Path:
    """Write the telemetry of two vehicles of one link; the first one says more."""
    content = b""
    for system, n_rows in ((1, 60), (7, 30)):
        sender = make.Sender(system)
        content += sender.heartbeat() + b"".join(sender.attitude(k) for k in range(n_rows))
    path = folder / "two.tlog"
    path.write_bytes(content)
    return path


def test_the_system_of_the_settings_is_read(tmp_path: Path) -> None:
    """And without one, that which says most."""
    path = two_systems(tmp_path)
    assert load(path, Settings(system=7)).log.vehicle_name == "system 7"
    assert load(path).log.vehicle_name == "system 1"
    with pytest.raises(SettingsError):
        load(path, Settings(system=3))


SAMPLES = REPOSITORY / "sample_logs"


@pytest.mark.parametrize(
    "name", ["sysid-quad-x.bin", "doublets.tlog", "products-of-inertia.ulg", "betaflight-doublets.bbl"]
)
def test_a_file_is_of_the_format_that_the_first_of_all_formats_makes_it(name: str) -> None:
    """Readers are asked one autopilot after the other, in the order of all formats."""
    head = (SAMPLES / name).read_bytes()[:4096]
    wanted = next(one for one in autopilots.formats() if one.is_mine(head))
    found = autopilots.format_of(head)
    assert found is not None
    assert (found.name, found.title) == (wanted.name, wanted.title)


def test_a_text_is_no_log_of_the_first_reader_that_could_read_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is told by its first bytes goes before what could be any text, whichever is asked first."""

    def named(name: str, *, strict: bool) -> object:
        made = autopilots.LogFormat(name, name, lambda _head: True, read_log, (".x",), strict=strict)
        return type(name, (autopilots.Autopilot,), {"name": name, "formats": lambda _self: (made,)})()

    monkeypatch.setattr(
        autopilots, "known", lambda: (named("loose", strict=False), named("sure", strict=True))
    )
    found = autopilots.format_of(b"Hello")
    assert found is not None
    assert found.name == "sure"


@pytest.mark.parametrize("name", ["sysid-quad-x.bin", "products-of-inertia.ulg", "betaflight-doublets.bbl"])
def test_the_controller_of_one_axis_is_that_of_three(name: str) -> None:
    """A search asks for one."""
    log = read_log(SAMPLES / name)
    autopilot = autopilots.named(log.autopilot)
    # Of Betaflight's, the sample holds none.
    parameters = {**log.parameters, **(SETTINGS if log.autopilot == "betaflight" else {})}
    whole = autopilot.controllers(log, parameters)
    assert whole is not None
    assert set(whole.axes) == set(AXES)
    for axis, one in whole.axes.items():
        alone = autopilot.controllers(log, parameters, axes=(axis,))
        assert alone is not None
        assert [*alone.axes] == [axis]
        assert alone.axes[axis].gains == one.gains
        assert np.array_equal(alone.axes[axis].error.numerator, one.error.numerator)


def test_no_verdict_rests_on_the_structures_of_the_paper(analyzed_once: Analyzed) -> None:
    """Tuning and a fleet's rows leave them out."""
    log = SAMPLES / "sysid-quad-x.bin"
    whole, short = analyzed_once(log), pipeline.analyze(log, published=False)
    assert {one.structure for one in short.identification.models} == {"damped", "rigid-body"}
    assert short.diagnosis.axes == whole.diagnosis.axes
    models = [one.identification.recommended for one in (short, whole)]
    assert models[0] is not None
    assert models[1] is not None
    assert np.array_equal(models[0].A, models[1].A)
    assert np.array_equal(models[0].B, models[1].B)
    assert models[0].parameters == models[1].parameters
