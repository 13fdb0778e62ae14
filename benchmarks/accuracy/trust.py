"""Trust in a recovered shape: scatter between networks, and the agent's own estimate.

    python benchmarks/accuracy/trust.py luck --out runs/trust
    python benchmarks/accuracy/trust.py confidence --out runs/trust

`luck` recovers seven bodies, three of them felt through worn skins, with twenty network seeds each.
`confidence` recovers bodies from few and many touches and targets, through good and bad skins, with
6 to 16 joints, and sets the error that the agent expects beside the true one.

Runs that are missing are babbled into the folder `--out`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from selftouch_drake.agent.shape.recovery import MOST_ERROR
from selftouch_drake.experiment import load_experiment
from selftouch_drake.show.style import GREEN, INK, ORANGE, styled

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.accuracy.joints import experiment_file
from benchmarks.accuracy.shape import Case, measure, read
from benchmarks.shared.babbled import babbled
from benchmarks.shared.results import results

#: Touches that a run has; cases take some of the first.
MOST_TOUCHES = 400_000

#: Bodies, skins and seeds of the touches. No method was chosen on them but on the worn torus of
#: seed 922, which decided how holes are counted.
LUCK = (
    ("sphere", "whole", 921),
    ("cube", "whole", 921),
    ("torus", "whole", 923),
    ("double_torus", "whole", 921),
    ("cube", "worn", 922),
    ("torus", "worn", 922),
    ("torus", "worn", 931),
)

#: What `confidence` recovers: bodies, skins, touches and targets, drawn at random, and whether the
#: agent's expectation was calibrated on them.
CASES = Path(__file__).with_name("confidence_cases.csv")

#: A shape with a larger error is wrong, and so is one with other holes.
WRONG = 0.06
HOLES = {"sphere": "1 0 1", "cube": "1 0 1", "torus": "1 2 1", "double_torus": "1 4 1"}


def luck(arguments: argparse.Namespace) -> None:
    networks = [("learned", 10 * number) for number in range(arguments.networks)]
    columns = ("body", "skin", "seed", "networks", "shape error, median / worst")
    print("|", " | ".join([*columns, "error from the surface, median / worst", "holes"]), "|")
    print("|---" * 7 + "|")
    with results("luck", update=arguments.update) as add:
        for body, skin, seed in LUCK[: arguments.cases]:
            size = {"seed": seed, "babbling": {"num_samples": arguments.touches}}
            run = babbled(arguments.out / f"{body}_{seed}", load_experiment(body, size))
            case = Case.of(run, skin=skin, samples=arguments.touches, targets=arguments.targets)
            found = measure(run, [case], networks, add)
            holes = "; ".join(f"{b} ({sum(r['betti'] == b for r in found)})" for b in _sets(found))
            (error, worst), surface = (_scatter(found, name) for name in ("error", "surface_error"))
            print(
                f"| {body} | {skin} | {seed} | {len(found)} | {error:.1%} / {worst:.1%} "
                f"| {surface[0]:.1%} / {surface[1]:.1%} | {holes} |",
                flush=True,
            )


def _scatter(found: list[dict[str, str]], name: str) -> tuple[float, float]:
    """Median and worst."""
    values = [float(row[name]) for row in found]
    return float(np.median(values)), max(values)


def _sets(found: list[dict[str, str]]) -> list[str]:
    """The numbers of holes found, the most frequent first."""
    betti = [row["betti"] for row in found]
    return sorted(set(betti), key=lambda one: -betti.count(one))


def confidence(arguments: argparse.Namespace) -> None:
    found = []
    with results("confidence", update=arguments.update) as add:
        for row in read(CASES)[: arguments.cases]:
            body, seed = row["body"], int(row["seed"])
            size = {"seed": seed, "babbling": {"num_samples": arguments.touches}}
            source = body
            if body.startswith("joints_"):
                source = experiment_file(arguments.out, int(body.removeprefix("joints_")))
            run = babbled(arguments.out / f"{body}_{seed}", load_experiment(source, size))
            case = Case.of(
                run,
                skin=row["skin"],
                samples=int(row["samples"]),
                targets=int(row["targets"]),
            )
            found += measure(run, [case], [("learned", 0)], add)
    if len(found) == len(read(CASES)):
        print(verdict(found))


def verdict(rows: list[dict[str, str]]) -> str:
    """Quality of the expected error, on the calibration runs and on others."""
    lines = [
        "| runs | number | rank correlation | trusted | wrong among them | wrong in all |",
        "|---|---|---|---|---|---|",
    ]
    for name, some in _by_use(rows).items():
        error, expected, right, trusted = _columns(some)
        wrong = (error > WRONG) | ~right
        correlation, _ = spearmanr(error, expected, nan_policy="omit")
        lines.append(
            f"| {name} | {len(some)} | {correlation:.2f} | {trusted.sum()} "
            f"| {(wrong & trusted).sum()} | {wrong.sum()} |"
        )
    return "\n".join(lines)


@styled
def picture(rows: list[dict[str, str]]) -> Figure:
    """True error over the error that the agent expects, one point per run."""
    figure = Figure(figsize=(8.4, 3.9), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for ax, (name, some) in zip(panels, _by_use(rows).items(), strict=True):
        error, expected, right, trusted = _columns(some)
        for chosen, color, label in (
            (right, GREEN, "holes right"),
            (~right, ORANGE, "holes wrong"),
        ):
            for kind, face in ((trusted, color), (~trusted, "none")):
                here = chosen & kind
                ax.scatter(
                    100 * expected[here],
                    100 * error[here],
                    s=22,
                    facecolors=face,
                    edgecolors=color,
                    label=f"{label}, {'trusted' if kind is trusted else 'not trusted'}",
                )
        ax.plot([0.5, 30], [0.5, 30], color=INK, linewidth=0.8)
        ax.axvline(100 * MOST_ERROR, color=INK, linestyle=":", linewidth=0.8)
        ax.axhline(100 * WRONG, color=INK, linestyle=":", linewidth=0.8)
        ticks = [0.7, 1, 1.5, 2, 3, 4, 6, 9, 15, 25]
        ax.set(xscale="log", yscale="log", title=name)
        ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        ax.set_xticks([], minor=True)
        ax.set_yticks([], minor=True)
        ax.set(xlabel="error that the agent expects (%)")
        # Whatever the table holds is shown.
        for both, values in ((ax.set_xlim, _columns(rows)[1]), (ax.set_ylim, _columns(rows)[0])):
            both(90 * np.nanmin(values), 110 * np.nanmax(values))
    panels[0].set(ylabel="shape error (% of the extent)")
    panels[1].legend(loc="upper left")
    return figure


def _by_use(rows: list[dict[str, str]]) -> dict[str, list[dict[str, str]]]:
    """Rows used for calibration, and rows for the test."""
    use = {_case(row): row["use"] for row in read(CASES)}
    return {
        name: [row for row in rows if use.get(_case(row)) == name]
        for name in ("calibration", "judged")
    }


def _case(row: dict[str, str]) -> tuple[str, ...]:
    return tuple(row[name] for name in ("body", "seed", "skin", "samples", "targets"))


def _columns(rows: list[dict[str, str]]) -> tuple[np.ndarray, ...]:
    """Error, expected error or nan, whether the holes are right, and whether they are trusted."""
    error = np.array([float(row["surface_error"]) for row in rows])
    expected = np.array([float(row["expected_error"]) for row in rows])
    right = np.array([row["betti"] == HOLES.get(row["body"], HOLES["torus"]) for row in rows])
    trusted = np.array([row["trusted"] == "True" for row in rows])
    return error, expected, right, trusted


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["luck", "confidence"])
    parser.add_argument("--out", type=Path, default=Path("runs/trust"))
    parser.add_argument("--networks", type=int, default=20, help="network seeds, of luck")
    parser.add_argument("--touches", type=int, default=MOST_TOUCHES, help="of each run")
    parser.add_argument("--cases", type=int, help="the first so many bodies; by default all")
    parser.add_argument("--targets", type=int, default=1000, help="of luck")
    parser.add_argument("--update", action="store_true", help="replace the table in docs/data")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    (luck if arguments.what == "luck" else confidence)(arguments)


if __name__ == "__main__":
    main()
