"""How the model of a body grows with touches: when each axis, the tree and each skin stands."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.body_model import few
from selftouch_drake.agent.body_model.asking import ask_for_model, kernel_of_rows
from selftouch_drake.agent.body_model.find import find_body_model
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.records import Record
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.quotient.sensations import assign, target_sensations
from selftouch_drake.quotient.threads import mapped

#: Degrees; the direction of an axis that is surer than this stands.
SURE_AXIS = 3.0
# The first touches after which a model is asked for, by how much they grow until the next time,
# and touches from which on it is not asked again once all parts are accepted.
_FIRST, _MORE, _GROWN = 50, 2, 800
# Target sensations of few touches: one for so many, and at most so many.
_TO_EACH, _MOST_TARGETS = 3, 150


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Growth(Record):
    """What a model knew at M moments: J joints.

    Attributes:
        touches: `(M,)` touches at each moment.
        accepted: `(M,)` parts of the skin on which left-out touches agreed with the model.
        parts: `(M,)` parts that the skin then had.
        parent: `(M, J)` the joint that carries each joint, as in `BodyModel`.
        axis_sigma: `(M, J)` degrees, standard error of the direction of each axis, each way across
            it; NaN if the joint is not used.
        receptors: `(M,)` 0 to 1, share of all receptors that had a place on an accepted part.
        receptor_sigma: `(M,)` median standard error of their places, as a share of the radius of
            the skin that they are on; NaN without any.
    """

    prefix = "grown_"

    touches: np.ndarray
    accepted: np.ndarray
    parts: np.ndarray
    parent: np.ndarray
    axis_sigma: np.ndarray
    receptors: np.ndarray
    receptor_sigma: np.ndarray

    @staticmethod
    def of(models: Sequence[tuple[int, BodyModel]]) -> "Growth":
        """From models, each with the number of touches that it came from; one or more."""
        placed = [_placed(model) for _, model in models]
        return Growth(
            touches=np.array([number for number, _ in models]),
            accepted=np.array([model.accepted_by_part.sum() for _, model in models]),
            parts=np.array([len(model.accepted_by_part) for _, model in models]),
            parent=np.array([model.joint_parent for _, model in models]),
            axis_sigma=np.array([_axis_errors(model) for _, model in models]),
            receptors=np.array([share for share, _ in placed]),
            receptor_sigma=np.array([sigma for _, sigma in placed]),
        )

    def axes_stand(self) -> list[int | None]:
        """For each joint the touches from which on its axis is accepted and sure to `SURE_AXIS`."""
        surely = (self.axis_sigma < SURE_AXIS) & (self.accepted > 0)[:, None]
        return [self._from_then_on(one) for one in surely.T]

    def tree_stands(self) -> int | None:
        """The touches from which on the tree is accepted and stays as it is in the end."""
        return self._from_then_on((self.parent == self.parent[-1]).all(1) & (self.accepted > 0))

    def skins_stand(self) -> list[int | None]:
        """The touches from which on one skin is accepted, two are, and so on."""
        return [self._from_then_on(self.accepted > number) for number in range(int(self.parts[-1]))]

    def _from_then_on(self, holds: np.ndarray) -> int | None:
        """The touches at the first moment from which on something holds; None if it does not."""
        since = len(holds) - int(np.argmin(holds[::-1])) if not holds.all() else 0
        return None if since == len(holds) else int(self.touches[since])

    def in_words(self, joint_names: Sequence[str] | None = None) -> list[str]:
        """When what stands: a line for the axes, the tree and the skins."""
        names = joint_names or [f"joint_{n}" for n in range(self.axis_sigma.shape[1])]
        axes = zip(self.axes_stand(), names, strict=True)
        used = np.isfinite(self.axis_sigma[-1])
        said = [f"{name} {_after(at)}" for (at, name), uses in zip(axes, used, strict=True) if uses]
        return [
            "axes stand: " + (", ".join(said) or "none"),
            f"tree stands: {_after(self.tree_stands())}",
            "skins stand: " + (", ".join(map(_after, self.skins_stand())) or "none"),
        ]


def _after(number: int | None) -> str:
    return "not yet" if number is None else f"after {number:,}"


def _axis_errors(model: BodyModel) -> list[float]:
    """Of all joints, in degrees each way across the axis; NaN for those that are not used."""
    return [
        model.axis_errors(joint)[0] if uses else np.nan for joint, uses in enumerate(model.used)
    ]


def _placed(model: BodyModel) -> tuple[float, float]:
    """The share of receptors with a place on an accepted part, and how unsure these are."""
    found, sigma = model.receptors(), []
    for part in np.flatnonzero(model.accepted_by_part):
        own = (found.part == part) & np.isfinite(found.place).all(axis=1)
        if own.any():
            radius = np.sqrt(found.place[own].var(axis=0).sum())
            sigma += (found.sigma[own] / max(radius, 1e-12)).tolist()
    share = len(sigma) / max(len(found.part), 1)
    return share, float(np.nanmedian(sigma)) if np.isfinite(sigma).any() else float("nan")


class GrowingModel:
    """Asks for the model of a body at moments of a life: after 50 touches, and twice as many again.

    Few touches are compared as they were felt, many by what was learned of them.

    Args:
        joint_names: of the joints; numbers by default.
        seed: of all randomness.

    Attributes:
        models: those found, each with the number of touches that it came from.
    """

    def __init__(self, joint_names: Sequence[str] | None = None, *, seed: int = 0) -> None:
        self.models: list[tuple[int, BodyModel]] = []
        self._names, self._seed = joint_names, seed
        self._num, self._due = 0, _FIRST
        self._q: list[np.ndarray] = []
        self._sensation: list[np.ndarray] = []

    @property
    def growth(self) -> Growth | None:
        """What the models knew; None before the first."""
        return Growth.of(self.models) if self.models else None

    @property
    def to_come(self) -> int:
        """Touches until it asks next."""
        return self._due - self._num

    def take(self, q: np.ndarray, sensation: np.ndarray) -> bool:
        """Takes the next touches `(n, J)` and `(n, S)`; returns whether to ask now."""
        self._num += len(q)
        if self._num - len(q) < few.MOST:
            self._q.append(np.asarray(q, dtype=float))
            self._sensation.append(np.asarray(sensation, dtype=np.float32))
        return self._num >= self._due

    def ask(
        self, learned: tuple[QuotientRepresentation, csr_array] | None
    ) -> tuple[BodyModel, np.ndarray, np.ndarray]:
        """Asks for a model.

        Args:
            learned: what was learned up to now, and the sensation at each of its configurations;
                None if nothing was.

        Returns:
            The model, `(n, J)` readings that it came from, and `(n,)` target sensation of each.
        """
        one_part = learned is None or learned[0].num_parts < 2
        if learned is None or (one_part and self._num <= few.MOST):
            found = self._of_few()
        else:
            representation, sensation = learned
            model = ask_for_model(
                representation, sensation, joint_names=self._names, seed=self._seed
            )
            found = model, representation.kernel_q.astype(float), kernel_of_rows(representation)
        self.models.append((self._num, found[0]))
        grown = found[0].accepted and self._num >= _GROWN
        self._due = np.iinfo(int).max if grown else _MORE * self._num
        return found

    def _of_few(self) -> tuple[BodyModel, np.ndarray, np.ndarray]:
        """As `ask`, of touches as they were felt, on one part."""
        q, felt = np.concatenate(self._q), np.concatenate(self._sensation)
        number = max(min(len(q) // _TO_EACH, _MOST_TARGETS), 1)
        targets = target_sensations(felt, number, or_fewer=True)
        target, _ = assign(felt, targets)
        # Sums in another order, by another number of threads, would give other bytes.
        with threadpool_limits(limits=1, user_api="blas"):
            model = find_body_model(
                q,
                csr_array(felt),
                target,
                np.zeros(len(targets), dtype=int),
                joint_names=self._names or [f"joint_{n}" for n in range(q.shape[1])],
                seed=self._seed,
                each=mapped,
            )
        return model, q, target
