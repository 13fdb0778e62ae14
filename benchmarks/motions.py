"""Motions between random pairs of sensations, scored. Run it as a script.

Prints a column for each run, which must have learned; the table stands in docs/planning.md. What
`selftouch evaluate` does besides, the shape by every metric, is left out.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from selftouch_drake.run import stages
from selftouch_drake.run.artifacts import load_agent
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.metrics import readings
from selftouch_drake.run.trials import trial_metrics, try_pairs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="+", help="runs that have learned")
    parser.add_argument("--pairs", type=int, default=200, help="of start and goal, in each run")
    arguments = parser.parse_args()
    columns = {}
    for path in arguments.runs:
        run = RunDirectory.open(path)
        evaluation = dataclasses.replace(run.experiment.evaluation, num_pairs=arguments.pairs)
        agent, world = load_agent(run), stages.make_world(run)
        # The same run, but for the number of pairs; their first tries are kept among its plans.
        asked = dataclasses.replace(run.experiment, evaluation=evaluation)
        trials, _ = try_pairs(RunDirectory(path, asked), world, agent, stages.silent)
        metrics = trial_metrics(trials, world.robot.turns)
        columns[path.name] = {
            reading.key: reading.value for some in readings(metrics).values() for reading in some
        }
    keys = list(dict.fromkeys(key for column in columns.values() for key in column))
    print(f"| figure | {' | '.join(columns)} |")
    print("|---" * (len(columns) + 1) + "|")
    for key in keys:
        print(f"| `{key}` | {' | '.join(column.get(key, '') for column in columns.values())} |")


if __name__ == "__main__":
    main()
