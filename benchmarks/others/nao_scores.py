"""Part of `nao.py`: the touches of the Nao's files, and a found body beside the nominal one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.io
from scipy.spatial.transform import Rotation

from selftouch_drake.agent.body_model.both_sides.problem import Body, Population, shares
from selftouch_drake.agent.body_model.both_sides.recordings import Layout, Recording
from selftouch_drake.agent.body_model.both_sides.start import any_turns

# The modules of each skin: those of its first patch, then those of its second.
ARM = ([*range(16)], [19, 20, 21, 22, 23, 25, 26, 31])
MODULES = {
    "torso": ([*range(6), *range(8, 16)], [16, 17, 18, *range(24, 32)]),
    "head": ([*range(9), 12, 13, 15], [*range(16, 25), 28, 29, 31]),
    "leftArm": ARM,
    "rightArm": ARM,
}
# A module has ten taxels and two sensors of temperature.
TAXELS = (0, 1, 2, 3, 4, 5, 7, 8, 9, 11)
NUM_TAXELS = 384
# Joints as the files sort them: by name.
OF_ARM = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
OF_HEAD = ("HeadYaw", "HeadPitch")
JOINTS = sorted([*(side + joint for side in "LR" for joint in OF_ARM), *OF_HEAD])
LEFT, RIGHT = ([JOINTS.index(side + joint) for joint in OF_ARM] for side in "LR")
HEAD = [JOINTS.index(joint) for joint in OF_HEAD]
HOLDER = {
    "leftArm": "left",
    "leftFinger": "left",
    "rightArm": "right",
    "rightFinger": "right",
    "head": "head",
    "torso": "",
}
LAYOUT = Layout(
    limbs={"right": RIGHT, "left": LEFT, "head": HEAD},
    holder=HOLDER,
    mirrored=(("right", "left"),),
)
# mm, roughly: where a fit of the nominal description begins.
CONTACT = 30.0
# Files that are fitted: `head_leftFinger` is 27 mm off even by the nominal description.
HANDS = ("leftArm_rightFinger", "rightArm_leftFinger")
FITTED = (
    *("torso_rightFinger", "rightArm_torso", "rightArm_head"),
    *("torso_leftFinger", "leftArm_torso", "leftArm_head"),
    *HANDS,
)
# Rows of the repository's Denavit-Hartenberg tables (`loadNAO.m`): a, d in mm, alpha, offset.
_QUARTER = np.pi / 2


def _arm_rows(side: int) -> list[tuple[float, float, float, float]]:
    return [
        (0, 100, -_QUARTER, 0),
        (0, 98 * side, _QUARTER, 0),
        (0, 0, _QUARTER, _QUARTER),
        (15 * side, 105, -_QUARTER, 0),
        (0, 0, _QUARTER, 0),
        (0, 55.95, -_QUARTER, np.pi),
    ]


DH = {
    "left": _arm_rows(1),
    "right": _arm_rows(-1),
    "head": [(0, 126.5, 0, 0), (0, 0, -_QUARTER, 0), (0, 0, 0, 0)],
}
# Mounts of the skins, from the same file: m, and a turn as a vector in rad.
MOUNTS = {
    "rightArm": (-0.0292, -0.0300, -0.0222, -0.5452, 1.7668, 1.9904),
    "leftArm": (0.0295, -0.0682, -0.0259, 1.5291, 0.5315, -0.4926),
    "torso": (0.0646, 0.0006, 0.0468, -0.0012, 0.0427, 0.0005),
    "head": (0.0597, -0.0704, -0.0013, 1.5512, -0.2112, -0.2574),
}


def filed_positions(path: Path, skin: str) -> np.ndarray:
    """`(384, 3)` mm, NaN where there is no taxel: sums of mount, patch, module and taxel."""
    shifts = 1e3 * np.loadtxt(path / "Transformations" / f"{skin}.txt")
    first, second = MODULES[skin]
    modules, taxels = [*first, *second], shifts[3 + len(first) + len(second) :]
    positions = np.full((NUM_TAXELS, 3), np.nan)
    for number, module in enumerate(modules):
        corner = shifts[1 if number < len(first) else 2] + shifts[3 + number]
        own = taxels[len(TAXELS) * number :][: len(TAXELS)]
        positions[12 * module + np.array(TAXELS)] = corner + own
    return positions


def touches(path: Path, name: str, skin: str) -> tuple[np.ndarray, np.ndarray]:
    """`(n, 12)` rad joints, and `(n, 384)` bool taxels of one skin that were on."""
    file = scipy.io.loadmat(path / "Datasets" / f"{name}.mat", simplify_cells=True)
    joints, active = [], np.zeros((len(file[skin]), NUM_TAXELS), dtype=bool)
    for row, touch in zip(active, file[skin], strict=True):
        if "activatedUn" in touch:  # the older files have places, then the number
            on = np.atleast_2d(touch["activatedUn"]).reshape(-1, 4)[:, 3]
        else:
            on = np.atleast_1d(touch["activatedTaxels"])
        row[on.astype(int)] = True
        joints.append([touch["angles"][joint] for joint in sorted(touch["angles"])])
    return np.array(joints), active


def recording(path: Path, name: str) -> Recording:
    """Touches of one file that every skin in it felt."""
    one, other = name.split("_")
    if "Finger" in other:
        (q, below), above, ends = touches(path, name, one), None, (other, one)
        felt = below.any(axis=1)
    else:
        (q, above), (_, below) = touches(path, name, one), touches(path, name, other)
        felt, ends = above.any(axis=1) & below.any(axis=1), (one, other)
    whole = Recording(
        name=name, above=ends[0], below=ends[1], q=q, felt_above=above, felt_below=below
    )
    return whole.some(np.flatnonzero(felt))


def dh_motion(row: tuple[float, float, float, float]) -> np.ndarray:
    """`(4, 4)` motion of one row of a Denavit-Hartenberg table, its joint at 0."""
    a, d, alpha, theta = row
    (ct, st), (ca, sa) = (np.cos(theta), np.sin(theta)), (np.cos(alpha), np.sin(alpha))
    return np.array(
        [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
    )


def nominal_axes(limb: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`(L, 3)` axes, `(L, 3)` mm points on them, and the `(4, 4)` frame of the limb's end."""
    frame, axes, points = np.eye(4), [], []
    for row in DH[limb]:
        axes.append(frame[:3, 2])
        points.append(frame[:3, 3])
        frame = frame @ dh_motion(row)
    # The first row of each limb is fixed: a joint turns about the axis of the row before its own.
    return np.array(axes)[1:], np.array(points)[1:], frame


