"""What the agent remembers: links on which it lost contact, and slides that kept it."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.records import Record
from selftouch_drake.agent.representation.quotient import QuotientRepresentation

#: A link on which contact was lost costs this many times more from then on.
LOSS_FACTOR = 8.0
# Six losses: beyond that a link is as good as cut, and the costs stay far from overflow.
_MOST_PENALTY = LOSS_FACTOR**6

#: A loss of an imagined touch adds this to the pressure of later plans, up to the second number; in
#: distances of kernels.
PRESSED_MORE, MOST_PRESSED = 0.1, 0.3

# mu, tolerance for stored float32 configurations.
_SAME = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slides(Record):
    """Ways from one touch to another along which the agent slid.

    N slides through M configurations of J joints in all, scaled (mu).

    Attributes:
        ends: `(N, 2, J)` first and last configuration of each slide.
        offsets: `(N + 1,)` slide n passes rows `offsets[n]:offsets[n + 1]` of `x`.
        x: `(M, J)` touching configurations in between.
        node: `(M,)` the kernel that is felt at each.
    """

    prefix = "slide_"

    ends: np.ndarray
    offsets: np.ndarray
    x: np.ndarray
    node: np.ndarray

    @classmethod
    def none(cls, num_joints: int) -> "Slides":
        """No slides."""
        return cls(
            ends=np.empty((0, 2, num_joints)),
            offsets=np.zeros(1, dtype=int),
            x=np.empty((0, num_joints)),
            node=np.empty(0, dtype=int),
        )

    def check(self, num_joints: int, num_kernels: int) -> None:
        """As `check_arrays`: these are slides of so many joints between so many kernels."""
        num_x = len(np.atleast_1d(self.x))
        shapes = {"offsets": (self.offsets.size,), "ends": (self.offsets.size - 1, 2, num_joints)}
        self.check_arrays(shapes | {"x": (num_x, num_joints), "node": (num_x,)})
        ends = self.offsets[[0, -1]].tolist()
        if ends != [0, num_x] or (np.diff(self.offsets) < 0).any():
            raise ValueError(f"slide_offsets must rise from 0 to {num_x}")
        if num_x and not 0 <= self.node.min() <= self.node.max() < num_kernels:
            raise ValueError(f"slide_node must name kernels 0 to {num_kernels - 1}")

    def and_also(
        self, x_from: np.ndarray, x_to: np.ndarray, x: np.ndarray, node: np.ndarray
    ) -> "Slides":
        """These slides and one more: its first and last configuration, and what it passes."""
        return Slides(
            ends=np.concatenate([self.ends, np.stack([x_from, x_to])[None]]),
            offsets=np.append(self.offsets, self.offsets[-1] + len(x)),
            x=np.concatenate([self.x, x]),
            node=np.concatenate([self.node, node]),
        )

    def between(self, x_from: np.ndarray, x_to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The last slide between two configurations: `(m, J)` mu and `(m,)` kernels.

        Joints that do not move on a slide may have any position, the same at both ends; m is 0 if
        no slide is known.
        """
        start, end = self.ends[:, 0], self.ends[:, 1]
        off = np.maximum(np.abs(start - x_from), np.abs(end - x_to))
        off = np.where(start == end, np.abs(x_to - x_from), off)
        known = np.flatnonzero((off < _SAME).all(axis=1))
        if not len(known):
            return self.x[:0], self.node[:0]
        rows = slice(*self.offsets[known[-1] : known[-1] + 2])
        moved = start[known[-1]] != end[known[-1]]
        return np.where(moved, self.x[rows], x_from), self.node[rows]

    def all_between(self, x_from: np.ndarray, x_to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `between`, with later slides that replaced parts of the slide."""
        passed, felt = self.between(x_from, x_to)
        if not len(passed):
            return passed, felt
        x: list[np.ndarray] = []
        node: list[int] = []
        before = x_from
        for here, here_felt in zip(passed, felt, strict=True):
            replaced, replaced_felt = self.between(before, here)
            x += [*replaced, here]
            node += [*replaced_felt, here_felt]
            before = here
        replaced, replaced_felt = self.between(before, x_to)
        return np.array([*x, *replaced]), np.array([*node, *replaced_felt])

    def within(self, lower: np.ndarray, upper: np.ndarray) -> "Slides":
        """The slides that stay between `lower` and `upper`, `(J,)` each."""
        outside = np.any((self.x < lower) | (self.x > upper), axis=1)
        slide = np.repeat(np.arange(len(self.ends)), np.diff(self.offsets))
        kept = np.bincount(slide[outside], minlength=len(self.ends)) == 0
        return Slides(
            ends=self.ends[kept],
            offsets=np.concatenate([[0], np.cumsum(np.diff(self.offsets)[kept])]),
            x=self.x[kept[slide]],
            node=self.node[kept[slide]],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RehearsalMemory(Record):
    """What the agent remembers from its rehearsals; every later plan uses it.

    Attributes:
        link_penalty: `(L,)` factors on the cost of the links of its planner, 1 or more.
        slides: practised ways between touches, where straight ones lose contact.
        missed: `(n,)` ascending rows of `kernel_q` at which a goal or a landing was not felt; plans
            end and land elsewhere.
        pressure: how much deeper than the firm touches it knows imagined plans press, in distances
            of kernels.
        num_tries: number of motions executed to learn it.
        belongs_to: hash of the target sensations, joint scale and links of its representation.
    """

    link_penalty: np.ndarray
    slides: "Slides"
    missed: np.ndarray
    pressure: float
    num_tries: int
    belongs_to: str

    @classmethod
    def blank(cls, representation: QuotientRepresentation) -> "RehearsalMemory":
        """The memory of an agent that has rehearsed nothing."""
        links, digest = representation.step_links(), hashlib.sha256()
        for array in (representation.target_sensations, representation.joint_scale, links):
            digest.update(np.ascontiguousarray(array).tobytes())
        return cls(
            link_penalty=np.ones(len(links)),
            slides=Slides.none(len(representation.joint_scale)),
            missed=np.empty(0, dtype=int),
            pressure=0.0,
            num_tries=0,
            belongs_to=digest.hexdigest()[:16],
        )

    def after(self, lost_links: np.ndarray) -> "RehearsalMemory":
        """The memory after one more try that lost contact on `lost_links` `(n,)`."""
        return replace(self.avoiding(lost_links), num_tries=self.num_tries + 1)

    def avoiding(self, links: np.ndarray) -> "RehearsalMemory":
        """The memory in which `links` `(n,)` cost more."""
        penalty = self.link_penalty.copy()
        penalty[links] = np.minimum(LOSS_FACTOR * penalty[links], _MOST_PENALTY)
        return replace(self, link_penalty=penalty)

    def missing(self, rows: Sequence[int]) -> "RehearsalMemory":
        """The memory in which nothing was felt at some more rows of `kernel_q`."""
        return replace(self, missed=np.union1d(self.missed, rows).astype(int))

    def pressing(self) -> "RehearsalMemory":
        """The memory of an agent that lost an imagined touch: it presses more, up to a limit."""
        return replace(self, pressure=min(self.pressure + PRESSED_MORE, MOST_PRESSED))

    def not_missed(self, rows: np.ndarray) -> np.ndarray:
        """The rows at which the goal was not missed; all if none is left."""
        others = rows[~np.isin(rows, self.missed)]
        return others if len(others) else rows

    def same_as(self, other: "RehearsalMemory") -> bool:
        """Whether plans are the same with this memory as with another of the same agent."""
        same = len(self.slides.ends) == len(other.slides.ends)
        same &= np.array_equal(self.missed, other.missed) and self.pressure == other.pressure
        return same and np.array_equal(self.link_penalty, other.link_penalty)

    @classmethod
    def restored(
        cls, arrays: Mapping[str, np.ndarray], representation: QuotientRepresentation
    ) -> "RehearsalMemory":
        """The memory of the agent with this representation, from what `to_arrays` returned.

        Raises:
            ForeignMemoryError: the arrays belong to another representation.
            ValueError: an array is missing or invalid; the text names it.
        """
        blank = cls.blank(representation)
        memory = cls.from_arrays({"missed": blank.missed, "pressure": np.zeros(()), **arrays})
        penalty, missed = memory.link_penalty, memory.missed
        if memory.belongs_to != blank.belongs_to or penalty.shape != blank.link_penalty.shape:
            raise ForeignMemoryError("the rehearsals belong to another representation")
        memory.check_arrays({"link_penalty": (None,), "missed": (None,)})
        if not 0.0 <= memory.pressure <= MOST_PRESSED:
            raise ValueError(f"pressure is {memory.pressure:g}, expected 0 to {MOST_PRESSED:g}")
        if not (penalty >= 1).all():
            raise ValueError("link_penalty must hold factors, 1 or more")
        if len(missed) and not 0 <= missed.min() <= missed.max() < representation.num_rows:
            raise ValueError(f"missed must hold rows 0 to {representation.num_rows - 1}")
        memory.slides.check(representation.kernel_q.shape[1], representation.num_targets)
        return memory


class ForeignMemoryError(ValueError):
    """A memory that belongs to another representation."""
