"""Fixtures shared by all tests."""

from __future__ import annotations

import compileall
import gc
import importlib
import os
import pickle
import shutil
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hypothesis
import pytest

from tests.kept import SHELVES, Shelf, clear_others, code_key
from tests.kept_stages import STAGES, inside, kept_stages, tell_inside, watch_patches

if TYPE_CHECKING:
    from tests.analyses import Analyzed

# As the command line does, and before anything imports numpy: several test processes with several
# threads each would mostly wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Where nothing compiled may be kept, each test process rewrites all tests, and each command that it starts
# compiles the package anew: a twentieth of all processor time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

REPOSITORY = Path(__file__).resolve().parents[1]

watch_patches()

# The same examples for the same code, so that what fails fails again; `make check-all` draws new ones.
# How long an example takes on a busy machine is nobody's claim.
hypothesis.settings.register_profile("reproducible", derandomize=True, deadline=None)
hypothesis.settings.register_profile("random", print_blob=True, deadline=None)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "reproducible"))


#: The test files that take longest, most first: what begins last decides when the suite ends.
LONGEST_FIRST = (
    "report/test_browser.py",
    "test_tuning.py",
    "fleet/test_run.py",
    "test_directions.py",
    "structural/test_effects.py",
    "control/test_replay.py",
    "test_corpus.py",
    "autopilots/test_betaflight_tuning.py",
    "identify/test_spectral_effects.py",
    "containers/test_dataflash.py",
    "cli/test_tune.py",
    "simulate/test_closed_loop.py",
    "cli/test_main.py",
    "serve/test_server.py",
    "test_figures.py",
    "diagnose/test_diagnose.py",
    "containers/test_legal_extremes.py",
    "test_scenarios.py",
    "cli/test_printed_commands.py",
    "autopilots/test_blackbox_family.py",
    "autopilots/test_betaflight_controller.py",
    "control/test_flexible_mode.py",
    "identify/test_identify.py",
    "cli/test_plan.py",
    "identify/test_yaw.py",
    "test_swing.py",
    "api/test_api.py",
    "test_doctests.py",
    "link/test_record.py",
    "containers/test_ulog.py",
    "health/test_rotors.py",
    "actuation/test_measured_speeds.py",
    "diagnose/test_gyro.py",
    "writers/test_dataflash.py",
    "maths/test_random_effect.py",
    "identify/test_horizons.py",
    "containers/test_usd.py",
    "cli/test_options.py",
    "writers/test_tlog.py",
    "identify/test_torque_path.py",
    "report/test_html.py",
    "agents/test_mcp.py",
    "test_tuning_refusals.py",
    "identify/test_actuator_model.py",
    "test_docs.py",
    "test_pool.py",
    "simulate/test_simulate.py",
    "api/test_verbs.py",
    "simulate/test_effects.py",
    "control/test_outer_loops.py",
    "control/test_simulated_controllers.py",
    "autopilots/test_sticks.py",
    "identify/test_rigid_body.py",
    "identify/test_spectral.py",
    "autopilots/test_flight_script.py",
    "actuation/test_reconstruct.py",
    "report/test_folder.py",
    "identify/test_thrust_curve.py",
    "cli/test_live.py",
    "writers/test_blackbox.py",
    "identify/test_planned.py",
    "test_live.py",
    "containers/test_tlog.py",
    "align/test_absurd_values.py",
    "autopilots/test_conformance.py",
    "actuation/test_airframe.py",
    "identify/test_single_tone.py",
    "test_methods.py",
    "test_flown_research.py",
    "autopilots/test_betaflight.py",
    "report/test_tune_browser.py",
    "containers/test_blackbox.py",
    "fleet/test_query.py",
    "autopilots/test_ardupilot.py",
    "autopilots/test_toy.py",
    "report/test_result_json.py",
    "cli/test_export.py",
    "identify/test_response.py",
    "fleet/test_changes.py",
    "test_output.py",
    "control/test_earlier_flights.py",
    "autopilots/test_batches.py",
)