def mount(skin: str) -> np.ndarray:
    """`(4, 4)` filed mount of a skin, mm."""
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(MOUNTS[skin][3:]).as_matrix()
    motion[:3, 3] = 1e3 * np.array(MOUNTS[skin][:3])
    return motion


def similarity(
    source: np.ndarray, target: np.ndarray, weight: np.ndarray, hand: int | None = None
) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, `(3, 3)` turn and shift: `scale * source @ turn + shift`; `hand` -1 mirrors."""
    weight = weight / weight.sum()
    here, there = weight @ source, weight @ target
    u, s, vt = np.linalg.svd(((source - here) * weight[:, None]).T @ (target - there))
    sign = np.ones(3)
    if hand is not None:
        sign[2] = hand * np.sign(np.linalg.det(u @ vt))
    turn = u * sign @ vt
    scale = (s * sign).sum() / (weight @ ((source - here) ** 2).sum(axis=1))
    return scale, turn, there - scale * here @ turn


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Score:
    """A body beside the nominal description.

    Attributes:
        axes: degrees of each joint's axis, for each limb.
        gaps: mm of each nominal joint's centre from the line that was found.
        held_out: mm medians by file.
        shuffled: the same, sensations below exchanged between touches.
        taxels: mm root mean square distance from the filed places, by skin, after a similarity.
        unit: mm of a contact's diameter.
        hand: 1, or -1 for the mirror image.
        centres: `(L, 3)` mm in the nominal frame: of each found line, the point nearest to the
            nominal joint.
        directions: `(L, 3)` found axes in that frame.
        places: `(n, 3)` mm of each skin's taxels in that frame, all joints at 0.
    """

    axes: dict[str, list[float]]
    gaps: dict[str, list[float]]
    held_out: dict[str, float]
    shuffled: dict[str, float]
    taxels: dict[str, float]
    unit: float
    hand: int
    centres: dict[str, np.ndarray]
    directions: dict[str, np.ndarray]
    places: dict[str, np.ndarray]

    def worst(self, *limbs: str) -> float:
        """Worst axis of some limbs."""
        return max(max(self.axes[limb]) for limb in limbs)


def scored(body: Body, row: np.ndarray, held_out: list[Recording], path: Path) -> Score:
    """A body beside the nominal one, in the frame that its torso's taxels give.

    Length and frame of a found body are its own: its scale is the one that makes the extent of
    the torso's taxels that of the filed ones, its frame the rigid one that lays them over the
    filed ones, or their mirror image, whichever brings the axes nearer.
    """
    placed = {skin: _placed(body, row, skin, path) for skin in body.skins}
    taxels = {}
    for skin, (own, filed, _) in placed.items():
        scale, turn, shift = similarity(own, filed, np.ones(len(own)))
        taxels[skin] = float(np.sqrt(((scale * own @ turn + shift - filed) ** 2).sum(1).mean()))
    own, filed, weight = placed["torso"]
    unit = float(np.sqrt(filed.var(axis=0).sum() / own.var(axis=0).sum()))
    frames = [Frame.over(own, filed, weight, hand) for hand in (1, -1)]
    best = min((_beside_nominal(body, row, frame) for frame in frames), key=_mean_angle)
    medians = {
        shuffle: {
            one.name: unit * float(np.median(apart(body, row, one, shuffle=shuffle)))
            for one in held_out
        }
        for shuffle in (False, True)
    }
    return Score(
        axes=best.angles, gaps=best.gaps, hand=best.frame.hand, held_out=medians[False],
        shuffled=medians[True], taxels=taxels, unit=unit, centres=best.centres,
        directions=best.directions,
        places={skin: best.frame.points(body.places(row, skin)) for skin in body.skins},
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """From a body's own frame and unit to the nominal frame: the torso's base, in mm."""

    scale: float
    turn: np.ndarray
    shift: np.ndarray
    hand: int

    @staticmethod
    def over(own: np.ndarray, filed: np.ndarray, weight: np.ndarray, hand: int) -> Frame:
        """Lays the torso's taxels over the filed ones."""
        scale, turn, shift = similarity(own, filed, weight, hand)
        motion = mount("torso")
        there = shift @ motion[:3, :3].T + motion[:3, 3]
        return Frame(scale=scale, turn=turn @ motion[:3, :3].T, shift=there, hand=hand)

    def points(self, points: np.ndarray) -> np.ndarray:
        return self.scale * points @ self.turn + self.shift

    def axes(self, axes: np.ndarray) -> np.ndarray:
        """A mirror image turns the other way round."""
        return self.hand * axes @ self.turn


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Beside:
    frame: Frame
    angles: dict[str, list[float]]
    gaps: dict[str, list[float]]
    centres: dict[str, np.ndarray]
    directions: dict[str, np.ndarray]


