"""How many points of a foreign hand explain its touches, with the true joints: one table.

    python benchmarks/others/foreign_points.py build/foreign/pycub_index_1

The body model takes a toucher for a point, and gives it a surface only at the end. Here links stand
where PyBullet puts them, touches go to the nearest of some points that the hand carries, and points
and places of kernels are fitted in turn, which may end beside the best. *Near* is the share of
touches nearer to the place of their own kernel than kernels are to each other, of all touches and
not of held-out ones as where a model is judged, which needs 88 %. *Place* is the error of touches
against where their receptors lie, in % of the skin's extent.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from selftouch_drake.agent.body_model.asking import kernel_of_rows
from selftouch_drake.agent.body_model.scene import kernel_medians, neighbour_distance
from selftouch_drake.evaluation.body_model import Similarity
from selftouch_drake.run.artifacts import load_representation, stored_sensations
from selftouch_drake.run.directory import RunDirectory

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.others.foreign import body_of, place_of_kernels
from benchmarks.others.foreign_bodies import PyCub

#: The link that carries all that touches; touches that are looked at; rounds of the fit.
HAND, TOUCHES, ROUNDS = "r_hand", 9000, 12


def link_poses(body: PyCub, q: np.ndarray, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """`(n, L, 3, 3)` rotations and `(n, L, 3)` m origins of some links at `(n, J)` rad."""
    links = [body.link_of[name] for name in names]
    turn, origin = np.zeros((len(q), len(links), 3, 3)), np.zeros((len(q), len(links), 3))
    for row, posture in enumerate(q):
        body.p.resetJointStatesMultiDof(
            body.robot,
            body.joints,
            [[angle] for angle in posture],
            [[0.0]] * len(body.joints),
            physicsClientId=body.client,
        )
        for n, state in enumerate(body.p.getLinkStates(body.robot, links, 0, 1, body.client)):
            origin[row, n] = state[4]
            turn[row, n] = np.array(body.p.getMatrixFromQuaternion(state[5])).reshape(3, 3)
    return turn, origin


def explained(
    turn: np.ndarray, shift: np.ndarray, felt: np.ndarray, target: np.ndarray, number: int
) -> tuple[float, float]:
    """Share of near touches, and the error of their places in % of the extent.

    Args:
        turn: `(n, 3, 3)` from the hand to the skin's link.
        shift: `(n, 3)` m, the hand in the skin's link.
        felt: `(n, 3)` m, where the receptors of each touch lie.
        target: `(n,)` kernels.
        number: of points.
    """
    in_hand = np.einsum("nab,na->nb", turn, felt - shift)
    middle = in_hand.mean(axis=0)
    along = np.linalg.svd(in_hand - middle, full_matrices=False)[2][0]
    far = np.quantile((in_hand - middle) @ along, (np.arange(number) + 0.5) / number)
    points = middle + far[:, None] * along
    kernels = int(target.max()) + 1
    place, each = kernel_medians(felt, target, kernels, least=1), np.arange(len(felt))
    for _ in range(ROUNDS):
        reached = np.einsum("nab,ub->nua", turn, points) + shift[:, None]
        who = np.linalg.norm(reached - place[target][:, None], axis=2).argmin(axis=1)
        own = reached[each, who]
        place = kernel_medians(own, target, kernels, least=1)
        wanted = np.einsum("nab,na->nb", turn, place[target] - shift)
        for point in np.unique(who):
            points[point] = np.median(wanted[who == point], axis=0)
    apart = neighbour_distance(place[np.unique(target)])
    near = float((np.linalg.norm(own - place[target], axis=1) < apart).mean())
    off = np.linalg.norm(Similarity.fitted(own, felt)(own) - felt, axis=1)
    extent = np.linalg.norm(np.ptp(felt, axis=0))
    return near, float(100.0 * np.sqrt(np.square(off).mean()) / extent)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, help="of `foreign.py`, of pyCub's iCub")
    parser.add_argument("--points", type=int, nargs="+", default=[1, 2, 3, 4, 6])
    options = parser.parse_args()
    run = RunDirectory.open(options.run)
    representation, body = load_representation(run), body_of(run)
    if not isinstance(body, PyCub):
        parser.error(f"{options.run} is a run of another body; give one of pyCub's")
    target = kernel_of_rows(representation)
    skin = place_of_kernels(representation.target_sensations, body).skin
    weight = stored_sensations(run, representation).toarray()
    rows = np.random.default_rng(0).permutation(len(target))[:TOUCHES]
    q = representation.kernel_q[rows].astype(float)
    turn, origin = link_poses(body, q, [*body.skins, HAND])
    for number, name in enumerate(body.skins):
        here = np.flatnonzero(skin[target[rows]] == number)
        own = weight[rows[here]] * (body.skin == number)
        felt = own @ body.places / own.sum(axis=1)[:, None]
        to_link = turn[here, number].swapaxes(1, 2)
        shift = np.einsum("nab,nb->na", to_link, origin[here, -1] - origin[here, number])
        for points in options.points:
            near, place = explained(
                to_link @ turn[here, -1], shift, felt, target[rows[here]], points
            )
            print(f"{name:12}{points:3} points: near {near:.2f}, place {place:.1f} %", flush=True)


if __name__ == "__main__":
    main()
