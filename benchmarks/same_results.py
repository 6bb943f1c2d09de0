"""Hold what every log gives now against what it gave before: for changes that shall change no number.

    python benchmarks/same_results.py capture before/        # with the code before
    python benchmarks/same_results.py capture after/         # with the code after
    python benchmarks/same_results.py compare before/ after/ # exit code 1 where anything differs

The logs are those of QUADID_LOG_CORPUS and all scenarios of the simulator.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

CORPUS = Path(os.environ.get("QUADID_LOG_CORPUS", Path(__file__).parents[2] / "shared" / "logs"))
#: What differs from run to run.
_NOT_COMPARED = ("timings_s", "path", "tool", "provenance")
_COMMAND = [sys.executable, "-c", "import sys; from quadid_logs.cli import run; sys.exit(run())"]


def _logs(flown: Path) -> Iterator[Path]:
    """Fly every scenario into `flown`; yield those logs, then the corpus."""
    listed = subprocess.run([*_COMMAND, "simulate", "--list"], capture_output=True, text=True, check=True)
    for line in listed.stdout.splitlines():
        scenario = line.split()[0].rstrip(":")
        path = flown / f"{scenario}.bin"
        subprocess.run([*_COMMAND, "simulate", scenario, "-o", str(path)], capture_output=True, check=False)
        if path.exists():
            yield path
    for folder in ("firmware", "real", "damaged", "blackbox"):
        yield from sorted(p for p in (CORPUS / folder).glob("*") if not p.name.endswith(".truth.json"))


def _result(path: Path) -> object:
    """Return result.json of a log, or the exit code and the message of a log that cannot be read."""
    run = subprocess.run(
        [*_COMMAND, "analyze", str(path), "--json", "--no-report"],
        capture_output=True,
        text=True,
        check=False,
    )
    try:
        return {"exit": run.returncode, "result": json.loads(run.stdout)}
    except json.JSONDecodeError:
        return {"exit": run.returncode, "stderr": run.stderr.replace(str(path), path.name)}


def capture(folder: Path, *, n_workers: int) -> None:
    """Write the result of every log into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as flown, ThreadPoolExecutor(n_workers) as workers:
        paths = list(_logs(Path(flown)))
        for path, result in zip(paths, workers.map(_result, paths), strict=True):
            (folder / f"{path.name}.json").write_text(json.dumps(result, indent=1, sort_keys=True))


def _differences(before: object, after: object, at: str, relative: float) -> Iterator[str]:
    """Yield where two results differ: numbers by more than the relative tolerance, texts at all."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in sorted({*before, *after}):
            if key in _NOT_COMPARED:
                continue
            if key not in before or key not in after:
                yield f"{at}.{key}: only {'after' if key in after else 'before'}"
            else:
                yield from _differences(before[key], after[key], f"{at}.{key}", relative)
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            yield f"{at}: {len(before)} elements before, {len(after)} after"
        for i, (one, other) in enumerate(zip(before, after, strict=False)):
            yield from _differences(one, other, f"{at}[{i}]", relative)
    elif isinstance(before, float) and isinstance(after, int | float):
        if not math.isclose(before, after, rel_tol=relative, abs_tol=relative * 1e-3):
            yield f"{at}: {before!r} -> {after!r}"
    elif before != after:
        yield f"{at}: {before!r} -> {after!r}"


def compare(before: Path, after: Path, *, relative: float, most: int) -> int:
    """Print the differences; return how many logs differ."""
    n_different = 0
    names = sorted({p.name for p in before.glob("*.json")} | {p.name for p in after.glob("*.json")})
    for name in names:
        if not ((before / name).exists() and (after / name).exists()):
            print(f"{name}: only in one of the folders")
            n_different += 1
            continue
        found = list(
            _differences(
                json.loads((before / name).read_text()), json.loads((after / name).read_text()), "", relative
            )
        )
        if found:
            n_different += 1
            print(f"{name}: {len(found)} differences")
            for line in found[:most]:
                print(f"    {line[:300]}")
    print(f"{len(names)} logs compared, {n_different} differ")
    return n_different


def main() -> None:
    """Capture or compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    verbs = parser.add_subparsers(dest="verb", required=True)
    one = verbs.add_parser("capture")
    one.add_argument("folder", type=Path)
    one.add_argument("--workers", type=int, default=2)
    two = verbs.add_parser("compare")
    two.add_argument("before", type=Path)
    two.add_argument("after", type=Path)
    two.add_argument("--relative", type=float, default=1e-9)
    two.add_argument("--most", type=int, default=6)
    arguments = parser.parse_args()
    if arguments.verb == "capture":
        capture(arguments.folder, n_workers=arguments.workers)
    else:
        sys.exit(
            compare(arguments.before, arguments.after, relative=arguments.relative, most=arguments.most) > 0
        )


if __name__ == "__main__":
    main()
