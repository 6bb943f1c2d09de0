"""What is kept between test runs is never that of other code."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from quadid_logs import pipeline
from quadid_logs.control import recommend
from tests.conftest import KEPT, REPOSITORY
from tests.kept import Shelf, clear_others, code_key, modules_behind
from tests.kept_stages import content_key, is_patched


@pytest.fixture
def shelf(tmp_path: Path) -> Shelf:
    """Return an empty one."""
    return Shelf(tmp_path / "shelf", tmp_path / "claims")


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Write a package: `a` imports `b` in a function and `c` for types alone, `b` has data beside it."""
    folder = tmp_path / "pack"
    (folder / "b").mkdir(parents=True)
    (folder / "__init__.py").touch()
    (folder / "a.py").write_text(
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from pack import c\n"
        "def work():\n    from pack.b import deep\n    return deep\n"
    )
    (folder / "b" / "__init__.py").write_text("deep = 1\n")
    (folder / "b" / "table.json").write_text("1")
    (folder / "c.py").write_text("never = 1\n")
    return tmp_path


def test_what_was_made_is_kept(shelf: Shelf) -> None:
    """By its key."""
    assert shelf.get(b"one", lambda: [1.0]) == [1.0]
    assert shelf.get(b"one", lambda: [2.0]) == [1.0]
    assert shelf.get(b"two", lambda: [2.0]) == [2.0]


def test_what_failed_is_made_again(shelf: Shelf) -> None:
    """And fails again, or does not."""
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            shelf.get(b"one", lambda: 1 // 0)
    assert shelf.get(b"one", lambda: 1) == 1


def test_what_cannot_be_kept_is_made_each_time(tmp_path: Path) -> None:
    """On a full disk, say; nothing is left half-written."""
    (tmp_path / "shelf").write_text("no folder")
    shelf = Shelf(tmp_path / "shelf", tmp_path / "claims")
    assert [shelf.get(b"one", lambda made=made: made) for made in (1, 2)] == [1, 2]


@pytest.mark.parametrize("changed", ["a.py", "b/__init__.py", "b/table.json", "__init__.py"])
def test_another_text_of_any_module_behind_is_another_key(package: Path, changed: str) -> None:
    """Imported at the top or in a function, and data beside it."""
    before = code_key("pack.a", root=package)
    path = package / "pack" / changed
    path.write_text(path.read_text() + " ")
    assert code_key("pack.a", root=package) != before


def test_what_is_imported_for_types_alone_changes_no_key(package: Path) -> None:
    """Or every change would make everything anew."""
    before = code_key("pack.a", root=package)
    (package / "pack" / "c.py").write_text("never = 2\n")
    assert code_key("pack.a", root=package) == before


_LOADED = """
import json, sys
from quadid_logs import load, pipeline
for path in sys.argv[1:]:
    load.read_log(path)
pipeline.analyze(path)
print(json.dumps([name for name in sys.modules if name.startswith("quadid_logs")]))
"""


def test_every_module_that_an_analysis_loads_is_behind_its_key() -> None:
    """Whichever way it is imported; a log of each container is read, and the last one analyzed."""
    names = ("sysid-quad-x.bin", "products-of-inertia.ulg", "betaflight-doublets.bbl", "doublets.tlog")
    logs = [REPOSITORY / "sample_logs" / name for name in names]
    done = subprocess.run(
        [sys.executable, "-c", _LOADED, *map(str, logs)], capture_output=True, text=True, check=True
    )
    assert set(json.loads(done.stdout)) <= modules_behind(KEPT["analyses"]).keys()


def test_what_other_code_made_is_deleted(tmp_path: Path) -> None:
    """Half a gigabyte each time."""
    for name in ("flights-new", "flights-old"):
        (tmp_path / name).mkdir()
    clear_others(tmp_path, {"flights-new"})
    assert [path.name for path in tmp_path.iterdir()] == ["flights-new"]


def _scaled(factor: float) -> Callable[[float], float]:
    def scaled(value: float) -> float:
        return factor * value

    return scaled


def test_a_copy_has_the_same_key_and_another_content_another() -> None:
    """Whether or not the parts of a thing are one object; a function counts with what it holds."""
    one = np.arange(3.0)
    copy = [np.arange(3.0), np.arange(3.0), _scaled(2.0)]
    assert content_key([one, one, _scaled(2.0)]) == content_key(copy)
    assert content_key([one, one, _scaled(2.0)]) != content_key([one, one, _scaled(3.0)])
    assert content_key([one, one + 1e-15, _scaled(2.0)]) != content_key(copy)


def test_a_log_under_another_name_is_identified_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a flight tells does not depend on where its log lay; its path and its times are its own."""
    sample = REPOSITORY / "sample_logs" / "default-logging.bin"
    path = tmp_path / "other.bin"
    path.write_bytes(sample.read_bytes())
    before = pipeline.analyze(sample)
    monkeypatch.setattr(Shelf, "_keep", lambda *_: pytest.fail("it was worked out again"))
    after = pipeline.analyze(path)
    assert after.log.path == str(path)
    assert content_key(after.identification) == content_key(before.identification)


def test_what_is_patched_is_worked_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """A module of a stage, or a class in it; and not only once."""
    assert not is_patched()
    monkeypatch.setattr(recommend._Search, "parameters", {})
    assert is_patched()
    monkeypatch.undo()
    assert not is_patched()
    monkeypatch.setattr(recommend, "MOST_UP", 3.0)
    assert is_patched()
