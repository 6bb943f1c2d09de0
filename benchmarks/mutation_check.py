"""Which of a list of plausible wrong changes the tests notice.

Run with ``python benchmarks/mutation_check.py [FILE.toml...]``; prints Markdown
tables. Each file of ``benchmarks/mutations/`` (all by default) lists changes of one
part of the package, one a table::

    [[mutation]]
    file = "quadid_logs/maths/band.py"           # what is changed
    old = "np.exp(-s * delay_s)"                 # text that stands there exactly once
    new = "np.exp(s * delay_s)"                  # what replaces it
    why = "delay and lead exchanged"             # the mistake, in a few words
    tests = ["tests/maths/test_band.py"]         # what should notice it, the quickest first
    survives = "why no test can notice it"       # only of those that nobody noticed

A mutation is one mistake that a tired person makes: a sign, a factor, an index, a
quantile, rows or columns taken wrongly. It changes a result and raises no error by
itself. Changes are made one at a time in a copy of the working tree; the tests
named run until the first failure (``--whole``: all tests where those pass), without
flown logs unless ``--corpus`` is given, and those that only `make check-all` runs too
unless ``--quick`` is. A survivor shows what no test holds: add the
test, not an exception.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final, Literal, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
LISTS: Final = ROOT / "benchmarks" / "mutations"
#: A change that lets the tests run that much longer has been noticed.
TIMEOUT_S: Final = 300.0

Outcome = Literal["caught", "survived", "hung"]


class Mutation(NamedTuple):
    """One wrong change, and the tests that should notice it."""

    file: str
    old: str
    new: str
    why: str
    tests: tuple[str, ...]
    survives: str = ""
    part: str = ""

    def applied(self, root: Path) -> str:
        """Return the changed text of its file.

        Raises
        ------
        ValueError
            If the text to replace is not there exactly once, or nothing would change.
        """
        text = (root / self.file).read_text(encoding="utf-8")
        if text.count(self.old) != 1 or self.old == self.new:
            raise ValueError(f"{self.file}: {self.old!r} is there {text.count(self.old)} times, not once.")
        return text.replace(self.old, self.new)


class Verdict(NamedTuple):
    """What the tests said to a mutation, and after how long."""

    mutation: Mutation
    outcome: Outcome
    seconds: float


def load_mutations(paths: Sequence[Path]) -> list[Mutation]:
    """Read lists of mutations."""
    return [
        Mutation(**{**entry, "tests": tuple(entry["tests"]), "part": path.stem})
        for path in paths
        for entry in tomllib.loads(path.read_text(encoding="utf-8"))["mutation"]
    ]


def copy_tree(target: Path) -> None:
    """Copy what git knows or would add, as it stands in the working tree."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    for name in listed.stdout.decode().rstrip("\0").split("\0"):
        if (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)


