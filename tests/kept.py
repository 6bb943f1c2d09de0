"""What takes long to work out and many tests need: made once for all test processes, kept for the next run.

It is kept in pytest's cache (`--cache-clear` empties that), in a folder named by the content of all code that
makes it: a changed line that could matter makes everything anew. Where that cache is switched off
(`-p no:cacheprovider`, as `benchmarks/mutation_check.py` does), nothing outlives the run.
"""

from __future__ import annotations

import ast
import hashlib
import os
import pickle
import platform
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Final, TypeVar

ROOT: Final = Path(__file__).resolve().parents[1]
#: After this the other process is taken for dead, and the work is done again [s].
_PATIENCE_S: Final = 120.0
_Made = TypeVar("_Made")
#: Those of this run by kind, for what no fixture reaches (`tests/conftest.py` fills it).
SHELVES: Final[dict[str, Shelf]] = {}


class Shelf:
    """Pickles that test processes share.

    Parameters
    ----------
    folder : Path
        Only written by tests: what lies there is unpickled.
    claims : Path
        Where a process says what it is making; ends with the run, so that no claim outlives a killed one.
    """

    def __init__(self, folder: Path, claims: Path) -> None:
        self._folder, self._claims = folder, claims
        claims.mkdir(parents=True, exist_ok=True)

    def get(self, key: bytes, make: Callable[[], _Made]) -> _Made:
        """Return what was kept under a key; else one process makes and keeps it, and the others wait."""
        name = hashlib.sha256(key).hexdigest()
        path, claim = self._folder / name, self._claims / name
        if not path.exists() and not _claimed(claim):
            _wait(path, claim)
        try:
            with suppress(FileNotFoundError, NotADirectoryError):
                return pickle.loads(path.read_bytes())  # type: ignore[no-any-return]
            made = make()
            self._keep(path, made)
        finally:
            claim.unlink(missing_ok=True)
        return made

    def _keep(self, path: Path, made: object) -> None:
        """Write it whole or not at all; a disk that is full, or that a test calls full, keeps nothing."""
        unfinished = path.with_suffix(f".{os.getpid()}")
        try:
            # Another run, of other code, may have cleared the folder meanwhile.
            self._folder.mkdir(parents=True, exist_ok=True)
            unfinished.write_bytes(pickle.dumps(made, pickle.HIGHEST_PROTOCOL))
            unfinished.replace(path)
        except OSError:
            with suppress(OSError):
                unfinished.unlink(missing_ok=True)


def _claimed(claim: Path) -> bool:
    """Say whether this process is the one to make it."""
    try:
        claim.touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def _wait(path: Path, claim: Path) -> None:
    """Wait until the process with the claim has kept its result or failed."""
    until = time.monotonic() + _PATIENCE_S
    while claim.exists() and not path.exists() and time.monotonic() < until:
        time.sleep(0.1)


def clear_others(folder: Path, kept: set[str]) -> None:
    """Delete what other versions of the code made."""
    for old in folder.glob("*"):
        if old.name not in kept:
            shutil.rmtree(old, ignore_errors=True)


def code_key(*modules: str, root: Path = ROOT) -> str:
    """Return a hash of all that can decide what functions of these modules return.

    Their own text, that of every module of the package which they import, at any depth and in any function,
    the data files beside them, and the versions of Python and the libraries for numbers.
    """
    read = hashlib.sha256()
    for word in (platform.python_version(), platform.machine(), version("numpy"), version("scipy")):
        read.update(word.encode() + b"\0")
    paths = set(modules_behind(*modules, root=root).values())
    for folder in {path.parent for path in paths}:
        paths |= {path for path in folder.iterdir() if path.is_file() and path.suffix not in (".py", ".pyc")}
    for path in sorted(paths):
        read.update(path.relative_to(root).as_posix().encode() + b"\0")
        read.update(hashlib.sha256(path.read_bytes()).digest())
    return read.hexdigest()[:32]


def modules_behind(*modules: str, root: Path = ROOT) -> dict[str, Path]:
    """Return the files of modules and of what they import of the package, at any depth, by module."""
    found: dict[str, Path] = {}
    left, seen = list(modules), set[str]()
    while left:
        name = left.pop()
        if name in seen:
            continue
        seen.add(name)
        if (path := _file_of(name, root)) is None:
            continue
        found[name] = path
        left += [name.rpartition(".")[0], *_imports_of(path.read_bytes())]
        if name == "quadid_logs.autopilots":  # which imports its folders by their names
            left += [f"{name}.{folder.name}" for folder in path.parent.iterdir()]
        elif name.startswith("quadid_logs.autopilots.") and path.name == "__init__.py":  # by `entry`
            left += [f"{name}.{module.stem}" for module in path.parent.glob("*.py")]
    return found


def _file_of(module: str, root: Path) -> Path | None:
    place = root.joinpath(*module.split("."))
    paths = (place.with_suffix(".py"), place / "__init__.py")
    return next((path for path in paths if module and path.is_file()), None)


@cache
def _imports_of(source: bytes) -> tuple[str, ...]:
    """Return what a module imports; each is behind many others, and is parsed once."""
    return tuple(_imports(ast.parse(source)))


def _imports(node: ast.AST) -> Iterator[str]:
    """Yield every name of the package that is imported when the code runs."""
    # `TYPE_CHECKING` or `typing.TYPE_CHECKING`; to write every condition out takes longer than all else.
    if isinstance(node, ast.If) and "TYPE_CHECKING" in (
        getattr(node.test, "id", ""),
        getattr(node.test, "attr", ""),
    ):
        return
    if isinstance(node, ast.Import):
        yield from (each.name for each in node.names)
    elif isinstance(node, ast.ImportFrom):
        assert node.level == 0, "the package imports by full names"
        yield str(node.module)
        yield from (f"{node.module}.{each.name}" for each in node.names)
    # Statements lie in these alone, and no expression holds an import.
    for part in ("body", "orelse", "finalbody", "handlers", "cases"):
        inside = getattr(node, part, ())
        for child in inside if isinstance(inside, list) else ():
            yield from _imports(child)
