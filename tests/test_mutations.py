"""The lists of wrong changes fit the code that they change."""

from __future__ import annotations

import ast
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from benchmarks.mutation_check import LISTS, ROOT, Mutation, load_mutations

MUTATIONS = load_mutations(sorted(LISTS.glob("*.toml")))


@cache
def text_of(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


@cache
def tree_of(path: str) -> str:
    return ast.dump(ast.parse(text_of(path)))


@pytest.mark.source_text
@pytest.mark.parametrize("mutation", MUTATIONS, ids=[f"{one.file}: {one.why}" for one in MUTATIONS])
def test_a_wrong_change_applies_to_the_code_and_leaves_python(mutation: Mutation) -> None:
    """Its text is there exactly once, something changes, and the tests that should notice exist."""
    changed = mutation.applied(ROOT)
    if mutation.file.endswith(".py"):
        assert ast.dump(ast.parse(changed)) != tree_of(mutation.file)
    assert changed != text_of(mutation.file)
    assert mutation.tests
    for test in mutation.tests:
        path, *names = test.split("::")
        assert all(f"def {name}(" in text_of(path) for name in names) if names else (ROOT / path).exists()


def test_every_part_that_a_result_depends_on_has_its_mistakes() -> None:
    """At least so many of each: what nobody tried says nothing."""
    n_of_part = Counter(mutation.part for mutation in MUTATIONS)
    least = {"actuation": 12, "align": 10, "autopilots": 12, "containers": 12, "maths": 12}
    least |= {"identify": 22, "load": 2}
    assert all(n_of_part[part] >= count for part, count in least.items()), n_of_part


def test_no_mistake_is_listed_twice() -> None:
    """Or the count would be of fewer."""
    changes = [(one.file, one.old, one.new) for one in MUTATIONS]
    assert len(set(changes)) == len(changes)


def test_a_text_that_is_not_there_once_is_refused(tmp_path: Path) -> None:
    """A list that no longer fits the code must not count as caught."""
    (tmp_path / "code.py").write_text("a = 1\na = 1\n")
    for old in ("a = 1", "b = 1"):
        with pytest.raises(ValueError, match="not once"):
            Mutation("code.py", old, "a = 2", "another number", ("tests",)).applied(tmp_path)
