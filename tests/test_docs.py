"""The documentation says what the program says."""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from quadid_logs.data.catalogue import CATALOGUE

DOCS = Path(__file__).resolve().parents[1] / "docs"


@pytest.mark.parametrize("name", ["findings.md", "nomenclature.md"])
def test_a_generated_page_is_what_the_program_says(name: str) -> None:
    """Otherwise run: python docs/pages.py."""
    spec = importlib.util.spec_from_file_location("pages", DOCS / "pages.py")
    assert spec is not None
    assert spec.loader is not None
    pages = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(pages)
    assert (DOCS / name).read_text(encoding="utf-8") == pages.PAGES[name]()


def test_every_finding_that_the_code_raises_is_in_the_catalogue() -> None:
    """A code without an explanation would leave the pilot alone."""
    package = DOCS.parent / "quadid_logs"
    raised = {
        code
        for path in package.rglob("*.py")
        for code in CATALOGUE
        if f'"{code}"' in path.read_text(encoding="utf-8") and path.name != "catalogue.py"
    }
    assert raised == set(CATALOGUE)


def test_no_code_is_used_for_two_findings() -> None:
    """The later entry would silently replace the earlier one."""
    text = (DOCS.parent / "quadid_logs" / "data" / "catalogue.py").read_text(encoding="utf-8")
    codes = re.findall(r'^ +"(QL\d+)",$', text, flags=re.MULTILINE)
    assert len(codes) == len(set(codes)) == len(CATALOGUE)


@pytest.mark.parametrize("name", ["result.schema.json"])
def test_the_schema_is_valid_json(name: str) -> None:
    """It is published for programs."""
    assert json.loads((DOCS / name).read_text(encoding="utf-8"))["type"] == "object"


def test_the_template_of_an_autopilot_stands_in_the_docs() -> None:
    """The marker that includes it, letter by letter: a formatter of code blocks once took it for Python."""
    page = (DOCS / "extending.md").read_text(encoding="utf-8")
    included = re.findall(r'^--8<-- "(.+)"$', page, re.MULTILINE)
    assert included == ["tests/autopilots/toy.py"]
    assert (DOCS.parent / included[0]).is_file()


def test_the_term_of_the_page_is_one() -> None:
    """Its program is run as it stands: a structure with the new column among those of the package."""
    page = (DOCS / "extending.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    found: dict[str, Any] = {}
    exec(code, found)
    assert found["structure"].regressors == ("p", "q", "r", "qr", "pr", "pq", "1", "p|p|")


def console_pages() -> list[tuple[str, str]]:
    """Return every command that a tutorial shows, with its page."""
    spec = importlib.util.spec_from_file_location("console", DOCS / "console.py")
    assert spec is not None
    assert spec.loader is not None
    console = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(console)
    return [
        (name, command)
        for name in console.PAGES
        for command in console.commands_of((DOCS / name).read_text(encoding="utf-8"))
        if command.startswith("quadid-log ")
    ]


@pytest.mark.parametrize(("page", "command"), console_pages())
def test_the_commands_of_a_tutorial_are_those_of_the_program(page: str, command: str) -> None:
    """A renamed option would leave a reader alone; `make docs` runs them."""
    from quadid_logs.cli.app import command_of

    words = shlex.split(command.split(" | ")[0])[1:]
    verb = command_of().commands[words[0]]  # type: ignore[attr-defined]
    verb.make_context(words[0], words[1:])


def test_every_picture_of_the_pages_is_there_and_small() -> None:
    """Under 200 kB each."""
    for page in [DOCS.parent / "README.md", *DOCS.rglob("*.md")]:
        for target in re.findall(r"!\[[^\]]*\]\((?!https?:)([^)]+)\)", page.read_text(encoding="utf-8")):
            picture = page.parent / target
            assert picture.is_file(), f"{page.name}: {target}"
            assert picture.stat().st_size < 250_000, target
