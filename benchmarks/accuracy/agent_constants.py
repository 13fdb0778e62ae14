"""Which of the agent's own constants change anything: each is doubled and halved.

    python benchmarks/accuracy/agent_constants.py
    python benchmarks/accuracy/agent_constants.py --only shape lifelong.alarm
    python benchmarks/accuracy/agent_constants.py --list

Every value is tried in a process of its own, in which the module is loaded with the other number in
its source. So it holds in default arguments, in constants that follow from it, and in what numba
compiles. Each part of the agent has a small experiment (`TRIALS`). A row of the table is one value
of one constant: whether all arrays of its experiment have the same bytes as with the constant as it
is, how many of them differ, and the first metrics that do, with their values before and after.

A constant of which both rows say `same` is one on which these experiments do not depend; it may
still guard against input that none of them holds. Sizes of blocks of work change no result.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.accuracy import agent_trials
from benchmarks.shared.numbers_in_source import Changed, Constant, constants
from benchmarks.shared.results import ROOT, add_update_option, results


def digests(found: agent_trials.Results) -> dict[str, Any]:
    """Numbers as they are, and what stands for the bytes of each array."""
    plain: dict[str, Any] = {}
    for name, value in found.items():
        array = np.asarray(value)
        if array.ndim == 0 and array.dtype.kind in "iufb":
            plain[name] = array.item()
        else:
            text = np.ascontiguousarray(array)
            plain[name] = hashlib.sha256(text.tobytes() + str(text.shape).encode()).hexdigest()[:12]
    return plain


def run_here(trial: str, change: str | None) -> None:
    """Prints the digests of a trial, with the constant changed as the text says."""
    if change:
        module, name, value = json.loads(change)
        value = tuple(map(_as_tuple, value)) if isinstance(value, list) else value
        sys.meta_path.insert(0, Changed(module, name, value))
    warnings.simplefilter("ignore")
    print(json.dumps(digests(getattr(agent_trials, trial)())))


def _as_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def run(trial: str, folder: Path, constant: Constant | None = None, value: Any = None) -> Any:
    """The digests of a trial in a process of its own; a text says what went wrong."""
    command = [sys.executable, __file__, "--trial", trial]
    environment = os.environ | {"SELFTOUCH_TRIALS": str(folder), "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as cache:
        if constant is not None:
            command += ["--change", json.dumps([constant.module, constant.name, value])]
            if constant.is_compiled:
                environment["NUMBA_CACHE_DIR"] = cache
        try:
            done = subprocess.run(
                command,
                env=environment,
                cwd=ROOT,
                capture_output=True,
                text=True,
                check=False,
                timeout=600,
            )
        except subprocess.TimeoutExpired:
            return "takes more than 600 s"
    if done.returncode:
        return done.stderr.strip().splitlines()[-1][:100]
    return json.loads(done.stdout.strip().splitlines()[-1])


def compared(before: dict[str, Any], after: Any) -> dict[str, Any]:
    """The part of a row that says what changed."""
    if isinstance(after, str):
        return {"same": False, "differ": "", "metrics": after}
    names = sorted(before.keys() | after.keys())
    differ = [name for name in names if before.get(name) != after.get(name)]
    numbers = [name for name in differ if not isinstance(before.get(name, ""), str)]
    text = "; ".join(
        f"{name} {before[name]:.4g} -> {after[name]:.4g}" for name in numbers[:3] if name in after
    )
    return {"same": not differ, "differ": f"{len(differ)} of {len(names)}", "metrics": text}


def rows(chosen: Sequence[Constant], folder: Path) -> Iterator[dict[str, Any]]:
    """Two rows for each constant that has an experiment."""
    before: dict[str, Any] = {}
    for constant in chosen:
        trial = agent_trials.trial_of(constant.module)
        if trial is None:
            continue
        name = trial.__name__
        if name not in before:
            before[name] = run(name, folder)
            if isinstance(before[name], str):
                raise SystemExit(f"the trial {name} fails as it is: {before[name]}")
        for factor in (0.5, 2.0):
            value = constant.times(factor)
            row = {"constant": str(constant), "is": constant.value, "value": value, "trial": name}
            if value == constant.value:
                yield row | {"same": True, "differ": "", "metrics": "the same number"}
            else:
                yield row | compared(before[name], run(name, folder, constant, value))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", default=[], help="constants, modules or rooms")
    parser.add_argument("--list", action="store_true", help="only print them")
    parser.add_argument("--trial", help=argparse.SUPPRESS)
    parser.add_argument("--change", help=argparse.SUPPRESS)
    add_update_option(parser, "agent_constants")
    options = parser.parse_args()
    if options.trial:
        run_here(options.trial, options.change)
        return
    chosen = [
        constant
        for constant in constants()
        if not options.only or any(f"{constant}.".startswith(f"{start}.") for start in options.only)
    ]
    if options.list:
        for constant in chosen:
            trial = agent_trials.trial_of(constant.module)
            print(constant, constant.value, trial.__name__ if trial else "no trial", sep="\t")
        return
    with (
        tempfile.TemporaryDirectory() as folder,
        results("agent_constants", update=options.update) as add,
    ):
        for row in rows(chosen, Path(folder)):
            add(row)
            print(*row.values(), sep="\t", flush=True)


if __name__ == "__main__":
    main()
