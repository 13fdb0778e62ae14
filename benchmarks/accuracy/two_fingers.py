"""Two fingers: how many turns of the hand close a loop, and what kernels of two fingers are.

    python benchmarks/accuracy/two_fingers.py touches      # a hand spread wide, ten minutes
    python benchmarks/accuracy/two_fingers.py runs RUN...  # of shipped experiments with two fingers

Needs ripser: pip install 'selftouch-drake[homology]'. docs/two_fingers.md has the results.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh
from scipy.spatial import cKDTree

from selftouch_drake.agent.representation.estimator import QuotientLearner
from selftouch_drake.agent.representation.reservoir import KernelReservoir
from selftouch_drake.agent.representation.touches import (
    overlapping,
    separate_touches,
)
from selftouch_drake.agent.shape.metrics import locally_scaled, motor
from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.experience.collect import random_walk
from selftouch_drake.experience.store import Contacts, ExperienceReader
from selftouch_drake.experiment import load_experiment
from selftouch_drake.quotient.dimension import intrinsic_dimension
from selftouch_drake.quotient.distances import set_distances
from selftouch_drake.quotient.graph import connected_edges, neighbour_edges
from selftouch_drake.quotient.kernels import KernelSets
from selftouch_drake.quotient.paths import geodesics
from selftouch_drake.quotient.sensations import assign, strength, target_sensations
from selftouch_drake.robot import World
from selftouch_drake.robot.broadphase import BroadPhase

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.accuracy.unrolling import Turns, landmarks, turns
from benchmarks.shared.babbled import run_at
from benchmarks.shared.results import add_update_option, results


def by_sensation(targets: np.ndarray) -> np.ndarray:
    """`(K, K)` shortest paths through the eight nearest target sensations."""
    near, index = cKDTree(targets).query(targets, 9)
    pairs = np.stack([np.repeat(np.arange(len(targets)), 8), index[:, 1:].ravel()], axis=1)
    edges, first = np.unique(np.sort(pairs, axis=1), axis=0, return_index=True)
    return geodesics(edges, near[:, 1:].ravel()[first], len(targets))


def few(distances: np.ndarray, num: int) -> np.ndarray:
    picked = landmarks(distances, num)
    return distances[np.ix_(picked, picked)]


def longest(bars: np.ndarray) -> list[float]:
    return [*np.sort(bars[:, 1] - bars[:, 0])[::-1][:2].tolist(), 0.0, 0.0][:2]


def lines(name: str, found: Turns) -> Iterator[dict]:
    """A line for the space and for each cover; lengths in the scale at which Z/3 has no loop."""
    for cover, t in enumerate(found.covers):
        unit = found.covers[0].scale[0]
        (two, next_two), (three, _) = longest(t.bars2 / unit), longest(t.bars3 / unit)
        yield {
            "space": name,
            "cover": 2**cover,
            "longest_bar_mod_2": round(two, 2),
            "next_bar_mod_2": round(next_two, 2),
            "longest_bar_mod_3": round(three, 2),
            "stretch": round(t.stretch, 2),
            "order": found.order,
        }


def write(name: str, rows: list[dict], *, update: bool) -> None:
    with results(f"two_fingers_{name}", update=update) as add:
        for row in rows:
            add(row)
            print(row)


def collect(seed: int, num_rows: int) -> dict[str, np.ndarray]:
    """Walks of a widely spread hand: some unselected touches, then those with both tips near.

    Where only one fingertip is near the skin Drake is not asked: the agent would leave such rows
    out, and they are nine touches in ten.
    """
    experiment = load_experiment("sphere_two_wide_fingers", {"seed": seed})
    world = World(experiment)
    body = DrakeBody(world)
    screens = [
        BroadPhase(World(dataclasses.replace(experiment, touching={name: finger})).robot)
        for name, finger in experiment.touching.items()
    ]
    kept: dict[bool, list] = {False: [], True: []}
    num_kept = num_steps = number = 0
    while num_kept < num_rows:
        walk = random_walk(experiment, body, number)
        number += 1
        for _ in range(50):
            q = walk.steps(8192).astype(np.float32)
            num_steps += len(q)
            p_WF = world.robot.toucher_positions(q)
            near = np.stack([screen.near(q).any(axis=1) for screen in screens])
            both = len(kept[False]) >= 20
            maybe = near.all(axis=0) if both else near.any(axis=0)
            sensation = world.probe.sensations(q[maybe])
            touching = sensation.any(axis=1)
            kept[both].append(
                (q[maybe][touching], sensation[touching].astype(np.float32), p_WF[maybe][touching])
            )
            num_kept += both * int(touching.sum())
    columns = {}
    for both, names in ((False, ("aq", "as_", "ap")), (True, ("q", "s", "p"))):
        for name, column in zip(names, zip(*kept[both], strict=True), strict=True):
            columns[name] = np.concatenate(column)
    return {**columns, "steps": np.array(num_steps)}


def equal_touches(parts: np.ndarray) -> np.ndarray:
    """Divides each touch by its own L2 norm and adds them up, so that their force does not count.

    Args:
        parts: `(n, touches, S)` N, from `separate_touches`.

    Returns:
        `(n, S)` dimensionless.
    """
    felt = strength(parts.reshape(-1, parts.shape[2])).reshape(parts.shape[:2])
    return np.einsum("nts,nt->ns", parts, 1.0 / np.where(felt > 0, felt, np.inf)).astype(np.float32)


def num_touching(p_WF: np.ndarray) -> np.ndarray:
    """`(N,)` fingertips that press a sphere of 0.25 m with a skin of 3 cm: the truth."""
    radius = np.linalg.norm(p_WF, axis=2)
    return np.sum((radius > 0.21) & (radius < 0.26), axis=1)


def by_kernels(q: np.ndarray, sensation: np.ndarray, num_targets: int) -> tuple:
    """Quantises, and measures motor kernel sets: targets, rows, offsets, `(K, K)` distances."""
    some = np.random.default_rng(0).permutation(len(sensation))[:40_000]
    targets = target_sensations(sensation[np.sort(some)], num_targets)
    kernels = KernelReservoir(num_targets, 400, seed=0)
    kernels.add(assign(sensation, targets)[0])
    sample = kernels.sample()
    row, offsets = sample.row, sample.offsets(num_targets)
    apart = set_distances(KernelSets(q[row], offsets), "quantile")
    edges = connected_edges(neighbour_edges(apart), apart)
    length = locally_scaled(apart[edges[:, 0], edges[:, 1]], edges)
    return targets, row, offsets, geodesics(edges, length, num_targets)


def touches(arguments: argparse.Namespace) -> None:
    if arguments.data.exists():
        data = dict(np.load(arguments.data))
    else:
        data = collect(arguments.seed, arguments.rows)
        np.savez(arguments.data, **data)
    overlap, _ = overlapping(data["as_"])
    row, parts = separate_touches(data["s"], overlap)
    one_number = np.bincount(separate_touches(data["as_"], overlap)[0])
    number = np.bincount(row)
    two = number == 2
    parts = parts[two[row]].reshape(int(two.sum()), 2, -1)
    q, even, p_WF = data["q"][two], equal_touches(parts), data["p"][two].astype(float)
    all_true, true = num_touching(data["ap"]), num_touching(data["p"])
    share = float((all_true == 2).mean())
    print(f"touches of both fingers: {share:.1%} of all; found by the agent: ", end="")
    print(f"{(one_number[all_true == 2] == 2).mean():.1%}, ", end="")
    print(f"touches of one taken for two: {(one_number[all_true == 1] > 1).mean():.2%}")
    angle = [np.degrees(np.arccos(np.clip(cosine(p), -1, 1))) for p in p_WF[::100]]
    print(f"chords {np.percentile(angle, [5, 50, 95]).round(0)} deg; rows of both {len(q)}")
    print(f"as many touches: {(true == 2).sum() / share / 1e6:.2f} M")

    rows = []
    for num_rows, num_targets in (
        (len(q) // 3, 2000),
        (len(q) // 3, 1000),
        (len(q) // 10, 1000),
        (len(q), 2000),
    ):
        targets, row, offsets, by_motor = by_kernels(q[:num_rows], even[:num_rows], num_targets)
        for metric, distances in (("motor", by_motor), ("sensation", by_sensation(targets))):
            picked = landmarks(distances, arguments.landmarks)
            found = turns(distances[np.ix_(picked, picked)])
            labels = dict.fromkeys(
                ("edges_right", "configurations_labelled", "of_these_right"), np.nan
            )
            if found.order > 1:
                labels = labelled_fingers(q, p_WF, row, offsets, picked, distances, found)
            rows += [
                {"rows": num_rows, "targets": num_targets, **line, **labels}
                for line in lines(f"two touches, {metric}", found)
            ]
        write(f"touches_s{arguments.seed}", rows, update=arguments.update)


def cosine(p: np.ndarray) -> float:
    return float(p[0] @ p[1] / np.linalg.norm(p[0]) / np.linalg.norm(p[1]))


def labelled_fingers(
    q: np.ndarray,
    p_WF: np.ndarray,
    row: np.ndarray,
    offsets: np.ndarray,
    picked: np.ndarray,
    distances: np.ndarray,
    found: Turns,
) -> dict[str, float]:
    """Scores the turns against the truth: do they show which finger is at which end?

    The agent labels its configurations so that near ones in neighbouring kernels have the same
    label, or the other one if the step is a turn. The truth: which finger is at an end of the
    chord, up to the name of each end.
    """
    turn = found.covers[0]
    flips = np.zeros((len(picked),) * 2, dtype=bool)
    flips[tuple(turn.cocycle.T)] = True
    flips |= flips.T
    near = distances[np.ix_(picked, picked)] <= turn.middle

    members = [row[offsets[k] : offsets[k + 1]] for k in picked]
    first_end, chord = zip(*[ends_of(p_WF[rows]) for rows in members], strict=True)
    chords = np.array(chord)
    i, j = np.nonzero(np.triu(near, 1))
    same, other = (
        np.linalg.norm(chords[i] - chords[j][:, order], axis=(1, 2)) for order in ([0, 1], [1, 0])
    )
    sign = np.where(flips[i, j] == (same > other), 1.0, -1.0)
    name = leading_sign(i, j, sign, len(picked))
    named = name[i] * name[j] != 0
    edges_right = np.mean((sign == name[i] * name[j])[named])

    kernel = np.repeat(np.arange(len(picked)), [len(rows) for rows in members])
    configurations = q[np.concatenate(members)]
    truth = np.where(np.concatenate(first_end), 1, -1) * name[kernel]
    _, index = cKDTree(configurations).query(configurations, 21)
    a, b = np.repeat(np.arange(len(index)), 20), index[:, 1:].ravel()
    step = near[kernel[a], kernel[b]]
    a, b = a[step], b[step]
    label = leading_sign(a, b, np.where(flips[kernel[a], kernel[b]], -1.0, 1.0), len(index))
    scored = label * truth != 0
    right = np.mean(label[scored] == truth[scored])
    return {
        "edges_right": round(float(edges_right), 4),
        "configurations_labelled": round(float(np.mean(label != 0)), 4),
        "of_these_right": round(float(max(right, 1 - right)), 4),
    }


def ends_of(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Names the ends of a kernel's chords: rows with finger 0 at the first end, and the chord."""
    chord, swapped = p[0], np.zeros(len(p), dtype=bool)
    for _ in range(3):
        there, back = (np.linalg.norm(x - chord, axis=(1, 2)) for x in (p, p[:, ::-1]))
        swapped = there > back
        chord = np.where(swapped[:, None, None], p[:, ::-1], p).mean(axis=0)
    return ~swapped, chord


