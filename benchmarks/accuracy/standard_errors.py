"""Whether the standard errors of a body model hold: how often the truth lies within two of them.

    python benchmarks/accuracy/standard_errors.py --seeds 0 1 2 3 4 5 6 7 8 9

Only what has no gauge can be compared: angles between neighbouring axes, ratios of distances
between them, and how far a joint turns per unit of its reading. And the scale that `selftouch model
--length` takes from the true distance of any two axes: it is compared with that of the similarity
which takes the places of touches nearest to the true ones. The bodies are made up, of four to nine
joints; the fit begins at the truth, because what is asked here is what touches tell, not whether
the search finds the body.
"""

import argparse
import itertools
from dataclasses import dataclass

import numpy as np
from made_up_bodies import Case, case

from selftouch_drake.agent.body_model.assemble import Found, assembled
from selftouch_drake.agent.body_model.chain import adjoint, shifted
from selftouch_drake.agent.body_model.fit import chain_way
from selftouch_drake.agent.body_model.model import JointKind
from selftouch_drake.agent.body_model.refine import moved_by, refined
from selftouch_drake.agent.body_model.scene import Scene, Solution
from selftouch_drake.agent.body_model.standard_errors import covariance
from selftouch_drake.agent.body_model.tree import Tree
from selftouch_drake.agent.body_model.who_touched import started
from selftouch_drake.evaluation.body_model import Similarity
from selftouch_drake.export.unit import axes_apart, unit_from_joints

NAMES = ("angle", "distance", "turn", "scale")


def standardised(made: Case) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[int]]:
    """`(n, J)` standardised readings, true twists for them, the true toucher, and the chain."""
    center, scale = made.q.mean(axis=0), made.q.std(axis=0)
    order = np.argsort(made.slots)
    begin, step = ((center - made.zero) / made.unit)[order], (scale / made.unit)[order]
    of_chain, carried = shifted(made.twists, -begin / step, 1 / step)
    twists = np.empty_like(of_chain)
    twists[order] = of_chain
    point = (carried @ np.r_[made.point, 1])[:3]
    return (made.q - center) / scale, twists, point, order.tolist()


