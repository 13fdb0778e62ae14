"""Shows that the tests bite: breaks one line of what matters at a time, and counts who notices.

    python benchmarks/mutants.py

Each mutant is a copy of the project in which one line is wrong in a way that a reader may overlook.
The tests that should notice run first; if they do not, all tests of `make test` run. A mutant that
none of them kills is listed as alive.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

from results import ROOT, add_update_option, results


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """One wrong line.

    Attributes:
        name: what is wrong.
        file: of the package.
        old: text of the line, once in the file.
        new: what replaces it.
        first: tests that should notice.
    """

    name: str
    file: str
    old: str
    new: str
    first: tuple[str, ...]


MUTANTS: tuple[Mutant, ...] = ()


def copy_project(folder: Path) -> None:
    """Copies what git tracks; compiled code stays in the copy for all of its mutants."""
    files = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split("\0")
    for name in filter(None, files):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)


def who_kills(mutant: Mutant, folder: Path, *, everything: bool) -> str:
    """The first test that fails on a mutant, or an empty text."""
    file = folder / "selftouch_drake" / mutant.file
    right = file.read_text(encoding="utf-8")
    assert right.count(mutant.old) == 1, f"{mutant.file} has {mutant.old!r} not once"
    file.write_text(right.replace(mutant.old, mutant.new), encoding="utf-8")
    # Compiled callers in other files hold the right line.
    for compiled in (folder / "selftouch_drake").rglob("*.nb?"):
        compiled.unlink()
    try:
        for tests in (mutant.first, ("tests",))[: 1 + everything]:
            killer = _first_failure(folder, tests)
            if killer:
                return killer
    finally:
        file.write_text(right, encoding="utf-8")
    return ""


def _first_failure(folder: Path, tests: tuple[str, ...]) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-x", "-m", "not slow", "-p", "no:cacheprovider", *tests],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode == 0:
        return ""
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0].split(" - ")[0] if failed else f"exit {done.returncode}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", help="parts of the names of the mutants to try")
    parser.add_argument("--copies", type=int, default=2, help="mutants that are tried side by side")
    parser.add_argument("--near", action="store_true", help="run only the tests that should notice")
    add_update_option(parser, "mutants")
    options = parser.parse_args()
    tried = [m for m in MUTANTS if not options.only or any(o in m.name for o in options.only)]
    with (
        tempfile.TemporaryDirectory() as scratch,
        ThreadPoolExecutor(options.copies) as pool,
        results("mutants", update=options.update) as add,
    ):
        folders: Queue[Path] = Queue()
        for number in range(options.copies):
            copy_project(Path(scratch) / str(number))
            folders.put(Path(scratch) / str(number))

        def attempt(mutant: Mutant) -> str:
            folder = folders.get()
            try:
                return who_kills(mutant, folder, everything=not options.near)
            finally:
                folders.put(folder)

        killed = 0
        for mutant, killer in zip(tried, pool.map(attempt, tried), strict=True):
            killed += bool(killer)
            add({"mutant": mutant.name, "file": mutant.file, "killed_by": killer})
            print(f"{mutant.name}: {killer or 'ALIVE'}", flush=True)
    print(f"{killed} of {len(tried)} killed")


if __name__ == "__main__":
    main()
