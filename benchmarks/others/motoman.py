"""The arms of a real Motoman from touches of each other, beside a laser tracker; a script.

    python benchmarks/others/motoman.py PATH

PATH is the folder `UserData/Robots/Motoman/Dataset/leica_dataset` of the public repository
ctu-vras/multirobot-calibration, which has no licence: it is read where it is. In 566 postures the
icosahedra in both hands touched, so their centres were 116 mm apart. A laser tracker saw a
reflector on the right hand in 216 other postures, and one on the left hand.

One distance of two single tips does not tell a body: if all axes of each arm meet in its tip,
every distance is right. So axes and points on them begin as the repository describes them, and
leave that only as far as touches ask for (a prior of one degree and 5 mm). The tracker is fitted
likewise, with its own frame and its reflector free. The table has, for each fold of
held-out touches,

- touch: root mean square error of the held-out distances, mm, as described and by touch;
- tracker: that of the reflector's places, mm, its frame and its mount fitted and nothing else;
- axes: degrees between the axes by touch and by the tracker, median and worst of the joints that
  both tell; described_axes: those between the description and the tracker.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from sys import path as search_path

import numpy as np
import scipy.io
from nao_scores import dh_motion
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

search_path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.results import add_update_option, results

# Rows of the repository's Denavit-Hartenberg tables (`loadMotoman.m`): a, d in m, alpha, offset.
_QUARTER = np.pi / 2


def _rows(side: int) -> list[tuple[float, float, float, float]]:
    return [
        (0, -0.263, np.radians(15) * side, -_QUARTER),
        (0.150, 1.4159, -_QUARTER, 0),
        (0.614, 0, np.pi, -_QUARTER),
        (0.200, 0, -_QUARTER, 0),
        (0, -0.640, _QUARTER, 0),
        (0.030, 0, _QUARTER, -_QUARTER),
        (0, 0.200, 0, 0),
        (0, 0.354, 0, 0),
    ]


DH = {"right": _rows(1), "left": _rows(-1)}
# Columns of the turning base and of each arm, and of the reflector's place.
COLUMNS = {"right": [6, *range(7, 13)], "left": [6, *range(13, 19)]}
REFLECTOR = slice(19, 22)
SELF = [
    f"{leica}_self_{place}{number}_4x4_dataset.mat"
    for leica in ("leica", "no_leica")
    for place in ("upper", "lower")
    for number in (1, 2)
]
#: m, of the icosahedra's centres.
APART = 0.116
FOLDS = 5
# What one standard deviation of the prior is, and of a touch and of the tracker with its robot.
_DEGREES, _CENTRE, _TOUCH, _TRACKED = np.radians(1.0), 0.005, 0.001, 0.001
# The joints between the two tips: the base turns both arms alike.
_ARM = slice(1, 7)


def postures(path: Path, name: str) -> np.ndarray:
    """Rows of a file, one for each posture: a camera's markers repeat them."""
    table = scipy.io.loadmat(path / name)["dataset"]
    return table[np.unique(table[:, 0], return_index=True)[1]]


class Arm:
    """Axes, points on them and a tip as described, and how far they moved from there.

    A vector holds `(7, 3)` turns of the axes, `(7, 3)` shifts of the points, `(3,)` of the tip.
    """

    size = 45

    def __init__(self, side: str):
        frame, axes, points = np.eye(4), [], []
        for row in DH[side]:
            axes.append(frame[:3, 2])
            points.append(frame[:3, 3])
            frame = frame @ dh_motion(row)
        self.axes, self.points, self.tip = np.array(axes[:7]), np.array(points[:7]), frame[:3, 3]

    def turned(self, vector: np.ndarray) -> np.ndarray:
        """`(7, 3)` axes."""
        turns = Rotation.from_rotvec(vector[:21].reshape(7, 3)).as_matrix()
        return np.einsum("nab,nb->na", turns, self.axes)

    def places(self, vector: np.ndarray, q: np.ndarray, tip: np.ndarray | None = None):
        """`(n, 3)` m of the tip in `(n, 7)` postures."""
        axes, points = self.turned(vector), self.points + vector[21:42].reshape(7, 3)
        end = self.tip + vector[42:] if tip is None else tip
        place = np.broadcast_to(end, (len(q), 3))
        for joint in range(6, -1, -1):
            turn = Rotation.from_rotvec(q[:, joint, None] * axes[joint])
            place = turn.apply(place - points[joint]) + points[joint]
        return place

    @staticmethod
    def prior(vector: np.ndarray) -> np.ndarray:
        """Residuals of what moved."""
        return np.concatenate([vector[:21] / _DEGREES, vector[21:42] / _CENTRE, vector[42:] / 0.02])


