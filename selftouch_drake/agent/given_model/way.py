"""The joints between a skin and what touches it, as a file gives them, and what may be wrong."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.body_model.chain import adjoint, exponentials, places

# An axis is one of its frame's own if a component is so near to 1.
_PRINCIPAL = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One number of a file that may be wrong: how a frame lies on the one that carries it.

    Attributes:
        frame: name of the joint whose origin changes; that of the toucher's mount likewise.
        number: of the joint on the way, or L for the toucher.
        turns: whether the frame turns, rad, or shifts, m.
        direction: `(3,)` unit vector in the frame.
        label: of the direction, `x` or `across 1` for instance.
        own: whether the direction is that of the joint's own axis.
        slides: whether the joint slides.
    """

    frame: str
    number: int
    turns: bool
    direction: np.ndarray
    label: str
    own: bool = False
    slides: bool = False

    @property
    def is_offset(self) -> bool:
        """Whether the change is one of what the joint reads."""
        return self.own and self.turns != self.slides

    @property
    def unit(self) -> str:
        """Of its amount: rad or m."""
        return "rad" if self.turns else "m"

    @property
    def text(self) -> str:
        """What changes, in a few words."""
        if self.is_offset:
            return "offset"
        return f"{'turn about' if self.turns else 'shift along'} {self.label}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GivenWay:
    """L joints from a link that wears skin to a toucher: first up, and then down.

    With the frame of a joint is meant the frame of its child link where it reads 0; it moves along
    or about an axis there. Up and down begin at the link that carries both.

    Attributes:
        names: `(L,)` of the joints, that next to the skin first.
        slides: `(L,)` bool, whether the joint slides or turns.
        axes: `(L, 3)` unit vectors, in the joint's frame.
        signs: `(L,)` -1 for the joints that are passed backwards, which come first, else 1.
        origins: `(L, 4, 4)` m, each joint's frame on that which the joint nearer to the common link
            moves.
        skin: `(4, 4)` m, the skin's frame on that which the last joint before it moves.
        toucher: `(4, 4)` m, the toucher's frame likewise.
        mount: name of the joint whose origin places the toucher; empty if there is none.
    """

    names: tuple[str, ...]
    slides: np.ndarray
    axes: np.ndarray
    signs: np.ndarray
    origins: np.ndarray
    skin: np.ndarray
    toucher: np.ndarray
    mount: str

    def changes(self) -> list[Change]:
        """What may be wrong: each joint's frame, and the toucher's place."""
        found = []
        for number, (name, axis) in enumerate(zip(self.names, self.axes, strict=True)):
            for label, direction in _directions(axis):
                own = bool(abs(direction @ axis) > 0.5)
                found += [
                    Change(frame=name, number=number, turns=turns, direction=direction,
                           label=label, own=own, slides=bool(self.slides[number]))
                    for turns in (True, False)
                ]  # fmt: skip
        if self.mount:
            found += [
                Change(frame=self.mount, number=len(self.names), turns=False,
                       direction=np.eye(3)[axis], label="xyz"[axis])
                for axis in range(3)
            ]  # fmt: skip
        return found

    def changed(self, changes: Sequence[Change], amounts: np.ndarray) -> "GivenWay":
        """The way with some changes made."""
        turn, shift = np.zeros((2, len(self.names) + 1, 3))
        for change, amount in zip(changes, amounts, strict=True):
            (turn if change.turns else shift)[change.number] += amount * change.direction
        moves = exponentials(np.concatenate([turn, np.zeros_like(turn)], axis=1))
        moves[:, :3, 3] = shift
        return replace(self, origins=self.origins @ moves[:-1], toucher=self.toucher @ moves[-1])

    def frames(self) -> tuple[np.ndarray, np.ndarray]:
        """`(L, 4, 4)` and `(4, 4)` poses of the joints' and the toucher's frames, all reading 0.

        They are in the frame of the skin's link, m.
        """
        poses = np.empty_like(self.origins)
        num_up = int((self.signs < 0).sum())
        ends = []
        for chain, end in (
            (range(num_up)[::-1], self.skin),
            (range(num_up, len(self.names)), self.toucher),
        ):
            X = np.eye(4)
            for joint in chain:
                X = poses[joint] = X @ self.origins[joint]
            ends.append(X @ end)
        back = np.linalg.inv(ends[0])
        return back @ poses, back @ ends[1]

    def twists(self) -> tuple[np.ndarray, np.ndarray]:
        """`(L, 6)` twists and the `(3,)` place of the toucher, all reading 0, m, as in `frames`."""
        poses, toucher = self.frames()
        still = np.zeros_like(self.axes)
        slides = self.slides[:, None]
        local = np.where(slides, np.c_[still, self.axes], np.c_[self.axes, still])
        twists = [adjoint(pose, twist) for pose, twist in zip(poses, local, strict=True)]
        return np.array(twists).reshape(-1, 6), toucher[:3, 3]

    def places(self, q: np.ndarray) -> np.ndarray:
        """`(n, 3)` m, places of the toucher in the frame of the skin's link at `q` `(n, L)`."""
        twists, point = self.twists()
        return places(q, twists, point, self.signs)

    def behind(self, q: np.ndarray, apart: float) -> np.ndarray:
        """`(n, 3)` m, places of a point behind the toucher, farther from it than `apart`.

        It is the origin of the last such joint on the way, or of the common link.
        """
        poses, toucher = self.frames()
        twists, _ = self.twists()
        far = np.linalg.norm(poses[:, :3, 3] - toucher[:3, 3], axis=1) > apart
        joint = max(np.flatnonzero(far), default=-1)
        passed = joint + 1 if joint >= 0 else 0
        point = poses[joint, :3, 3] if joint >= 0 else np.zeros(3)
        return places(q[:, :passed], twists[:passed], point, self.signs[:passed])


def _directions(axis: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Three directions at right angles, the axis one of them, and what they are called."""
    size = np.abs(axis)
    if size.max() > 1.0 - _PRINCIPAL:
        return [(letter, np.eye(3)[n]) for n, letter in enumerate("xyz")]
    first = np.cross(axis, np.eye(3)[int(size.argmin())])
    first /= np.linalg.norm(first)
    return [("its axis", axis), ("across 1", first), ("across 2", np.cross(axis, first))]