def _mean_angle(beside: _Beside) -> float:
    return float(np.mean(np.concatenate(list(beside.angles.values()))))


def apart(body: Body, row: np.ndarray, one: Recording, *, shuffle: bool = False) -> np.ndarray:
    """`(t,)` distance between what touched and what was touched, in the body's own unit."""
    rows, above, below = shares(body.skins, one)
    if shuffle:
        below = below[np.random.default_rng(0).permutation(len(below))]
    ends = []
    for end, share in ((one.above, above), (one.below, below)):
        point = share @ body.coefficients(row, end).astype(float)
        for joint in reversed(body.layout.joints(end)):
            axis = body.axes(row)[joint].astype(float)
            turn = Rotation.from_rotvec(
                one.q[rows, joint][:, None] * axis / np.linalg.norm(axis)
            ).as_matrix()
            centre = body.centres(row)[joint].astype(float)
            point = np.einsum("nij,nj->ni", turn, point - centre) + centre
        ends.append(point)
    return np.linalg.norm(ends[0] - ends[1], axis=1)


def _placed(
    body: Body, row: np.ndarray, skin: str, path: Path
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of taxels felt five times: own places, filed ones in mm, how often they were felt."""
    known, filed = body.skins[skin], filed_positions(path, skin)[body.skins[skin].receptor]
    usable = (known.felt >= 5) & np.isfinite(filed[:, 0])
    return body.places(row, skin)[usable], filed[usable], known.felt[usable].astype(float)


def _beside_nominal(body: Body, row: np.ndarray, frame: Frame) -> _Beside:
    angles, gaps, centres, directions = {}, {}, {}, {}
    for limb, joints in body.layout.limbs.items():
        own = body.axes(row)[list(joints)].astype(float)
        own = frame.axes(own / np.linalg.norm(own, axis=1, keepdims=True))
        centre = frame.points(body.centres(row)[list(joints)].astype(float))
        nominal, point, _ = nominal_axes(limb)
        cosine = np.clip((own * nominal).sum(axis=1), -1, 1)
        centre = centre + ((point - centre) * own).sum(axis=1)[:, None] * own
        angles[limb] = np.degrees(np.arccos(cosine)).tolist()
        gaps[limb] = np.linalg.norm(point - centre, axis=1).tolist()
        centres[limb], directions[limb] = centre, own
    return _Beside(frame=frame, angles=angles, gaps=gaps, centres=centres, directions=directions)


def nominal_bodies(body: Body, number: int, random: np.random.Generator, path: Path) -> Population:
    """Bodies as the repository describes them, with the skins of the arms turned at random.

    The filed mounts of the arms are some 30 mm off, so where these skins are is looked for.
    """
    rows = np.zeros((number, body.length), dtype=np.float32)
    frames = {"": np.eye(4)}
    for limb, joints in LAYOUT.limbs.items():
        axes, points, frames[limb] = nominal_axes(limb)
        body.axes(rows)[:, list(joints)] = axes
        body.centres(rows)[:, list(joints)] = points / CONTACT
    for end in body.ends:
        frame, own = frames[HOLDER[end]], body.coefficients(rows, end)
        wrist = frame[:3, 3] / CONTACT + 0.7 * random.normal(size=(number, 3))
        if end in body.points:
            own[:, 0] = wrist
            continue
        skin = body.skins[end]
        filed = filed_positions(path, end)[skin.receptor]
        known = np.isfinite(filed[:, 0])
        if end in ("torso", "head"):
            motion = frame @ mount(end)
            own[:] = _fitted(skin.basis, filed @ motion[:3, :3].T + motion[:3, 3], known)
        else:
            shape = _fitted(skin.basis, filed - filed[known].mean(axis=0), known)
            own[:] = shape @ any_turns(number, random)
            own[:, 0] += wrist
    orders = np.tile(np.arange(len(JOINTS)), (number, 1))
    return Population(rows=rows, orders=orders, loss=np.full(number, np.nan))


def _fitted(basis: np.ndarray, place: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Coefficients of places in mm, with a little damping."""
    own = basis[known]
    damped = own.T @ own + 1e-2 * np.eye(basis.shape[1])
    return np.linalg.solve(damped, own.T @ place[known]) / CONTACT
