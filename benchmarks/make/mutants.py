"""Shows that the tests bite: breaks one line of what matters at a time, and counts who notices.

    python benchmarks/make/mutants.py

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

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.results import ROOT, add_update_option, results


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


MUTANTS = (
    Mutant(
        name="force: pressure at a corner, not at the centroid",
        file="robot/hydroelastic.py",
        old="pressure += g[tet, i] * place[i]",
        new="pressure += g[tet, i] * p[a, i]",
        first=("tests/robot/test_hydroelastic.py",),
    ),
    Mutant(
        name="force: a tenth too strong",
        file="robot/hydroelastic.py",
        old="force = piece[0] * mesh.areas[face] * pressure",
        new="force = 1.1 * piece[0] * mesh.areas[face] * pressure",
        first=("tests/robot/test_hydroelastic.py",),
    ),
    Mutant(
        name="force: the wrong side of a cut",
        file="robot/hydroelastic.py",
        old="share = h / (h - h0)",
        new="share = h0 / (h0 - h)",
        first=("tests/robot/test_hydroelastic.py",),
    ),
    Mutant(
        name="receptor weights: fields fall less steeply",
        file="geometry/receptors.py",
        old="bump = np.square(np.maximum(1 - np.square(distance.data / radius), 0))",
        new="bump = np.maximum(1 - np.square(distance.data / radius), 0)",
        first=("tests/geometry/test_receptors.py", "tests/robot/test_sensor.py"),
    ),
    Mutant(
        name="receptor weights: do not add up to one",
        file="geometry/receptors.py",
        old="vertex_weights.data /= np.repeat(total, np.diff(vertex_weights.indptr))",
        new="vertex_weights.data /= total.max()",
        first=("tests/geometry/test_receptors.py",),
    ),
    Mutant(
        name="frames: a joint turns the other way",
        file="robot/kinematics.py",
        old="c, s, shift = (np.cos(q), np.sin(q), 0.0)",
        new="c, s, shift = (np.cos(q), -np.sin(q), 0.0)",
        first=("tests/robot/test_kinematics.py",),
    ),
    Mutant(
        name="frames: a pose is not taken relative to the skin",
        file="robot/hydroelastic.py",
        old="away = X_WL[row, b, k, j] - (X_WL[row, a, k, 3] if j == 3 else 0.0)",
        new="away = X_WL[row, b, k, j]",
        first=("tests/robot/test_hydroelastic.py",),
    ),
    Mutant(
        name="walk: velocity is forgotten more",
        file="experience/walk.py",
        old="velocity[j] = q[n, j] + persistence * velocity[j]",
        new="velocity[j] = q[n, j] + 0.9 * persistence * velocity[j]",
        first=("tests/experience/test_walk.py",),
    ),
    Mutant(
        name="quantile: nearest distances at the median",
        file="quotient/distances.py",
        old="quantile(near, 0.1)",
        new="quantile(near, 0.5)",
        first=("tests/quotient/test_distances.py",),
    ),
    Mutant(
        name="quantisation: targets keep the strength of a touch",
        file="quotient/sensations.py",
        old="points = unit(sensation)",
        new="points = np.asarray(sensation, dtype=np.float32)",
        first=("tests/quotient/test_sensations.py",),
    ),
    Mutant(
        name="neighbours: sensations do not count",
        file="quotient/graph.py",
        old="distance = set_distance * np.sqrt(cdist(targets, targets))",
        new="distance = set_distance.copy()",
        first=("tests/quotient/test_graph.py",),
    ),
    Mutant(
        name="links: leap twice as far",
        file="quotient/links.py",
        old="LINK_SPACINGS = 1.5",
        new="LINK_SPACINGS = 3.0",
        first=("tests/quotient/test_links.py", "tests/agent/planning"),
    ),
    Mutant(
        name="parts: the second part joins the first",
        file="agent/representation/learning.py",
        old="combined[part[:, None] != part] = np.inf",
        new="combined[np.tril(part[:, None] != part, -2)] = np.inf",
        first=("tests/agent/representation/test_learner.py",),
    ),
    Mutant(
        name="rims: half the threshold",
        file="agent/shape/metrics.py",
        old="_RINGS, _OVER_NOISE = 2, 1.5",
        new="_RINGS, _OVER_NOISE = 2, 0.75",
        first=("tests/agent/shape/test_metrics.py",),
    ),
    Mutant(
        name="networks: a bad one is never noticed",
        file="agent/shape/metrics.py",
        old="_MOST_APART = 0.07",
        new="_MOST_APART = 1.2",
        first=("tests/agent/shape/test_metrics.py",),
    ),
    Mutant(
        name="homology: margins twice as large",
        file="quotient/holes.py",
        old="margin = shortest / max(float(below[cut]), longest_gap, _NO_LENGTH)",
        new="margin = 2 * shortest / max(float(below[cut]), longest_gap, _NO_LENGTH)",
        first=("tests/quotient/test_holes.py",),
    ),
    Mutant(
        name="homology: loops that close late count",
        file="quotient/holes.py",
        old="return early & ~gap & (length >= least), margin",
        new="return early & (length >= least), margin",
        first=("tests/quotient/test_holes.py",),
    ),
    Mutant(
        name="expected error: too sure",
        file="agent/shape/recovery.py",
        old="= 2.48, (",
        new="= 1.88, (",
        first=("tests/agent/shape/test_confidence.py", "tests/acceptance/test_sphere.py"),
    ),
    Mutant(
        name="trust: whatever the margin of the holes",
        file="agent/shape/recovery.py",
        old="error < MOST_ERROR and margin >= LEAST_MARGIN",
        new="error < MOST_ERROR",
        first=("tests/agent/shape/test_confidence.py",),
    ),
    Mutant(
        name="headline: shape error divided by 1.1",
        file="evaluation/shape.py",
        old="/ pdist(positions).max())",
        new="/ pdist(positions).max() / 1.1)",
        first=("tests/evaluation/test_shape.py",),
    ),
    Mutant(
        name="penalty: leaps are hardly punished",
        file="quotient/links.py",
        old="LEAP_POWER = 16.0",
        new="LEAP_POWER = 2.0",
        first=("tests/quotient/test_links.py", "tests/agent/planning"),
    ),
    Mutant(
        name="smoothing: paths are far smoother than asked",
        file="quotient/smooth.py",
        old="KNOT_SPACING = 0.135",
        new="KNOT_SPACING = 0.4",
        first=("tests/quotient/test_smooth.py",),
    ),
    Mutant(
        name="reached: any sensation will do",
        file="agent/tries.py",
        old="return motion.plan.goal in felt_kernels(representation, felt[-1])",
        new="return bool(len(felt_kernels(representation, felt[-1])))",
        first=("tests/agent/test_tries.py",),
    ),
    Mutant(
        name="rehearsal: the last try is kept",
        file="agent/tries.py",
        old="return max(tries, key=lambda one: (one.reached, one.contact))",
        new="return tries[-1]",
        first=("tests/agent/test_tries.py",),
    ),
    Mutant(
        name="timing: limits are used whole",
        file="agent/planning/timing.py",
        old="LIMIT_SHARE = 0.8",
        new="LIMIT_SHARE = 1.2",
        first=("tests/agent/planning/test_timing.py",),
    ),
    Mutant(
        name="bending: out of the skin",
        file="agent/planning/touch_model.py",
        old="short = firm.clip(self.lightest, self.firmest) - firm",
        new="short = firm - firm.clip(self.lightest, self.firmest)",
        first=("tests/agent/planning/test_touch_model.py",),
    ),
    Mutant(
        name="servo: corrects to the wrong side",
        file="systems/touch_servo.py",
        old="aim = x - BANDWIDTH * PERIOD * off * across",
        new="aim = x + BANDWIDTH * PERIOD * off * across",
        first=("tests/systems/test_touch_servo.py",),
    ),
    Mutant(
        name="servo: its switch does nothing",
        file="agent/pilot.py",
        old="if self._touch_servo and practised and isinstance(self.body, ServoedBody):",
        new="if False:",
        first=("tests/run/test_acting.py",),
    ),
    Mutant(
        name="alarm: raised at 0.6 of the threshold",
        file="agent/lifelong/alarm.py",
        old="THRESHOLD = math.log(100_000 / _FALSE_ALARMS)",
        new="THRESHOLD = 0.6 * math.log(100_000 / _FALSE_ALARMS)",
        first=("tests/agent/lifelong",),
    ),
    Mutant(
        name="mending: the offset of a joint has the wrong sign",
        file="agent/lifelong/body_change.py",
        old="moved = q + self.offset",
        new="moved = q - self.offset",
        first=("tests/agent/lifelong",),
    ),
    Mutant(
        name="import: three standard deviations count as touch",
        file="agent/readings/baseline.py",
        old="_SILENCE = 6.0",
        new="_SILENCE = 3.0",
        first=("tests/agent/readings/test_baseline.py", "tests/run/test_imported.py"),
    ),
    Mutant(
        name="collisions: parts may overlap a centimetre more",
        file="robot/collisions.py",
        old="self._allowed - margin",
        new="self._allowed - margin + 0.01",
        first=("tests/robot/test_collisions.py",),
    ),
)


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
    # A mutant may never end: pytest then names the test that took too long.
    options = (
        "-x",
        "-m",
        "not slow",
        "-p",
        "no:cacheprovider",
        "--timeout",
        "300",
        "--timeout-method",
        "thread",
    )
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *tests],
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
