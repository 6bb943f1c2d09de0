"""One door for libraries that an installation may lack."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator

import pytest

from quadid_logs.errors import SettingsError
from quadid_logs.extra import load
from tests.conftest import REPOSITORY

PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
#: How a library is called where it is installed.
PACKAGES = {"serial": "pyserial"}


def asked() -> Iterator[tuple[str, str]]:
    """Yield what the package loads: the library and the extra that is named."""
    for path in sorted((REPOSITORY / "quadid_logs").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "quadid_logs.extra" not in text and "import extra" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and re.fullmatch(r"(extra\.)?load", ast.unparse(node.func)):
                words = [each.value for each in node.args if isinstance(each, ast.Constant)]
                if words and len(words) == len(node.args):
                    library = words[0].partition(".")[0]
                    yield PACKAGES.get(library, library), words[1] if len(words) > 1 else ""


@pytest.mark.parametrize(("package", "extra"), sorted(set(asked())))
def test_the_extra_that_is_named_installs_the_library(package: str, extra: str) -> None:
    """A hint that installs something else leads in a circle."""
    installed = PROJECT["optional-dependencies"][extra] if extra else PROJECT["dependencies"]
    assert package in {re.split(r"[^\w-]", each)[0] for each in installed}


def test_libraries_of_extras_and_of_every_installation_are_loaded() -> None:
    """Else the test above would hold nothing."""
    assert {"", "fleet", "mcp", "parquet", "python"} <= {extra for _package, extra in asked()}


@pytest.mark.parametrize(
    ("name", "extra", "hint"),
    [
        ("duckdb", "fleet", "pip install '.[fleet]'"),
        ("serial", "", "pip install pyserial"),
        ("pandas", "", "pip install pandas"),
    ],
)
def test_a_missing_library_is_one_line_that_says_how_to_install_it(
    name: str, extra: str, hint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No traceback of an import."""
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(SettingsError, match=f"{name} is not installed") as raised:
        load(name, extra)
    assert hint in raised.value.hint
