"""An animation of a skeleton that grows from 40 touches to 300. Run it as a script.

    python benchmarks/make/growing.py --out docs/images/growing.gif

From the first touches of a random walk a chain of joints is found, anew for each frame. Drawn are
its axes with the links between them in one posture, pale ones drawn from their standard errors, and
where the chain places 1,500 later touches. All frames are laid on the last one by a similarity, as
touch tells no place, size or handedness. Printed are, for each frame, whether touches left out in
turn accept the chain, and how far its places are from those of the last frame.
"""

from __future__ import annotations

import argparse
import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.chain import adjoint, exponentials, places
from selftouch_drake.agent.body_model.few import FewFound, found_by_sensation
from selftouch_drake.agent.body_model.structure import Search
from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.experience.collect import collect_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.show.style import BLUE, PALE, styled

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

#: What is drawn by default.
BODY, SEED, TOUCHES = "cube", 21, (40, 60, 100, 150, 300)
# Later touches that are drawn, chains that show how unsure one is, milliseconds for each frame.
_CLOUD, _UNSURE, _SHOWN = 1500, 12, 500


@dataclass(frozen=True)
class Frame:
    """A chain from so many touches, over all standardised joints in its order."""

    number: int
    found: FewFound
    twists: np.ndarray
    point: np.ndarray

    def places(self, q: np.ndarray) -> np.ndarray:
        """`(n, 3)` of `(n, J)` standardised readings."""
        return places(q[:, self.found.order], self.twists, self.point)

    def skeletons(self, q: np.ndarray, random: np.random.Generator) -> list[np.ndarray]:
        """`(L + 1, 3)` corners of the arm in posture `(J,)` q: its own, then unsure ones."""
        order = self.found.order
        own = [6 * joint + entry for joint in order for entry in range(6)]
        own += [len(self.found.spread) - 3 + axis for axis in range(3)]
        spread = self.found.spread[np.ix_(own, own)]
        mean = np.append(self.twists.ravel(), self.point)
        values, vectors = np.linalg.eigh((spread + spread.T) / 2)
        root = vectors * np.sqrt(np.maximum(values, 0))
        drawn = mean + random.standard_normal((_UNSURE, len(mean))) @ root.T
        return [_corners(one[:-3].reshape(-1, 6), one[-3:], q[order]) for one in (mean, *drawn)]


def _corners(twists: np.ndarray, point: np.ndarray, q: np.ndarray) -> np.ndarray:
    """`(L + 1, 3)` from axis to axis, each where it comes nearest to the corner after it."""
    motion, moved = np.eye(4), []
    for twist, reading in zip(twists, q, strict=True):
        moved.append(adjoint(motion, twist[None])[0])
        motion = motion @ exponentials(twist[None] * reading)[0]
    corners = [motion[:3, :3] @ point + motion[:3, 3]]
    for twist in moved[::-1]:
        w, v = twist[:3], twist[3:]
        if np.linalg.norm(w) < 1e-9:
            continue  # a slide has no place
        on_axis = np.cross(w, v) / (w @ w)
        corners.append(on_axis + w * (w @ (corners[-1] - on_axis)) / (w @ w))
    return np.array(corners)


def similarity(source: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(3, 3)` A and `(3,)` b: `source @ A + b` lies on the goal, mirrored if need be."""
    a, b = source - source.mean(axis=0), goal - goal.mean(axis=0)
    U, size, Vt = np.linalg.svd(a.T @ b)
    A = U @ Vt * size.sum() / (a**2).sum()
    return A, goal.mean(axis=0) - source.mean(axis=0) @ A


def frames(name: str, seed: int, numbers: list[int]) -> tuple[list[Frame], np.ndarray]:
    """Chains from first touches of a walk, and `(n, J)` standardised readings of later ones."""
    world = World(load_experiment(name, {"seed": seed}))
    shard = collect_walk(DrakeBodies(world).babbling, world.experiment, 0, max(numbers) + _CLOUD)
    q = (shard.q - shard.q.mean(axis=0)) / shard.q.std(axis=0)
    made = []
    for number in numbers:
        some = np.ascontiguousarray(q[:number].T.astype(np.float32))
        found = found_by_sensation(
            Search(some, np.random.default_rng(seed), scale=np.ones(q.shape[1])),
            q[:number].astype(float),
            csr_array(shard.sensation[:number].astype(float)),
            list(range(q.shape[1])),
        )
        if found is not None:
            made.append(Frame(number, found, found.twists[found.order], found.point))
    return made, q[max(numbers) :].astype(float)


@styled
def picture(frame: Frame, cloud: np.ndarray, arms: list[np.ndarray], reach: np.ndarray) -> Figure:
    """One frame."""
    figure = Figure(figsize=(5.0, 4.6), layout="constrained")
    ax = figure.add_subplot(projection="3d")
    ax.scatter(*cloud.T, s=2, color=PALE, depthshade=False)
    for arm in arms[:0:-1]:
        ax.plot(*arm.T, color=BLUE, alpha=0.15, linewidth=1)
    ax.plot(*arms[0].T, "o-", color=BLUE, linewidth=2.5, markersize=4)
    ax.set(xlim=reach[:, 0], ylim=reach[:, 1], zlim=reach[:, 2], box_aspect=(1, 1, 1))
    ax.set_axis_off()
    verdict = "accepted" if frame.found.judgement.accepted else "not yet"
    ax.set_title(f"{frame.number} touches: {verdict}")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--body", default=BODY)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--touches", nargs="+", type=int, default=TOUCHES)
    parser.add_argument("--out", type=Path, default=Path("docs/images/growing.gif"))
    args = parser.parse_args()
    draw(args.body, args.seed, sorted(args.touches), args.out)


def draw(body: str, seed: int, touches: Sequence[int], out: Path) -> None:
    """Writes the animation of a body and a seed, a frame for each number of touches."""
    made, q = frames(body, seed, touches)
    last = made[-1].places(q)
    middle, size = last.mean(axis=0), 0.9 * np.abs(last - last.mean(axis=0)).max()
    reach = np.stack([middle - size, middle + size])
    posture = q[np.linalg.norm(last - middle, axis=1).argmax()]
    drawn = []
    for frame in made:
        A, b = similarity(frame.places(q), last)
        cloud = frame.places(q) @ A + b
        arms = [arm @ A + b for arm in frame.skeletons(posture, np.random.default_rng(0))]
        off = np.sqrt(((cloud - last) ** 2).sum(axis=1).mean())
        share = off / np.linalg.norm(np.ptp(last, axis=0))
        verdict = "accepted" if frame.found.judgement.accepted else "not yet"
        print(
            f"{frame.number} touches: {verdict}, {share:.2%} of the extent from the last",
            flush=True,
        )
        file = io.BytesIO()
        picture(frame, cloud, arms, reach).savefig(file, dpi=80, format="png")
        drawn.append(Image.open(file).convert("RGB").quantize(64, dither=Image.Dither.NONE))
    shown = [_SHOWN] * (len(drawn) - 1) + [4 * _SHOWN]
    drawn[0].save(out, save_all=True, append_images=drawn[1:], duration=shown, loop=0, disposal=2)


if __name__ == "__main__":
    main()
