"""Motions between random pairs of sensations, scored. Run it as a script.

Prints a column for each run, which must have learned; the table stands in docs/planning.md. What
`selftouch evaluate` does besides, the shape by every metric, is left out.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.motions import World
from selftouch_drake.run.trials import score_motions
from selftouch_drake.show import readings


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="+", help="runs that have learned")
    parser.add_argument("--pairs", type=int, default=200)
    arguments = parser.parse_args()
    columns = {}
    for path in arguments.runs:
        run = RunDirectory.open(path)
        experiment = dataclasses.replace(
            run.experiment, evaluation=dataclasses.replace(run.experiment.evaluation)
        )
        experiment.evaluation.num_pairs = arguments.pairs
        run = RunDirectory(run.path, experiment)
        figures = score_motions(run, World(experiment), lambda fraction, doing: None)
        columns[path.name] = {
            reading.key: reading.value for stage in readings(figures).values() for reading in stage
        }
    keys = list(dict.fromkeys(key for column in columns.values() for key in column))
    print(f"| figure | {' | '.join(columns)} |")
    print("|---" * (len(columns) + 1) + "|")
    for key in keys:
        print(f"| `{key}` | {' | '.join(column.get(key, '') for column in columns.values())} |")


if __name__ == "__main__":
    main()