def by_touch(arms: Sequence[Arm], q: Sequence[np.ndarray]) -> np.ndarray:
    """`(90,)` both arms."""

    def residuals(both: np.ndarray) -> np.ndarray:
        off = (distances(arms, both, q) - APART) / _TOUCH
        return np.concatenate([off, *(Arm.prior(part) for part in np.split(both, 2))])

    # Touches with a wrong posture count little.
    return least_squares(residuals, np.zeros(2 * Arm.size), loss="soft_l1", max_nfev=25).x


def distances(arms: Sequence[Arm], both: np.ndarray, q: Sequence[np.ndarray]) -> np.ndarray:
    """`(n,)` m between the tips."""
    first, second = (
        arm.places(part, own) for arm, part, own in zip(arms, np.split(both, 2), q, strict=True)
    )
    return np.linalg.norm(first - second, axis=1)


def tracked(arm: Arm, vector: np.ndarray, q: np.ndarray, seen: np.ndarray, *, free: bool):
    """Off-sets `(n, 3)` m of the reflector, and the vector: moved as well, if `free`."""
    start = np.concatenate([vector, arm.tip, np.zeros(3), np.zeros(3)])
    # A frame from places as they are.
    own = arm.places(vector, q)
    turn, _ = Rotation.align_vectors(seen - seen.mean(axis=0), own - own.mean(axis=0))
    start[-6:-3], start[-3:] = turn.as_rotvec(), seen.mean(axis=0) - turn.apply(own.mean(axis=0))

    def off(moved: np.ndarray) -> np.ndarray:
        place = arm.places(moved[: Arm.size], q, moved[Arm.size : Arm.size + 3])
        return Rotation.from_rotvec(moved[-6:-3]).apply(place) + moved[-3:] - seen

    def residuals(part: np.ndarray) -> np.ndarray:
        moved = part if free else np.concatenate([vector, part])
        told = off(moved).ravel() / _TRACKED
        return np.concatenate([told, Arm.prior(moved[: Arm.size])])

    begun = start if free else start[Arm.size :]
    found = least_squares(residuals, begun, loss="soft_l1", max_nfev=25).x
    found = found if free else np.concatenate([vector, found])
    return off(found), found[: Arm.size]


def rms(off: np.ndarray) -> float:
    """mm; of `(n,)` or `(n, 3)` m."""
    return 1e3 * float(np.sqrt((off.reshape(len(off), -1) ** 2).sum(axis=1).mean()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path, help="folder leica_dataset")
    parser.add_argument("--folds", nargs="*", type=int, default=list(range(FOLDS)))
    add_update_option(parser, "motoman")
    given = parser.parse_args()
    touched = np.concatenate([postures(given.path, name) for name in SELF])
    arms, none = [Arm("right"), Arm("left")], np.zeros(2 * Arm.size)
    hands = []
    for arm, side in zip(arms, ("right", "left"), strict=True):
        table = postures(given.path, f"leica_{side}_hand_6x6x6_dataset.mat")
        table = table[np.isfinite(table[:, REFLECTOR]).all(axis=1)]
        q, seen = table[:, COLUMNS[side]], table[:, REFLECTOR]
        described, _ = tracked(arm, np.zeros(Arm.size), q, seen, free=False)
        own, vector = tracked(arm, np.zeros(Arm.size), q, seen, free=True)
        hands.append((q, seen, vector))
        print(
            f"{side} hand, {len(q)} postures of the tracker: {rms(described):.2f} mm as described, "
            f"{rms(own):.2f} mm fitted to the tracker"
        )
    described = rms(distances(arms, none, _of(touched)) - APART)
    print(f"{len(touched)} touches; as described {described:.2f} mm")
    fold_of = np.random.default_rng(0).permutation(len(touched)) % FOLDS
    with results("motoman", update=given.update) as add:
        for fold in given.folds:
            train, test = touched[fold_of != fold], touched[fold_of == fold]
            both = by_touch(arms, _of(train))
            row: dict[str, object] = {"fold": fold}
            for name, one in (("touch_described_mm", none), ("touch_mm", both)):
                row[name] = round(rms(distances(arms, one, _of(test)) - APART), 2)
            for side, arm, part, (q, seen, vector) in zip(
                COLUMNS, arms, np.split(both, 2), hands, strict=True
            ):
                row[f"{side}_tracker_mm"] = round(
                    rms(tracked(arm, part, q, seen, free=False)[0]), 2
                )
                true = arm.turned(vector)[_ARM]
                for name, own in (("axes", arm.turned(part)), ("described_axes", arm.axes)):
                    off = _degrees(own[_ARM], true)
                    row[f"{side}_{name}_deg"] = round(float(np.median(off)), 2)
                    row[f"{side}_{name}_worst_deg"] = round(float(off.max()), 2)
            print(row, flush=True)
            add(row)


def _of(table: np.ndarray) -> list[np.ndarray]:
    """Postures of the right arm and of the left one."""
    return [table[:, columns] for columns in COLUMNS.values()]


def _degrees(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((first * second).sum(axis=1), -1, 1)))


if __name__ == "__main__":
    main()
