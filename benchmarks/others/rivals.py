"""Published methods beside ours, all judged by `selftouch score` on the same recordings.

    python benchmarks/make/recordings.py
    python benchmarks/others/rivals.py build/recordings/*_[123].npz --touches 1500 5000 15000

Every method lays out what it can in three dimensions, and its places are handed in. A rival runs
with its authors' own code where a package has it; the table says whose code it is, and which
packages are missing (`pip install umap-learn pacmap phate minisom`).

- `body_model`: ours, places by the body model, and by `learned` on parts where it is rejected;
- `learned`, `sensorimotor`, `motor`: ours; `literal`: ours, the paper's method to the letter;
- `isomap` (ANISOMAP: McGregor, Polani and Dautenhahn 2011), `mds`, `tsne`, `spectral`, `umap`,
  `pacmap`, `phate`: of sensations, with the settings that their packages recommend;
- `som`: a self-organising sheet (Hoffmann et al. 2018), bent in space by its distances;
- `correlation`: receptors laid out by 1 - correlation (Pierce and Kuipers 1997), `near_correlation`
  by Isomap, which trusts high correlations only (as Modayil 2010), `information` by the information
  distance of readings in eight bins (Olsson, Nehaniv and Polani 2006);
- `autoencoder`: its three middle units, a stand-in for Marcel, O'Regan and Hoffmann 2022;
- `diffusion` maps and a `variational` autoencoder, of sensations (`rival_maps.py`);
- `calibrated`: places of touches by the robot's own model, without an error: what a calibration
  reaches at best. It alone is told the kinematics, and what touched what;
- `random`: anywhere.

Only ours and `calibrated` use motor configurations. To help the rivals, each lays out by itself
every part that our agent found; and those that lay out sensations do so twice: our target
sensations (`targets`; each receptor is then handed in at the mean place of those in which it reads
something, by the square of its reading, as with ours), and 1,500 random touches as they are
(`touches`). With `--plans`, `body_model` and `learned` plan between the recording's pairs, and so
does every map of targets, by its shortest ways. Raw readings are calibrated by our import first.
Seconds are of CPU time.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.distance import cdist
from sklearn.manifold import MDS, TSNE, Isomap, SpectralEmbedding
from sklearn.neural_network import MLPRegressor

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body_model.asking import ask_for_model
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.readings.found_touches import find_touches
from selftouch_drake.agent.representation.kernel_sensations import kernel_sensations
from selftouch_drake.agent.representation.learning import learn
from selftouch_drake.agent.representation.quotient import LEAST_OF_PART, QuotientRepresentation
from selftouch_drake.agent.shape.recovery import recover
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.quotient.sensations import assign
from selftouch_drake.run.submissions import find_recording, judge_submission

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.others.rival_maps import along_map, calibrated_places, diffusion, variational
from benchmarks.shared.results import add_update_option, results

#: Sensations `(n, S)` and a seed to places `(n, 3)`.
Layout = Callable[[np.ndarray, int], np.ndarray]
# Touches from which receptors are laid out, and networks learn, at most.
_MOST_ROWS = 5000
# Of a plan that is handed in.
_INSTANTS = 1000


class Way(NamedTuple):
    """A method: whose code it is, the package that it needs, and how it lays out what it gets."""

    code: str
    package: str
    lay: Layout
    of: tuple[str, ...] = ("targets", "touches")


def angles(felt: np.ndarray) -> np.ndarray:
    apart = np.arccos(np.clip(felt @ felt.T, -1.0, 1.0))
    np.fill_diagonal(apart, 0.0)
    return (apart + apart.T) / 2


def isomap(felt: np.ndarray, seed: int) -> np.ndarray:
    return Isomap(n_neighbors=8, n_components=3).fit_transform(felt)


def mds(felt: np.ndarray, seed: int) -> np.ndarray:
    return scaled(angles(felt), seed)


def scaled(apart: np.ndarray, seed: int) -> np.ndarray:
    return MDS(3, dissimilarity="precomputed", n_init=4, random_state=seed).fit_transform(apart)


def tsne(felt: np.ndarray, seed: int) -> np.ndarray:
    perplexity = min(30.0, (len(felt) - 1) / 3)
    return TSNE(3, perplexity=perplexity, random_state=seed).fit_transform(felt)


def spectral(felt: np.ndarray, seed: int) -> np.ndarray:
    options = {"affinity": "nearest_neighbors", "n_neighbors": 10, "random_state": seed}
    return SpectralEmbedding(3, **options).fit_transform(felt)


def by_umap(felt: np.ndarray, seed: int) -> np.ndarray:
    import umap  # only where it is installed, as the next two

    return umap.UMAP(n_components=3, metric="cosine", random_state=seed).fit_transform(felt)


def by_pacmap(felt: np.ndarray, seed: int) -> np.ndarray:
    import pacmap

    return pacmap.PaCMAP(n_components=3, random_state=seed).fit_transform(felt)


def by_phate(felt: np.ndarray, seed: int) -> np.ndarray:
    import phate

    return phate.PHATE(n_components=3, random_state=seed, verbose=0, n_jobs=1).fit_transform(felt)


def som(felt: np.ndarray, seed: int) -> np.ndarray:
    from minisom import MiniSom

    side = round(np.sqrt(min(len(felt), 300)))
    sheet = MiniSom(side, side, felt.shape[1], sigma=side / 4, random_seed=seed)
    sheet.train(felt, 20_000)
    units = sheet.get_weights().reshape(side * side, -1)
    # Paths along the sheet: from each unit to the eight around it.
    place = np.stack(np.divmod(np.arange(side * side), side), axis=1)
    beside = np.abs(place[:, None] - place).max(axis=2) == 1
    step = cdist(units, units)
    bent = Isomap(n_neighbors=8, n_components=3, metric="precomputed")
    bent.fit(np.where(beside, step, step.max() * side + step))
    return bent.embedding_[cdist(felt, units).argmin(axis=1)]


def autoencoder(felt: np.ndarray, seed: int) -> np.ndarray:
    options = {"activation": "tanh", "max_iter": 100, "random_state": seed}
    network = MLPRegressor(hidden_layer_sizes=(128, 3, 128), **options).fit(felt, felt)
    hidden = felt
    for weight, bias in list(zip(network.coefs_, network.intercepts_, strict=True))[:2]:
        hidden = np.tanh(hidden @ weight + bias)
    return hidden


def anywhere(felt: np.ndarray, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(len(felt), 3))


def correlation(readings: np.ndarray, seed: int) -> np.ndarray:
    return scaled(uncorrelated(readings), seed)


def near_correlation(readings: np.ndarray, seed: int) -> np.ndarray:
    near = Isomap(n_neighbors=6, n_components=3, metric="precomputed")
    return near.fit_transform(uncorrelated(readings))


def uncorrelated(readings: np.ndarray) -> np.ndarray:
    """`(S, S)` one minus the correlation; receptors that never read get the largest distance."""
    with np.errstate(invalid="ignore", divide="ignore"):
        apart = 1.0 - np.nan_to_num(np.corrcoef(readings))
    np.fill_diagonal(apart, 0.0)
    return (apart + apart.T) / 2


def information(readings: np.ndarray, seed: int) -> np.ndarray:
    """By bits, H(X | Y) + H(Y | X) of the readings in eight bins."""
    held = np.zeros((*readings.shape, 8), dtype=np.float32)
    for x, into in zip(readings, held, strict=True):
        edges = np.unique(np.quantile(x[x > 0], np.arange(8) / 7)[:7]) if x.any() else []
        into[np.arange(len(x)), np.digitize(x, edges)] = 1.0
    share = np.tensordot(held, held, axes=(1, 1)) / readings.shape[1]
    bits = -np.sum(share * np.log2(np.maximum(share, 1e-12)), axis=(1, 3))
    alone = np.diag(bits)
    apart = np.maximum(2.0 * bits - alone[:, None] - alone, 0.0)
    np.fill_diagonal(apart, 0.0)
    return scaled((apart + apart.T) / 2, seed)


_OURS = ("body_model", "learned", "sensorimotor", "motor", "literal")
_HERE, _LEARN = "written here from the paper, by ", "scikit-learn"
WAYS: dict[str, Way] = {
    "isomap": Way("", _LEARN, isomap),
    "mds": Way("", _LEARN, mds, ("targets",)),
    "tsne": Way("", _LEARN, tsne),
    "spectral": Way("", _LEARN, spectral),
    "umap": Way("its authors': ", "umap-learn", by_umap),
    "pacmap": Way("its authors': ", "pacmap", by_pacmap),
    "phate": Way("its authors': ", "phate", by_phate),
    "som": Way("bent in space here, by ", "minisom", som),
    "autoencoder": Way(_HERE, _LEARN, autoencoder, ("touches",)),
    "correlation": Way(_HERE, _LEARN, correlation, ("receptors",)),
    "near_correlation": Way(_HERE, _LEARN, near_correlation, ("receptors",)),
    "information": Way(_HERE, _LEARN, information, ("receptors",)),
    "diffusion": Way(_HERE, "scipy", diffusion),
    "variational": Way(_HERE, "numpy", variational, ("touches",)),
    "random": Way("written here, by ", _LEARN, anywhere, ("targets",)),
}
_ALL = (*_OURS, *WAYS, "calibrated")


class Touches:
    """What a recording gives, and what our agent learns from it, on which others may build."""

    def __init__(self, path: Path, size: int, options: argparse.Namespace):
        given = load_arrays(path)
        q, sensation = given["q"][:size], given["sensation"][:size]
        self.q_of_pairs, self.pairs = given["q"], given["pairs"]
        # Plans of fewer rows may begin at a touch that is not among them.
        self.plans = options.plans and size >= len(given["q"])
        self.path, self.size, self.seed = path, size, options.seed
        self.rows, self.q, self.felt = np.arange(len(q)), q, sensation
        if sensation.dtype.kind in "iu":
            felt = find_touches(q, sensation)
            self.rows, self.q, self.felt = felt.rows, felt.q, felt.sensation
        began = time.process_time()
        sizes = {"num_targets": options.targets, "max_kernel_size": 1000}
        learned = learn(lambda: [(self.felt, self.q)], **sizes, seed=self.seed)
        self.representation: QuotientRepresentation = learned.representation
        self.seconds = time.process_time() - began
        self.model_seconds = 0.0
        self.unit = self.felt / np.linalg.norm(self.felt, axis=1, keepdims=True)
        fragment = self.representation.part >= self.representation.num_parts
        self.target_part = np.where(fragment, -1, self.representation.part)
        self.part = self.target_part[assign(self.felt, self.representation.target_sensations)[0]]

    def by_targets(self, places: np.ndarray) -> dict[str, np.ndarray]:
        """A hand-in by `(K, 3)` places of the target sensations: where the receptors are."""
        felt = self.representation.target_sensations * (self.target_part >= 0)[:, None]
        part = np.where(felt.any(axis=0), self.target_part[felt.argmax(axis=0)], -1)
        weight = np.square(felt, dtype=float) * (self.target_part[:, None] == part)
        found = weight.T @ places / np.maximum(weight.sum(axis=0), 1e-12)[:, None]
        return {"receptor_places": found, "parts": part}

    @cached_property
    def model(self) -> BodyModel:
        """The body model that our agent finds, accepted or not."""
        began, found = time.process_time(), self.representation
        felt = kernel_sensations(found.kernel_row, [self.felt])
        model = ask_for_model(found, felt, seed=self.seed)
        self.model_seconds = time.process_time() - began
        return model

    def recovered(self, metric: str) -> tuple[np.ndarray, float]:
        """`(K, 3)` places of the targets by the paper's representation, and seconds."""
        began = time.process_time()
        body = recover(self.representation, metric, seed=self.seed, holes=False)
        spent = time.process_time() - began + self.seconds
        return np.nan_to_num(body.positions), spent

    def by_model(self, places: np.ndarray | None) -> dict[str, np.ndarray]:
        """A hand-in of receptors by the body model.

        On parts that it does not accept they are by `(K, 3)` places, which are needed where there
        are such parts. The two never meet on one part: they have no frame in common.
        """
        found = self.model.receptors()
        if places is None:
            part = np.where(np.isfinite(found.place).all(axis=1), found.part, -1)
            return {"receptor_places": np.nan_to_num(found.place), "parts": part}
        other = self.by_targets(places)
        accepted = np.append(self.model.accepted_by_part, False)  # the last one for part -1
        known = accepted[found.part] & np.isfinite(found.place).all(axis=1)
        part = np.where(accepted[other["parts"]], -1, other["parts"])
        return {
            "receptor_places": np.where(known[:, None], found.place, other["receptor_places"]),
            "parts": np.where(known, found.part, part),
        }

    def imagined_touches(self) -> dict[str, np.ndarray]:
        """A hand-in of all touches by the body model, those of parts that it accepts."""
        target = assign(self.felt, self.representation.target_sensations)[0]
        places = self.model.place(self.q.astype(float), target)
        part = self.model.kernel_part[target]
        known = self.model.accepted_by_part[part] & np.isfinite(places).all(axis=1)
        return {"touch_places": places[known], "rows": self.rows[known], "parts": part[known]}

    @cached_property
    def agent(self) -> Agent:
        """Our agent with its body model, if it accepts one."""
        felt = kernel_sensations(self.representation.kernel_row, [self.felt])
        return Agent.of(self.representation, kernel_sensation=felt, body_model=self.model)

    def planned(self, way: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
        """`(P, T, J)` plans for the recording's pairs, each from `(J,)` to `(2,)` targets.

        Where a touch of a pair is not known as one, the plan stays where it is.
        """
        number = np.full(int(self.pairs.max()) + 1, -1)
        number[self.rows[self.rows < len(number)]] = np.flatnonzero(self.rows < len(number))
        target = assign(self.felt, self.representation.target_sensations)[0]
        plans = []
        for first, last in self.pairs:
            start = self.q_of_pairs[first].astype(float)
            known = number[first] >= 0 and number[last] >= 0
            ends = target[number[[first, last]]]
            posture = way(start, ends) if known else start[None]
            length = np.linalg.norm(np.diff(posture, axis=0), axis=1)
            s = np.cumsum([0.0, *np.maximum(length, 1e-12)])
            at = np.linspace(0.0, s[-1], _INSTANTS)
            plans.append(np.stack([np.interp(at, s, joint) for joint in posture.T], axis=1))
        return np.array(plans)

    def by_agent(self, agent: Agent) -> np.ndarray:
        """Plans of our agent, which nobody followed."""

        def way(start: np.ndarray, ends: np.ndarray) -> np.ndarray:
            try:
                plan = agent.plan(int(ends[0]), int(ends[1]), q_start=start)
            except ValueError:  # there is no way
                return start[None]
            return plan.path(np.linspace(0.0, plan.waypoint_s[-1], _INSTANTS))

        return self.planned(way)

    def over(self, places: np.ndarray) -> np.ndarray:
        """Plans over a map of our target sensations."""
        return self.planned(lambda start, ends: along_map(self.representation, places, start, ends))

    def by_touches(self, handed: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """A hand-in of receptors by one of touches: each at the mean of those that it feels."""
        felt = np.square(self.felt[np.searchsorted(self.rows, handed["rows"])], dtype=float)
        of_part = (
            np.eye(handed["parts"].max() + 1)[handed["parts"]] * (handed["parts"] >= 0)[:, None]
        )
        heard = felt.T @ of_part
        part = np.where(heard.any(axis=1), heard.argmax(axis=1), -1)
        weight = felt.T * (handed["parts"] == part[:, None])
        found = weight @ handed["touch_places"] / np.maximum(weight.sum(axis=1), 1e-12)[:, None]
        return {"receptor_places": found, "parts": part}

    def handed_in(self, lay: Layout, of: str, seed: int) -> dict[str, np.ndarray]:
        """A hand-in by a rival."""
        rng = np.random.default_rng(seed)
        rows = rng.permutation(len(self.unit))
        if of == "receptors":
            felt = self.felt[rows[:_MOST_ROWS]]
            part = self.target_part[self.representation.target_sensations.argmax(axis=0)]
            part = np.where(felt.any(axis=0), part, -1)
            places, part = in_parts(lay, felt.T, part, seed)
            return {"receptor_places": places, "parts": part}
        if of == "targets":
            targets = self.representation.target_sensations
            places = in_parts(lay, targets, self.target_part, seed)[0]
            plans = {"plans": self.over(places)} if self.plans else {}
            return self.by_targets(places) | plans
        rows = np.sort(rows[:1500])
        places, part = in_parts(lay, self.unit[rows], self.part[rows], seed)
        return {"touch_places": places, "rows": self.rows[rows], "parts": part}


def in_parts(
    lay: Layout, items: np.ndarray, part: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """`(n, 3)` places, each part laid out by itself, and `(n,)` parts, -1 if too small."""
    places, kept = np.zeros((len(items), 3)), np.full(len(items), -1)
    for number in np.unique(part[part >= 0]):
        here = np.flatnonzero(part == number)
        if len(here) >= LEAST_OF_PART:
            places[here], kept[here] = lay(items[here], seed), number
    return places, kept


def rows_of_model(touches: Touches, options: argparse.Namespace) -> Iterator[dict[str, object]]:
    """Rows of our agent with its body model, which it may not accept."""
    print(touches.path.stem, touches.size, touches.model.reason, flush=True)
    spent, places = touches.seconds + touches.model_seconds, None
    if "touches" in options.of and touches.model.accepted_by_part.any():
        yield row(touches, "body_model", "ours", "touches", touches.imagined_touches(), spent)
    if not touches.model.accepted:
        places, seconds = touches.recovered("learned")
        spent = touches.model_seconds + seconds
    handed = touches.by_model(places)
    if touches.plans:
        handed["plans"] = touches.by_agent(touches.agent)
    yield row(touches, "body_model", "ours", "receptors", handed, spent)


def rows_of(touches: Touches, options: argparse.Namespace) -> Iterator[dict[str, object]]:
    seed = options.seed
    for way in options.ways:
        if way == "body_model":
            yield from rows_of_model(touches, options)
            continue
        if way in _OURS:
            places, spent = touches.recovered(way)
            handed = touches.by_targets(places)
            if touches.plans and way == "learned":
                handed["plans"] = touches.by_agent(touches.agent.without_model())
            yield row(touches, way, "ours", "targets", handed, spent)
            continue
        if way == "calibrated":
            began = time.process_time()
            truth = load_arrays(touches.path.with_name(f"{touches.path.stem}.truth.npz"))
            handed = calibrated_places(truth, touches.q, touches.rows)
            spent = time.process_time() - began
            code = "written here, by drake"
            yield row(touches, way, code, "touches", handed, spent)
            yield row(touches, way, code, "receptors", touches.by_touches(handed), spent)
            continue
        known = WAYS[way]
        try:
            code = f"{known.code}{known.package} {version(known.package)}"
        except PackageNotFoundError:
            yield row(touches, way, f"{known.package} is missing", "", None, 0.0)
            continue
        for of in (one for one in known.of if one in options.of):
            began = time.process_time()
            try:
                handed = touches.handed_in(known.lay, of, seed)
            # A package of others may fail in any way; the table says so, and goes on.
            except Exception as error:
                print(f"{way} of {of}: {type(error).__name__}: {error}")
                handed, code = None, f"{code}: failed"
            yield row(touches, way, code, of, handed, time.process_time() - began)


def row(
    touches: Touches,
    way: str,
    code: str,
    of: str,
    handed: dict[str, np.ndarray] | None,
    seconds: float,
) -> dict[str, object]:
    """A row of the table, judged."""
    found = {}
    if handed is not None:
        with tempfile.TemporaryDirectory() as folder:
            save_arrays(Path(folder) / "handed_in.npz", handed)
            found = judge_submission(Path(folder) / "handed_in.npz", str(touches.path))
    betti = list(
        zip(
            found.get("topology_betti_by_part", []),
            found.get("topology_betti_true_by_part", []),
            strict=True,
        )
    )
    body, _, seed = touches.path.stem.rpartition("_")
    right = sum(one is not None and one == true for one, true in betti)
    figure = lambda key, digits: round(found[key], digits) if key in found else ""  # noqa: E731
    return {
        "body": body,
        "seed": seed,
        "size": touches.size,
        "touches": len(touches.rows),
        "way": way,
        "of": of,
        "surface_error": figure("surface_rms_fraction", 4),
        "holes_right": right if found else "",
        "parts_found": figure("parts_found", 0),
        "parts_true": figure("parts_true", 0),
        "margin": figure("topology_margin", 1),
        "neighbours": figure("neighbour_agreement", 3),
        "judged": figure("judged_share", 3),
        "contact": figure("unpractised_contact_mean", 3),
        "contact_worst": figure("unpractised_contact_worst", 3),
        "reached": figure("unpractised_reach_rate", 2),
        "cpu_s": round(seconds, 1),
        "code": code,
    }


def summary(rows: list[dict[str, object]]) -> str:
    """The shape errors as Markdown, median / worst of the data seeds; × where holes are wrong."""
    bodies = list(dict.fromkeys(str(one["body"]) for one in rows))
    lines = [["method", "of", *bodies], ["---"] * (2 + len(bodies))]
    for way, of in dict.fromkeys((one["way"], one["of"]) for one in rows):
        cells = []
        for body in bodies:
            mine = [one for one in rows if (one["body"], one["way"], one["of"]) == (body, way, of)]
            error = [100 * float(str(one["surface_error"])) for one in mine if one["judged"] != ""]
            wrong = any(one["holes_right"] != one["parts_true"] for one in mine)
            text = f"{np.median(error):.1f}" if error else "none"
            text += f" / {max(error):.1f}" if len(error) > 1 else ""
            cells.append(f"{text} ×" if wrong else text)
        lines.append([str(way), str(of), *cells])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recordings", nargs="+", help="paths, or names of shipped ones")
    parser.add_argument(
        "--touches",
        type=int,
        nargs="+",
        default=[15_000],
        help="sizes: the first rows, or all if fewer",
    )
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--ways", nargs="+", choices=_ALL, default=_ALL)
    of = ["targets", "touches", "receptors"]
    parser.add_argument("--of", nargs="+", choices=of, default=of, help="what rivals lay out")
    parser.add_argument("--plans", action="store_true", help="where all rows are given, plan too")
    parser.add_argument("--seed", type=int, default=0, help="of all that is random in a method")
    add_update_option(parser, "rivals")
    options = parser.parse_args()
    # Some packages start as many threads as there are cores, whatever they are asked for.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    rows = []
    with results("rivals", update=options.update) as add, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for size, recording in product(options.touches, options.recordings):
            for one in rows_of(Touches(find_recording(recording), size, options), options):
                add(one)
                rows.append(one)
                print(*one.values(), sep=" | ", flush=True)
    for size in options.touches:
        print(f"\nFirst {size} touches:\n{summary([one for one in rows if one['size'] == size])}")


if __name__ == "__main__":
    main()
