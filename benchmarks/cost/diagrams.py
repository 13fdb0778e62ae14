"""Memory that a process keeps for each self-touch diagram that it made and let go.

Older Drakes never free a diagram with a Python system, newer ones do. Run it on the Drake in
question; `--same` puts one diagram to the same use again instead.

    python benchmarks/cost/diagrams.py --experiment cube --count 8
"""

import argparse
import gc
import os
from importlib.metadata import version
from pathlib import Path

import numpy as np

from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.systems.simulation import Simulation

# Diagrams after which libraries have loaded what they load once.
_FIRST = 2


def resident_mb() -> float:
    """MB of memory that this process has now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def use(simulation: Simulation) -> None:
    """Simulates a tenth of a second."""
    simulation.rest_at(np.zeros(simulation.num_joints))
    simulation.advance(0.1)
    simulation.take_log()


def main() -> None:
    """Makes diagrams one after another and prints the growth of memory."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--experiment", default="cube")
    parser.add_argument("--count", type=int, default=8, help="number of diagrams")
    parser.add_argument("--same", action="store_true", help="use one diagram each time")
    arguments = parser.parse_args()
    world = World(load_experiment(arguments.experiment))
    kept = Simulation(world.experiment, world.skins) if arguments.same else None
    found = list[float]()
    for _ in range(_FIRST + arguments.count):
        use(kept or Simulation(world.experiment, world.skins))
        gc.collect()
        found.append(resident_mb())
    grown = (found[-1] - found[_FIRST - 1]) / arguments.count
    how = "use of one diagram" if arguments.same else "diagram"
    print(
        f"Drake {version('drake')}, {arguments.experiment}: {found[_FIRST - 1]:.0f} MB, "
        f"{found[-1]:.0f} MB {arguments.count} later: {grown:.1f} MB per {how}"
    )


if __name__ == "__main__":
    main()
