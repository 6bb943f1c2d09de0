"""Docstrings of the public API say what goes in and what comes out, by numpydoc's own validator."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import tomllib
from collections.abc import Iterator

from numpydoc.validate import validate

from tests.conftest import REPOSITORY

CONFIGURED = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
CHECKS = frozenset(CONFIGURED["numpydoc_validation"]["checks"])
#: Packages of which every exported function is checked.
EXPORTING = ("quadid_logs", "quadid_logs.figures", "quadid_logs.report")
#: Modules and packages of which every public function is checked.
WHOLE: tuple[str, ...] = (
    "quadid_logs.actuation",
    "quadid_logs.align",
    "quadid_logs.api",
    "quadid_logs.comparison",
    "quadid_logs.data",
    "quadid_logs.diagnose",
    "quadid_logs.identify",
    "quadid_logs.load",
    "quadid_logs.maths",
    "quadid_logs.notebook",
    "quadid_logs.output",
    "quadid_logs.pipeline",
    "quadid_logs.planning",
    "quadid_logs.report.html",
    "quadid_logs.report.model_files",
    "quadid_logs.report.series_file",
    "quadid_logs.report.view",
    "quadid_logs.untrusted",
    "quadid_logs.vehicle_file",
)


def exported(package: str) -> Iterator[str]:
    """Yield the functions that a package offers."""
    module = importlib.import_module(package)
    yield from (f"{package}.{name}" for name in module.__all__ if inspect.isfunction(getattr(module, name)))


def defined(place: str) -> Iterator[str]:
    """Yield the public functions that a module, or every module of a package, defines."""
    module = importlib.import_module(place)
    for found in pkgutil.iter_modules(getattr(module, "__path__", ()), f"{place}."):
        yield from defined(found.name)
    for name, value in vars(module).items():
        if inspect.isfunction(value) and value.__module__ == place and not name.startswith("_"):
            yield f"{place}.{name}"


NAMES = sorted(
    {name for package in EXPORTING for name in exported(package)}
    | {name for place in WHOLE for name in defined(place)}
)


def test_what_goes_in_and_what_comes_out_is_documented() -> None:
    """Parameters with their order, results, as pyproject.toml chooses."""
    errors = [
        f"{name}: {code}: {text}"
        for name in NAMES
        for code, text in validate(name)["errors"]
        if code in CHECKS
    ]
    assert not errors, "\n".join(errors)