def corpus_folder() -> Path:
    """Return where the flown and firmware-in-the-loop logs are, present or not."""
    default = REPOSITORY.parent / "shared" / "logs"
    return Path(os.environ.get("QUADID_LOG_CORPUS", default)).resolve()


def corpus_logs(*folders: str) -> list[str]:
    """Return every log of these folders by its path in the corpus, for parametrisation; none where absent."""
    found = [path for folder in folders for path in (corpus_folder() / folder).glob("*")]
    return sorted(f"{path.parent.name}/{path.name}" for path in found if path.suffix != ".json")


def has_corpus() -> bool:
    """Say whether the logs are there."""
    return (corpus_folder() / "firmware").is_dir()


def pytest_configure(config: pytest.Config) -> None:
    """Refuse to run where a corpus was named and is not there: its tests would only seem to pass."""
    # Nothing that is collected is garbage; to look for some takes each process a second.
    gc.disable()
    # Several processes take the files as they are sorted here, not by their number of tests.
    config.option.loadscopereorder = False
    if "QUADID_LOG_CORPUS" in os.environ and not has_corpus():
        raise pytest.UsageError(f"QUADID_LOG_CORPUS names {corpus_folder()}, which holds no corpus of logs.")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what reads the corpus or draws examples, before `-m` chooses; sort files, the long ones first."""
    n_tests = Counter(item.path for item in items)
    places = {REPOSITORY / "tests" / name: place for place, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: (places.get(item.path, len(places)), -n_tests[item.path], str(item.path)))
    for item in items:
        if "corpus" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.corpus)
        if getattr(getattr(item, "obj", None), "is_hypothesis_test", False):
            item.add_marker(pytest.mark.property)


@pytest.fixture(scope="session")
def corpus() -> Path:
    """Return the folder of real logs; skip the test where none is expected."""
    if not has_corpus():
        pytest.skip(f"no log corpus at {corpus_folder()}; set QUADID_LOG_CORPUS to run this test")
    return corpus_folder()


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Let each of several processes compile another part first: in a fresh clone all would compile all."""
    config = session.config
    if not hasattr(config, "workerinput"):
        return
    number, count = int(config.workerinput["workerid"][2:]), int(config.workerinput["workercount"])
    for path in sorted(REPOSITORY.glob("quadid_logs/**/*.py"))[number::count]:
        compileall.compile_file(path, quiet=2)
    given = [(config.invocation_params.dir / name.split("::")[0]).resolve() for name in config.args]
    for path in sorted(REPOSITORY.glob("tests/**/test_*.py"))[number::count]:
        # Tests are rewritten, too, so that a failed assertion tells its values: importing them does both.
        # What cannot be imported is told of when it is collected.
        if any(path.is_relative_to(each) for each in given):
            with suppress(Exception, pytest.skip.Exception):
                importlib.import_module(".".join(path.relative_to(REPOSITORY).with_suffix("").parts))


def pytest_xdist_auto_num_workers() -> int:
    """One process more than cores: tests of workers, servers and browsers mostly wait for these.

    Each more would cost nine seconds of a processor, to import libraries and collect all tests once more.
    """
    return (os.cpu_count() or 1) + 1


#: What is kept for all test processes, and the module that makes it.
KEPT = {
    "analyses": "quadid_logs.pipeline",
    "flights": "quadid_logs.simulator.closed_loop",
    "tuned": "tests.tuned_flights",
    "vehicles": "tests.identify.vehicles",
    **STAGES,
}


def cache_folder(config: pytest.Config) -> Path | None:
    """Return our part of pytest's cache; None where that is switched off or cannot be written."""
    cache = getattr(config, "cache", None)
    try:
        return cache.mkdir("kept") if cache else None
    except OSError:
        return None


_FOLDERS = pytest.StashKey[dict[str, str]]()


