"""Published methods for the shape of a skin, compared with ours: same touches, targets, scores.

    python benchmarks/rivals.py runs/torus runs/cube --touches 10000 100000 --targets 300

Needs `pip install 'selftouch-drake[bench]'`. Each way lays out the kernels in space:

- `learned`, `sensorimotor`, `motor`, `literal`: ours, and the paper's to the letter;
- `isomap`: Isomap on target sensations (ANISOMAP: McGregor, Polani and Dautenhahn 2011);
- `correlation`: receptors laid out by multidimensional scaling of 1 - correlation (Pierce and
  Kuipers 1997); a kernel lies at the mean of the receptors, weighted by what it feels;
- `correlation_local`: the same by Isomap, which trusts high correlations only (as Modayil 2010
  lays out receptors from their nearest ones);
- `information`: as `correlation`, by the information distance of readings in eight bins (Olsson,
  Nehaniv and Polani 2006);
- `som`: a self-organising sheet trained on sensations (Hoffmann et al. 2018); a kernel lies at its
  best matching unit, the sheet bent in space by the distances between its units;
- `autoencoder`: the three middle units of an autoencoder of sensations, a stand-in for the
  variational one of Marcel, O'Regan and Hoffmann 2022, which no small package has;
- `random`: anywhere.

All but `motor` and `literal` use sensations; only ours use motor configurations. A rival sees all
the touches. Scores are those of a run: error of the shape, the same from the nearest points of the
surface, holes with their margin, dimension, and share of the six nearest kernels that truly are
among the twelve nearest. Seconds are of CPU time.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from babbled import run_at
from results import add_update_option, results
from scipy.spatial.distance import cdist, pdist, squareform
from shape import Case, Experience, learned_representation
from sklearn.manifold import MDS, Isomap
from sklearn.metrics import mutual_info_score
from sklearn.neural_network import MLPRegressor

from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.agent.representation.set_distances import MAX_QUERIES
from selftouch_drake.agent.shape import intrinsic_dimension, recover, topology
from selftouch_drake.evaluation import kernel_truth, neighbour_agreement, shape_errors

#: Touches that a rival learns from at most, where more only take longer.
_MOST_ROWS = 20_000

COLUMNS = (
    "body",
    "touches",
    "way",
    "error",
    "surface error",
    "holes",
    "margin",
    "dimension",
    "neighbours",
    "CPU s",
)

Layout = tuple[np.ndarray, np.ndarray]
Rival = Callable[[QuotientRepresentation, np.ndarray, int], Layout]


def ours(metric: str) -> Rival:
    def lay(representation: QuotientRepresentation, felt: np.ndarray, seed: int) -> Layout:
        body = recover(representation, metric, seed=seed, holes=False)
        return body.positions, body.distances

    return lay


def isomap(representation: QuotientRepresentation, felt: np.ndarray, seed: int) -> Layout:
    found = Isomap(n_neighbors=8, n_components=3).fit(representation.target_sensations)
    return found.embedding_, found.dist_matrix_


def by_receptors(apart: Callable[[np.ndarray], np.ndarray], *, local: bool = False) -> Rival:
    """A layout of receptors by distances between their readings `(n, S)`."""

    def lay(representation: QuotientRepresentation, felt: np.ndarray, seed: int) -> Layout:
        if local:
            scaling = Isomap(n_neighbors=6, n_components=3, metric="precomputed")
        else:
            scaling = MDS(3, dissimilarity="precomputed", n_init=4, random_state=seed)
        receptors = scaling.fit_transform(apart(some(felt, seed)))
        weight = representation.target_sensations
        positions = (weight / weight.sum(axis=1, keepdims=True)) @ receptors
        return positions, squareform(pdist(positions))

    return lay


def correlation(felt: np.ndarray) -> np.ndarray:
    """`(S, S)` one minus the correlation; receptors that never read get the largest distance."""
    with np.errstate(invalid="ignore", divide="ignore"):
        apart = 1.0 - np.nan_to_num(np.corrcoef(felt.T))
    np.fill_diagonal(apart, 0.0)
    return apart


def information(felt: np.ndarray) -> np.ndarray:
    """`(S, S)` bits, H(X | Y) + H(Y | X) of the readings in eight bins."""
    edges = [np.unique(np.quantile(x[x > 0], np.arange(8) / 7)) if x.any() else [] for x in felt.T]
    bins = np.array([np.digitize(x, e) for x, e in zip(felt.T, edges, strict=True)])
    entropy = np.array([mutual_info_score(b, b) for b in bins])
    apart = np.zeros((len(bins), len(bins)))
    for i, j in zip(*np.triu_indices(len(bins), 1), strict=True):
        apart[i, j] = entropy[i] + entropy[j] - 2.0 * mutual_info_score(bins[i], bins[j])
    return (apart + apart.T) / np.log(2.0)


def som(representation: QuotientRepresentation, felt: np.ndarray, seed: int) -> Layout:
    side = round(np.sqrt(representation.num_targets))
    rows = unit(some(felt, seed))
    # Not in the extra `test`; the other rivals run without it.
    from minisom import MiniSom

    sheet = MiniSom(side, side, rows.shape[1], sigma=side / 4, random_seed=seed)
    sheet.train(rows, 10 * len(rows))
    units = sheet.get_weights().reshape(side * side, -1)
    # Paths along the sheet: from each unit to the eight around it.
    place = np.stack(np.divmod(np.arange(side * side), side), axis=1)
    beside = np.abs(place[:, None] - place).max(axis=2) == 1
    bent = Isomap(n_neighbors=8, n_components=3, metric="precomputed")
    step = cdist(units, units)
    bent.fit(np.where(beside, step, step.max() * side + step))
    best = cdist(representation.target_sensations, units).argmin(axis=1)
    return bent.embedding_[best], bent.dist_matrix_[np.ix_(best, best)]


def autoencoder(representation: QuotientRepresentation, felt: np.ndarray, seed: int) -> Layout:
    network = MLPRegressor(
        hidden_layer_sizes=(128, 3, 128), activation="tanh", max_iter=100, random_state=seed
    )
    rows = unit(some(felt, seed))
    network.fit(rows, rows)
    hidden = representation.target_sensations
    for weight, bias in list(zip(network.coefs_, network.intercepts_, strict=True))[:2]:
        hidden = np.tanh(hidden @ weight + bias)
    return hidden, squareform(pdist(hidden))


def anywhere(representation: QuotientRepresentation, felt: np.ndarray, seed: int) -> Layout:
    positions = np.random.default_rng(seed).normal(size=(representation.num_targets, 3))
    return positions, squareform(pdist(positions))


def some(felt: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return felt[rng.choice(len(felt), min(len(felt), _MOST_ROWS), replace=False)]


def unit(felt: np.ndarray) -> np.ndarray:
    return felt / np.linalg.norm(felt, axis=1, keepdims=True)


WAYS: dict[str, Rival] = {
    "learned": ours("learned"),
    "sensorimotor": ours("sensorimotor"),
    "motor": ours("motor"),
    "literal": ours("literal"),
    "isomap": isomap,
    "correlation": by_receptors(correlation),
    "correlation_local": by_receptors(correlation, local=True),
    "information": by_receptors(information),
    "som": som,
    "autoencoder": autoencoder,
    "random": anywhere,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "runs", nargs="+", type=Path, help="a missing one, such as torus_951, is babbled"
    )
    parser.add_argument("--touches", nargs="+", type=int, default=[10_000, 100_000])
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=list(WAYS))
    parser.add_argument("--seed", type=int, default=0, help="of the ways that learn")
    add_update_option(parser, "rivals")
    arguments = parser.parse_args()
    print("| body | touches | way | shape error | surface error | holes | margin ", end="")
    print("| dimension | neighbours | CPU s |")
    print("|---" * len(COLUMNS) + "|")
    with results("rivals", update=arguments.update) as add:
        for path in arguments.runs:
            experience = Experience(run_at(path, max(arguments.touches)))
            for touches in arguments.touches:
                for row in rows(experience, touches, arguments):
                    add(dict(zip(COLUMNS, row, strict=True)))
                    print(line(row), flush=True)


def rows(experience: Experience, touches: int, arguments: argparse.Namespace):
    experiment = experience.run.experiment
    case = Case(
        body=experiment.name,
        seed=experiment.seed,
        skin="whole",
        samples=touches,
        targets=arguments.targets,
        receptors=experiment.num_receptors,
        queries=MAX_QUERIES,
    )
    felt, q, contacts = experience.felt(case)
    representation, _ = learned_representation(case, felt, q)
    truth = kernel_truth(representation, contacts[representation.kernel_row])
    on_surface = truth.on_surface(experience.fields)
    for way in arguments.ways:
        began = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            positions, distances = WAYS[way](representation, felt, arguments.seed)
        seconds = time.process_time() - began
        holes = topology(positions)
        yield (
            case.body,
            touches,
            way,
            *(
                round(max(shape_errors(positions, representation.part, where).values()), 4)
                for where in (truth, on_surface)
            ),
            " ".join(map(str, holes.betti)),
            round(holes.margin, 1),
            round(intrinsic_dimension(distances), 2),
            round(neighbour_agreement(distances, truth.positions), 3),
            round(seconds, 1),
        )


def line(row: tuple) -> str:
    body, touches, way, error, from_surface, betti, margin, dimension, neighbours, seconds = row
    return (
        f"| {body} | {touches:,} | {way} | {error:.1%} | {from_surface:.1%} | {betti} "
        f"| {margin} | {dimension} | {neighbours:.0%} | {seconds} |"
    )


if __name__ == "__main__":
    main()
