"""Which stage of the recovery costs what: the truth replaces one stage after another.

    python benchmarks/accuracy/causes.py runs/infant_7 runs/icub_7

A row for each part of each run: its shape error, of the worst skin on it, in percent, if neighbours
and lengths are the agent's own, by `sensorimotor`; if one of them is true; and if both are. What is
left then is due to the layout: an open patch can be bent without changing any length along it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.distance import cdist

from selftouch_drake.agent.representation.learning import learn
from selftouch_drake.agent.shape.metrics import sensorimotor
from selftouch_drake.evaluation.shape import kernel_truth, shape_errors
from selftouch_drake.experience.store import Contacts, ExperienceReader
from selftouch_drake.quotient.graph import connected_edges, neighbour_edges
from selftouch_drake.quotient.layout import curvature_corrected_mds
from selftouch_drake.quotient.paths import geodesics
from selftouch_drake.quotient.sensations import angles
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.babbled import run_at
from benchmarks.shared.results import add_update_option, results


def rows(run: RunDirectory) -> Iterator[dict[str, object]]:
    """A row for each part that the agent finds."""
    settings, seed = run.experiment.representation, run.experiment.seed
    touches = list(ExperienceReader(run.experience).touches())
    sizes = {"num_targets": settings.num_targets, "max_kernel_size": settings.max_kernel_size}
    known = learn(lambda: touches, **sizes, seed=seed).representation
    contacts = Contacts.joined(list(ExperienceReader(run.truth).contacts()))
    world = stages.make_world(run)
    fields = [skin.fields for skin in world.skins]
    truth = kernel_truth(known, contacts[known.kernel_row], world.receptor_skin).on_surface(fields)
    for number in range(known.num_parts):
        kernels = np.flatnonzero(known.part == number)
        place, part = truth.positions[kernels], known.restricted(kernels)
        own, distance = sensorimotor(part, 2), cdist(place, place)
        true = connected_edges(neighbour_edges(distance), distance)

        def error(edges: np.ndarray, length: np.ndarray, kernels: np.ndarray = kernels) -> float:
            along = geodesics(edges, length, len(kernels))
            laid = np.full((known.num_targets, 3), np.nan)
            laid[kernels] = curvature_corrected_mds(edges, along).positions
            here = np.where(np.isin(np.arange(known.num_targets), kernels), 0, 1)
            return round(100 * max(shape_errors(laid, here, truth).values()), 1)

        yield {
            "experiment": run.experiment.name,
            "seed": seed,
            "part": number,
            "kernels": len(kernels),
            "own": error(own.edges, own.length),
            "true_neighbours": error(true, angles(part.target_sensations, true)),
            "true_lengths": error(own.edges, distance[*own.edges.T]),
            "both_true": error(true, distance[*true.T]),
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", type=Path, help="a missing one is babbled")
    parser.add_argument("--touches", type=int, default=300_000, help="of a run that is missing")
    add_update_option(parser, "causes")
    arguments = parser.parse_args()
    with results("causes", update=arguments.update) as add:
        for path in arguments.runs:
            for row in rows(run_at(path, arguments.touches)):
                add(row)
                print(*row.values(), flush=True)


if __name__ == "__main__":
    main()