def invariants(twists: np.ndarray, order: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Values that no similarity changes, and the kind of each as an index of `NAMES`."""
    turning = [j for j in order if np.linalg.norm(twists[j, :3]) > 1e-9]
    angles, lengths, turns = [], [], []
    for first, second in itertools.pairwise(turning):
        w, x = twists[first, :3], twists[second, :3]
        p, r = (
            np.cross(a, v) / (a @ a) for a, v in ((w, twists[first, 3:]), (x, twists[second, 3:]))
        )
        across = np.cross(w, x)
        cosine = (w @ x) / np.linalg.norm(w) / np.linalg.norm(x)
        angles.append(np.arctan2(np.sqrt(max(1 - cosine**2, 0)), cosine))
        lengths.append((p - r) @ across / np.linalg.norm(across))
    turns = [np.log(np.linalg.norm(twists[j, :3])) for j in turning]
    # Ratios to all lengths together: one that happens to be small would make a bad unit.
    ratios = np.array(lengths) / np.sqrt(np.mean(np.square(lengths))) if len(lengths) > 1 else []
    kinds = np.repeat([0, 1, 2], [len(angles), len(ratios), len(turns)])
    return np.concatenate([angles, ratios, turns]), kinds


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fitted:
    """A made-up body, and the fit of its touches.

    Attributes:
        scene: touches.
        twists: `(J, 6)` the true ones, for standardised readings.
        order: of the chain's joints.
        solution: the fit.
        spread: its covariance.
    """

    scene: Scene
    twists: np.ndarray
    order: list[int]
    solution: Solution
    spread: np.ndarray


def fitted(made: Case) -> Fitted:
    """The fit of a body's touches, begun at the truth."""
    q, twists, point, order = standardised(made)
    scene = Scene(q, made.target, made.part, {(0, 0): chain_way(order)})
    start = started(scene, twists, point[None])
    slides = np.linalg.norm(twists[:, :3], axis=1) < 1e-9
    fixed = np.zeros(twists.size + 3, dtype=bool)
    fixed[: twists.size] = np.repeat(slides, 6) & (np.arange(twists.size) % 6 < 3)
    solution = refined(scene, start, fixed=fixed)
    spread = covariance(scene, solution, fixed=fixed)
    return Fitted(scene=scene, twists=twists, order=order, solution=solution, spread=spread)


def scores(made: Case) -> tuple[np.ndarray, np.ndarray]:
    """How many standard errors each value lies from the truth, and its kind."""
    fit = fitted(made)
    z, kinds = compared(fit.solution, fit.spread, fit.twists, fit.order)
    of_scale = scale_scores(fit, made.place)
    kinds = np.append(kinds, np.full(len(of_scale), NAMES.index("scale")))
    return np.append(z, of_scale), kinds


def scale_scores(fit: Fitted, true: np.ndarray) -> np.ndarray:
    """How many standard errors the scale by each two axes lies from the truth.

    Args:
        fit: of the touches.
        true: `(n, 3)` their places.
    """
    number, rows = len(fit.twists), len(fit.scene.q)
    turning = np.linalg.norm(fit.twists[:, :3], axis=1) > 1e-9
    kind = np.where(turning, JointKind.TURNS, JointKind.SLIDES).astype(int)
    names = [f"joint_{joint}" for joint in range(number)]
    found = Found(
        tree=Tree.chain(fit.order), scene=fit.scene, rows=np.arange(rows), solution=fit.solution,
        center=np.zeros(number), scale=np.ones(number), kind=kind,
        order_group=np.full(number, -1), judgements={}, seed=0, spread=fit.spread,
    )  # fmt: skip
    model = assembled(found, joint_names=names, num_rows=rows, sensation=None)
    places = model.place(fit.scene.q, fit.scene.target)
    onto = Similarity.fitted(places, true)
    # In the model's frame: where nearly parallel axes are measured depends on its origin.
    back = np.eye(4)
    back[:3, :3] = onto.rotation.T / onto.scale
    back[:3, 3] = -back[:3, :3] @ onto.shift
    true_twists, apart = adjoint(back, fit.twists), []
    for pair in itertools.combinations(np.flatnonzero(turning).tolist(), 2):
        first, second = (names[joint] for joint in pair)
        try:
            length = onto.scale * axes_apart(true_twists[list(pair)])
            unit = unit_from_joints(model, first, second, length)
        except ValueError:  # axes that meet, or nearly so
            continue
        apart.append((unit.metres - onto.scale) / unit.sigma)
    return np.array(apart)


def compared(
    solution: Solution, spread: np.ndarray, twists: np.ndarray, order: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """The same for a solution and its covariance."""
    found, kinds = invariants(solution.twists, order)
    true, _ = invariants(twists, order)
    free = np.flatnonzero(np.isfinite(np.diag(spread)))
    slope = np.empty((len(found), len(free)))
    for column, entry in enumerate(free):
        step = np.zeros(len(spread))
        step[entry] = 1e-6
        both = [invariants(moved_by(solution, s * step).twists, order)[0] for s in (1, -1)]
        slope[:, column] = (both[0] - both[1]) / 2e-6
    sigma = np.sqrt(np.einsum("an,nm,am->a", slope, spread[np.ix_(free, free)], slope))
    return (found - true) / sigma, kinds


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(12)))
    parser.add_argument("--touches", type=int, default=8000)
    parser.add_argument("--kernels", type=int, default=300)
    args = parser.parse_args()
    every: list[tuple[np.ndarray, np.ndarray]] = []
    for seed in args.seeds:
        made = case("right", seed, touches=args.touches, kernels=args.kernels)
        z, kinds = scores(made)
        every.append((z, kinds))
        within = [
            f"{name} {np.mean(np.abs(z[kinds == k]) < 2):.2f}" for k, name in enumerate(NAMES)
        ]
        print(
            f"seed {seed:3d}  {made.what}:",
            *within,
            f"rms {np.sqrt((z**2).mean()):.2f}",
            flush=True,
        )
    z, kinds = (np.concatenate(of) for of in zip(*every, strict=True))
    for number, name in enumerate(NAMES):
        own = np.abs(z[kinds == number])
        rms = np.sqrt((own**2).mean())
        print(f"{name:9s} {np.mean(own < 2):.1%} of {len(own)} within two, rms {rms:.2f}")
    print(f"all       {np.mean(np.abs(z) < 2):.1%} of {len(z)} within two standard errors")


if __name__ == "__main__":
    main()