def leading_sign(i: np.ndarray, j: np.ndarray, sign: np.ndarray, num: int) -> np.ndarray:
    """`(num,)` labels +1 and -1 that agree best with the signs between pairs.

    Labels in one component say nothing of those in another: outside the largest they are 0.
    """
    signed = csr_array((sign, (i, j)), shape=(num, num))
    signed = signed + signed.T
    _, component = connected_components(signed, directed=False)
    inside = np.flatnonzero(component == np.bincount(component).argmax())
    part = signed[inside][:, inside]
    scale = diags(1.0 / np.sqrt(np.maximum(abs(part).sum(axis=1), 1.0)))
    start = np.random.default_rng(0).standard_normal(len(inside))
    _, vectors = eigsh(scale @ part @ scale, 1, which="LA", v0=start)
    label = np.zeros(num)
    label[inside] = np.where(vectors[:, -1] >= 0, 1.0, -1.0)
    return label


def num_touchers(contacts: Contacts) -> np.ndarray:
    """`(N,)` number of pressing touchers of each touch: the truth."""
    pairs = np.unique(np.stack([contacts.row, contacts.toucher], axis=1), axis=0)
    return np.bincount(pairs[:, 0], minlength=len(contacts))


def runs(arguments: argparse.Namespace) -> None:
    """Kernels of ordinary runs, and the dimension of their quotient graphs."""
    rows = []
    for path in arguments.runs:
        run = run_at(path, arguments.rows)
        kept = slice(arguments.rows)
        experience, truth = ExperienceReader(run.experience), ExperienceReader(run.truth)
        q, sensation = (experience.read(column)[kept] for column in ("q", "sensation"))
        both = num_touchers(Contacts.joined(list(truth.contacts())))[kept] > 1
        learned = QuotientLearner(arguments.targets, 400).fit(sensation, q).representation_
        graph = motor(learned, 2, 0, lambda fraction: None)
        distances = geodesics(graph.edges, graph.length, learned.num_targets)
        share = np.add.reduceat(both[learned.kernel_row], learned.kernel_offsets[:-1])
        share = share / np.diff(learned.kernel_offsets)
        line = {
            "body": run.experiment.name.partition("_")[0],
            "rows": len(q),
            "targets": arguments.targets,
            "rows_of_two": round(float(both.mean()), 3),
            "kernels_of_one": int((share < 0.1).sum()),
            "kernels_mixed": int(((share >= 0.1) & (share <= 0.9)).sum()),
            "kernels_of_two": int((share > 0.9).sum()),
            "dimension": round(intrinsic_dimension(distances), 2),
        }
        for name, part in (("one", share < 0.1), ("two", share > 0.9)):
            inside = distances[np.ix_(part, part)]
            line[f"dimension_{name}"] = (
                round(intrinsic_dimension(inside), 2) if part.sum() >= 50 else np.nan
            )
        print(line, flush=True)
        rows.append(line)
        write("runs", rows, update=arguments.update)


WHAT = {
    "touches": touches,
    "runs": runs,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=list(WHAT))
    parser.add_argument("runs", nargs="*", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rows", type=int, default=400_000)
    parser.add_argument("--targets", type=int, default=1000, help="of runs")
    parser.add_argument("--landmarks", type=int, default=300)
    parser.add_argument("--data", type=Path, default=Path("two_fingers.npz"))
    add_update_option(parser, "two_fingers_...")
    arguments = parser.parse_args()
    WHAT[arguments.what](arguments)


if __name__ == "__main__":
    main()
