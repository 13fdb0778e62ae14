"""What the agent remembers: links on which it lost contact, and slides that kept it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
from numba import njit

from selftouch_drake.agent.motions import check_arrays
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.agent.representation.graphs import step_links

#: A link on which contact was lost costs this many times more from then on.
LOSS_FACTOR = 8.0
# Six losses: beyond that a link is as good as cut, and the costs stay far from overflow.
_MOST_PENALTY = LOSS_FACTOR**6

# rad, tolerance for stored float32 configurations.
_SAME = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slides:
    """Ways from one touch to another along which the agent slid.

    N slides through M configurations of J joints in all, scaled (rad).

    Attributes:
        ends: `(N, 2, J)` first and last configuration of each slide.
        offsets: `(N + 1,)` slide n passes rows `offsets[n]:offsets[n + 1]` of `x`.
        x: `(M, J)` touching configurations in between.
        node: `(M,)` the kernel that is felt at each.
    """

    ends: np.ndarray
    offsets: np.ndarray
    x: np.ndarray
    node: np.ndarray

    @classmethod
    def none(cls, num_joints: int) -> Slides:
        """No slides."""
        return cls(
            ends=np.empty((0, 2, num_joints)),
            offsets=np.zeros(1, dtype=int),
            x=np.empty((0, num_joints)),
            node=np.empty(0, dtype=int),
        )

    def check(self, num_joints: int, num_kernels: int) -> None:
        """Checks that these are slides of the given number of joints, between known kernels.

        Raises:
            ValueError: an array does not fit; the text names it.
        """
        num, num_x = max(self.offsets.size - 1, 0), len(np.atleast_1d(self.x))
        shapes = {"offsets": (num + 1,), "ends": (num, 2, num_joints)}
        check_arrays(self, shapes | {"x": (num_x, num_joints), "node": (num_x,)}, "slide_")
        ends = self.offsets[[0, -1]].tolist()
        if ends != [0, num_x] or (self.offsets[1:] < self.offsets[:-1]).any():
            raise ValueError(f"slide_offsets must rise from 0 to {num_x}")
        if num_x and not 0 <= self.node.min() <= self.node.max() < num_kernels:
            raise ValueError(f"slide_node must name kernels 0 to {num_kernels - 1}")

    def and_also(
        self, x_from: np.ndarray, x_to: np.ndarray, x: np.ndarray, node: np.ndarray
    ) -> Slides:
        """These slides and one more: its first and last configuration, and what it passes."""
        return Slides(
            ends=np.concatenate([self.ends, np.stack([x_from, x_to])[None]]),
            offsets=np.append(self.offsets, self.offsets[-1] + len(x)),
            x=np.concatenate([self.x, x]),
            node=np.concatenate([self.node, node]),
        )

    def between(self, x_from: np.ndarray, x_to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The known slide between two configurations: `(m, J)` rad and `(m,)` kernels.

        Joints that do not move on a slide may have any position; m is 0 if no slide is known.
        """
        slide = _latest(self.ends, x_from, x_to)
        if slide < 0:
            return self.x[:0], self.node[:0]
        rows = slice(*self.offsets[slide : slide + 2])
        moved = self.ends[slide, 0] != self.ends[slide, 1]
        return np.where(moved, self.x[rows], x_from), self.node[rows]

    def all_between(self, x_from: np.ndarray, x_to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `between`, with later slides that replaced parts of the slide."""
        passed, felt = self.between(x_from, x_to)
        if not len(passed):
            return passed, felt
        way = [x_from, *passed, x_to]
        parts = [self.between(*ends) for ends in pairwise(way)]
        x = [x for (mend, _), at in zip(parts, way[1:], strict=True) for x in (*mend, at)]
        node = [n for (_, mend), at in zip(parts, [*felt, -1], strict=True) for n in (*mend, at)]
        return np.array(x[:-1]), np.array(node[:-1])

    def within(self, lower: np.ndarray, upper: np.ndarray) -> Slides:
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


@njit(cache=True)
def _latest(ends, x_from, x_to):
    """The last of the slides with these ends, or -1."""
    for slide in range(len(ends) - 1, -1, -1):
        start, end = ends[slide]
        for j in range(len(start)):
            # A joint that does not move on the slide may have any position, the same at both ends.
            if start[j] == end[j]:
                off = abs(x_to[j] - x_from[j])
            else:
                off = max(abs(start[j] - x_from[j]), abs(end[j] - x_to[j]))
            if off >= _SAME:
                break
        else:
            return slide
    return -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RehearsalMemory:
    """What the agent remembers from its rehearsals; every later plan uses it.

    Attributes:
        link_penalty: `(L,)` factors on the cost of the links of its planner, 1 or more.
        slides: practised ways between touches, where straight ones lose contact.
        missed: `(n,)` ascending rows of `kernel_q` at which a goal or a landing was not felt; plans
            end and land elsewhere.
        num_tries: number of motions executed to learn it.
        belongs_to: fingerprint of the representation that these links belong to.
    """

    link_penalty: np.ndarray
    slides: Slides
    missed: np.ndarray
    num_tries: int
    belongs_to: str

    @classmethod
    def blank(cls, representation: QuotientRepresentation) -> RehearsalMemory:
        """The memory of an agent that has rehearsed nothing."""
        links = step_links(representation)
        return cls(
            link_penalty=np.ones(len(links)),
            slides=Slides.none(len(representation.joint_scale)),
            missed=np.empty(0, dtype=int),
            num_tries=0,
            belongs_to=_fingerprint(representation, links),
        )

    def after(self, lost_links: np.ndarray) -> RehearsalMemory:
        """The memory after one more try that lost contact on `lost_links` `(n,)`."""
        return replace(self.avoiding(lost_links), num_tries=self.num_tries + 1)

    def avoiding(self, links: np.ndarray) -> RehearsalMemory:
        """The memory in which `links` `(n,)` cost more."""
        penalty = self.link_penalty.copy()
        penalty[links] = np.minimum(LOSS_FACTOR * penalty[links], _MOST_PENALTY)
        return replace(self, link_penalty=penalty)

    def missing(self, rows: Sequence[int]) -> RehearsalMemory:
        """The memory in which nothing was felt at some more rows of `kernel_q`."""
        return replace(self, missed=np.union1d(self.missed, rows).astype(int))

    def same_as(self, other: RehearsalMemory) -> bool:
        """Whether plans are the same with this memory as with another of the same agent."""
        same = len(self.slides.ends) == len(other.slides.ends)
        same &= np.array_equal(self.missed, other.missed)
        return same and np.array_equal(self.link_penalty, other.link_penalty)

    def to_arrays(self) -> dict[str, np.ndarray]:
        """All fields as arrays, by name."""
        return {
            "link_penalty": self.link_penalty,
            **{f"slide_{f.name}": getattr(self.slides, f.name) for f in fields(Slides)},
            "missed": self.missed,
            "num_tries": np.array(self.num_tries),
            "belongs_to": np.array(self.belongs_to),
        }

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, np.ndarray], representation: QuotientRepresentation
    ) -> RehearsalMemory:
        """Inverse of `to_arrays`; other names are ignored.

        Raises:
            ForeignMemoryError: the arrays belong to another representation.
            ValueError: an array is missing or invalid; the text names it.
        """
        blank = cls.blank(representation)
        arrays = {"missed": blank.missed, **arrays}
        if missing := [name for name in blank.to_arrays() if name not in arrays]:
            raise ValueError(f"{missing[0]} is missing")
        penalty, num_tries = np.asarray(arrays["link_penalty"]), np.asarray(arrays["num_tries"])
        if (
            str(arrays["belongs_to"]) != blank.belongs_to
            or penalty.shape != blank.link_penalty.shape
        ):
            raise ForeignMemoryError("the rehearsals belong to another representation")
        if num_tries.shape != () or num_tries.dtype.kind not in "iu" or num_tries < 0:
            raise ValueError(f"num_tries is {num_tries.tolist()}, expected a whole number >= 0")
        if penalty.dtype.kind != "f" or not (np.isfinite(penalty) & (penalty >= 1)).all():
            raise ValueError("link_penalty must hold finite factors, 1 or more")
        missed = np.asarray(arrays["missed"])
        if missed.ndim != 1 or missed.dtype.kind not in "iu":
            raise ValueError(f"missed is {missed.dtype} of shape {missed.shape}, expected rows")
        if len(missed) and not 0 <= missed.min() <= missed.max() < representation.num_rows:
            raise ValueError(f"missed must hold rows 0 to {representation.num_rows - 1}")
        slides = Slides(**{f.name: np.asarray(arrays[f"slide_{f.name}"]) for f in fields(Slides)})
        slides.check(representation.kernel_q.shape[1], representation.num_targets)
        return replace(
            blank, link_penalty=penalty, slides=slides, missed=missed, num_tries=int(num_tries)
        )


class ForeignMemoryError(ValueError):
    """A memory that belongs to another representation."""


def _fingerprint(representation: QuotientRepresentation, links: np.ndarray) -> str:
    """Hash of the target sensations, joint scale and links of a representation."""
    digest = hashlib.sha256()
    for array in (representation.target_sensations, representation.joint_scale, links):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]