def kept_folders(config: pytest.Config) -> dict[str, str]:
    """Return the folder of each kind, named by the content of the code that fills it; delete all others."""
    if hasattr(config, "workerinput"):
        tell_inside(config.workerinput["inside"])
        return dict(config.workerinput["kept_folders"])
    if _FOLDERS not in config.stash:
        config.stash[_FOLDERS] = {kind: f"{kind}-{code_key(module)}" for kind, module in KEPT.items()}
        if folder := cache_folder(config):
            clear_others(folder, set(config.stash[_FOLDERS].values()))
    return config.stash[_FOLDERS]


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Read the code once, not in each test process."""
    node.workerinput["kept_folders"] = kept_folders(node.config)
    node.workerinput["inside"] = sorted(inside())


@pytest.fixture(scope="session")
def shelves(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> dict[str, Shelf]:
    """Return where analyses and flights are kept: in pytest's cache if it is on, else for this run."""
    own, config = tmp_path_factory.getbasetemp(), request.config
    # The folders of the workers lie beside each other.
    of_run = (own.parent if hasattr(config, "workerinput") else own) / "kept"
    folder = cache_folder(config) or of_run
    names = kept_folders(config)
    SHELVES.update({kind: Shelf(folder / name, of_run / f"claims-{kind}") for kind, name in names.items()})
    return SHELVES


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Delete what was kept for this run only, up to a gigabyte, when the last process is done."""
    if not hasattr(session.config, "workerinput"):
        base = session.config._tmp_path_factory._basetemp  # type: ignore[attr-defined]
        if base is not None:
            shutil.rmtree(base / "kept", ignore_errors=True)


@pytest.fixture(scope="session")
def analyzed_once(shelves: dict[str, Shelf]) -> Analyzed:
    """Return `analyze`, which makes each analysis once for all test processes, for logs that tests write."""
    from tests.analyses import shared_analyses

    return shared_analyses(shelves["analyses"])


@pytest.fixture(scope="session")
def analyzed(corpus: Path, analyzed_once: Analyzed) -> Analyzed:
    """Return the same for logs of the corpus."""
    return analyzed_once


@pytest.fixture(scope="session", autouse=True)
def kept_flights(shelves: dict[str, Shelf]) -> Iterator[None]:
    """Let the simulator fly no flight twice; its own tests fly each time (`tests/simulate/conftest.py`)."""
    from quadid_logs.simulator import closed_loop

    fly = closed_loop._fly

    @wraps(fly)
    def kept(*arguments: Any) -> Any:
        return shelves["flights"].get(pickle.dumps(arguments), lambda: fly(*arguments))

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(closed_loop, "_fly", kept)
        yield


@pytest.fixture(scope="session", autouse=True)
def stages_once(shelves: dict[str, Shelf]) -> Iterator[None]:
    """Identify no flight, close no loop and tune no axis twice (`tests/kept_stages.py`)."""
    with kept_stages(shelves):
        yield


@pytest.fixture(scope="module")
def quick_multisines() -> Iterator[None]:
    """Search for low peaks from one start and not from several, for tests to which any multisine will do."""
    from quadid_logs.maths import multisine

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(multisine, "_STARTS", 0)
        multisine.orthogonal.cache_clear()
        yield
    multisine.orthogonal.cache_clear()


@pytest.fixture(scope="module")
def verdicts_only() -> Iterator[None]:
    """Work out what verdicts rest on and no more, for tests that look at no margins and no published models.

    Not beside `analyzed`, whose results others share.
    """
    from quadid_logs import pipeline

    judge = pipeline.judge

    @wraps(judge)
    def quick(*given: Any, **named: Any) -> Any:
        return judge(*given, **{**named, "published": False, "loop": "verdict"})

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(pipeline, "judge", quick)
        yield


@pytest.fixture
def corpus_log(corpus: Path, request: pytest.FixtureRequest) -> Path:
    """Return one log of the corpus, named by indirect parametrisation."""
    path = corpus / str(request.param)
    if not path.exists():
        pytest.fail(f"{path} is missing from the log corpus")
    return path


def pytest_collection_finish() -> None:
    """Take what thousands of collected tests are made of for no garbage: each look through it takes long.

    Look for garbage a seventh as often, too: simulated flights make millions of tuples, and no cycles.
    """
    gc.freeze()
    gc.set_threshold(5_000)
    gc.enable()