def _environment(tree: Path, corpus: str) -> dict[str, str]:
    """Let a test process import the copy, and find the corpus from there."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
    environment.pop("QUADID_LOG_CORPUS", None)
    return {**environment, "QUADID_LOG_CORPUS": str(Path(corpus).resolve())} if corpus else environment


def passes(
    tree: Path,
    tests: Sequence[str],
    corpus: str = "",
    timeout_s: float | None = TIMEOUT_S,
    *,
    quick: bool = False,
) -> bool | None:
    """Run tests in a copy until the first failure; None if they do not end.

    Raises
    ------
    RuntimeError
        If they cannot be run at all: a missing file, or a change that breaks an import.
    """
    # That the lists fit the code's text breaks with every change.
    chosen = ("-m", "not source_text and not thorough" if quick else "not source_text")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *chosen, *tests]
    try:
        done = subprocess.run(
            command,
            cwd=tree,
            env=_environment(tree, corpus),
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{' '.join(command)} cannot run:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.returncode == 0


def judge(mutation: Mutation, tree: Path, *, whole: bool, corpus: str = "", quick: bool = False) -> Verdict:
    """Change one file of a copy, run the tests, change it back."""
    path = tree / mutation.file
    intact, begin = path.read_text(encoding="utf-8"), time.perf_counter()
    try:
        _write_source(path, mutation.applied(tree))
        passed = passes(tree, mutation.tests, corpus, quick=quick)
        if passed and whole:
            passed = passes(tree, ["tests"], corpus, None, quick=quick)
    finally:
        _write_source(path, intact)
    outcome: Outcome = "hung" if passed is None else "survived" if passed else "caught"
    return Verdict(mutation, outcome, time.perf_counter() - begin)


def _write_source(path: Path, text: str) -> None:
    """Write a module and forget its compiled form: within a second, of equal length, it would be kept."""
    path.write_text(text, encoding="utf-8")
    Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)


def judge_all(
    mutations: Sequence[Mutation], *, n_workers: int, whole: bool, corpus: str = "", quick: bool = False
) -> Iterator[Verdict]:
    """Judge mutations in parallel, each worker in a copy of its own.

    Raises
    ------
    RuntimeError
        If a test that should notice a mutation fails without it.
    """
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(n_workers) as workers:
        trees: queue.SimpleQueue[Path] = queue.SimpleQueue()
        for number in range(n_workers):
            tree = Path(folder) / f"copy{number}"
            copy_tree(tree)
            trees.put(tree)
        tree = trees.get()
        named = sorted({test for mutation in mutations for test in mutation.tests})
        if not passes(tree, named, corpus, None, quick=quick):
            raise RuntimeError("The tests fail without any change.")
        trees.put(tree)

        def work(mutation: Mutation) -> Verdict:
            free = trees.get()
            try:
                return judge(mutation, free, whole=whole, corpus=corpus, quick=quick)
            finally:
                trees.put(free)

        yield from workers.map(work, mutations)


def table_of_parts(verdicts: Sequence[Verdict]) -> str:
    """Return how many mistakes of each part were caught, and the survivors with the reason."""
    lines = ["| part | mistakes | caught |", "|---|---|---|"]
    for part in sorted({verdict.mutation.part for verdict in verdicts}):
        own = [verdict for verdict in verdicts if verdict.mutation.part == part]
        lines.append(f"| {part} | {len(own)} | {sum(one.outcome != 'survived' for one in own)} |")
    survivors = [verdict.mutation for verdict in verdicts if verdict.outcome == "survived"]
    lines += [f"- `{one.file}`, {one.why}: {one.survives or 'not explained'}" for one in survivors]
    return "\n".join(lines)


def main() -> int:
    """Print the tables; 1 if fewer than 90 % were caught."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("lists", nargs="*", type=Path, help="lists of mutations; all by default")
    parser.add_argument("--only", default="", help="judge those whose file, text or reason contains this")
    parser.add_argument("--whole", action="store_true", help="all tests for those that the named ones miss")
    parser.add_argument(
        "--corpus", default="", help="folder of flown logs; without it their tests are left out"
    )
    parser.add_argument("--quick", action="store_true", help="only tests that `make test` runs")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    mutations = [
        mutation
        for mutation in load_mutations(options.lists or sorted(LISTS.glob("*.toml")))
        if any(options.only in text for text in mutation[:4])
    ]
    for mutation in mutations:
        mutation.applied(ROOT)
    verdicts = []
    print("| outcome | file | mistake | s |\n|---|---|---|---|", flush=True)
    for verdict in judge_all(
        mutations,
        n_workers=options.workers,
        whole=options.whole,
        corpus=options.corpus,
        quick=options.quick,
    ):
        verdicts.append(verdict)
        file = verdict.mutation.file.removeprefix("quadid_logs/")
        print(
            f"| {verdict.outcome} | `{file}` | {verdict.mutation.why} | {verdict.seconds:.0f} |", flush=True
        )
    n_caught = sum(verdict.outcome != "survived" for verdict in verdicts)
    print(f"\n{table_of_parts(verdicts)}\n\n{n_caught} of {len(verdicts)} caught.")
    return 0 if n_caught >= 0.9 * len(verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
