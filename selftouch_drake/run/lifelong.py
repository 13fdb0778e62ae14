"""The life of a run's agent: it learns from the touches of its experience one after another."""

from collections.abc import Callable, Iterator

import numpy as np

from selftouch_drake.agent.body_model.growth import GrowingModel, Growth
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.lifelong.life import Life
from selftouch_drake.bodies.embodiment import World, build_world
from selftouch_drake.evaluation.life import LifeCurves, Quality, quality
from selftouch_drake.experience.exploration import Exploration, new_life
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.stages import Progress, require_experience, silent
from selftouch_drake.run.worlds import run_bodies

#: Number of touches per block.
BLOCK = 500
#: The agent is scored at this number of touches, then each time it has grown by this factor, and
#: at changes.
_FIRST, _MORE = 500, 1.5
#: Number of touches after a change until it is scored again.
_AFTER = 2500
#: Number of touches that it finds at random before it goes by what it knows.
_AT_RANDOM = 50


class Watcher:
    """Observes a life; this one does nothing."""

    def enter(self, world: World) -> None:
        """Called when the body becomes that of `world`."""

    def lived(self, q: np.ndarray, sensation: np.ndarray, life: Life) -> None:
        """Called after the agent learned from touches `(n, J)` and `(n, S)` N."""

    def scored(self, found: Quality, num_touches: int) -> None:
        """Called after the agent was scored."""

    def grew(self, model: BodyModel, q: np.ndarray, target: np.ndarray) -> None:
        """Called after it asked for a model, by `(n, J)` touches with `(n,)` target sensations."""


def live(
    run: RunDirectory,
    watcher: Watcher | None = None,
    progress: Progress = silent,
    num_more: int = 0,
) -> LifeCurves:
    """Lets an agent live through the experience of a run, and stores its life as curves.

    The watcher is called at all events, if the run has a robot of Drake's. After the experience the
    agent explores the body of the run for `num_more` touches. If it is interrupted, the curves so
    far are stored.

    Raises:
        RunError: the experience is not complete.
    """
    require_experience(run)
    biography = _Biography(run, watcher)
    life, total = biography.life, run.experiment.babbling.num_samples + num_more
    try:
        for q, sensation, learn in _blocks(run, life, num_more):
            biography.take(q, sensation, learn)
            taken = life.num_touches
            progress(life.every * taken / total, f"{taken:,} touches: {mood(life)}")
    finally:
        save_arrays(run.life, biography.curves.to_arrays() | biography.growth | run.stamp())
    return biography.curves


def growth_lines(run: RunDirectory) -> list[str]:
    """Since when each axis, the tree and each skin stands, by the life of a run; none without."""
    arrays = load_arrays(run.life)
    if Growth.prefix + "touches" not in arrays:
        return []
    return Growth.from_arrays(arrays).in_words(run.joint_names())


def _blocks(
    run: RunDirectory, life: Life, num_more: int
) -> Iterator[tuple[np.ndarray, np.ndarray, Callable[..., None]]]:
    """The touches of a life, with what learns from them."""
    for sensation, q in ExperienceReader(run.experience).touches():
        for start in range(0, len(q), BLOCK):
            yield q[start : start + BLOCK], sensation[start : start + BLOCK], life.take
    if num_more:
        exploration = Exploration(run.experiment, run_bodies(run).babbling)
        exploration.mind = life
        while left := num_more - exploration.num_touches:
            shard = exploration.explore(min(left, BLOCK if exploration.round else _AT_RANDOM))
            yield shard.q, shard.sensation, exploration.remember


def mood(life: Life) -> str:
    """What the agent makes of its last touches, in words."""
    if life.has_doubts:
        return "this is not what it expects"
    if life.noticed:
        return f"it found: {life.noticed[-1].in_words}"
    return "it is learning" if life.learner.knows else "it is beginning"


class _Biography:
    """A life and its records."""

    def __init__(self, run: RunDirectory, watcher: Watcher | None):
        self._experiment, self._watcher = run.experiment, watcher or Watcher()
        self.life = new_life(run.experiment)
        # Of the body as it is at birth, if it may ask.
        self._growing: GrowingModel | None = None
        if run.experiment.representation.body_model == "auto":
            self._growing = GrowingModel(run.joint_names(), seed=run.experiment.seed)
        self._grew = self._growing
        self._changes = [c.after for c in run.experiment.changes if c.after > 0]
        self._due, self._taken = float(_FIRST), 0
        self._felt = np.zeros(run.num_receptors, dtype=bool)
        self._scores: list[tuple[int, float, float, float]] = []
        self._world = self._enter(0)

    def take(self, q: np.ndarray, sensation: np.ndarray, learn: Callable[..., None]) -> None:
        """The next touches, from which the agent is to learn."""
        if self._taken in self._changes:
            self._world, self._growing = self._enter(self._taken), None
            self._due = min(self._due, self._taken + _AFTER)
            if self.life.learner.knows:
                self._score()
        self._taken += len(q)
        self._felt |= sensation.any(axis=0)
        self._grow(q, sensation)
        learn(q, sensation)
        self._watcher.lived(q, sensation, self.life)
        if self._taken >= self._due and self.life.learner.knows and not self.life.has_doubts:
            self._score()
            self._due = _MORE * self._taken

    def _grow(self, q: np.ndarray, sensation: np.ndarray) -> None:
        """Asks for the model of the body whenever it is time, in the midst of the touches too."""
        while self._growing is not None and len(q):
            now = slice(self._growing.to_come)
            if self._growing.take(q[now], sensation[now]):
                learner, learned = self.life.learner, None
                if learner.knows:
                    learned = learner.representation, learner.kernel_sensation
                self._watcher.grew(*self._growing.ask(learned))
            q, sensation = q[now.stop :], sensation[now.stop :]

    def _enter(self, num_touches: int) -> World | None:
        """The world with the body at that time; None if nobody knows it."""
        if not self._experiment.has_truth:
            return None
        world = build_world(self._experiment.after(num_touches))
        self._watcher.enter(world)
        return world

    def _score(self) -> None:
        error = contact = float("nan")
        if self._world is not None:
            found = quality(self.life.learner, self._world, self._experiment.evaluation.num_pairs)
            error, contact = found.error, found.contact
            self._watcher.scored(found, self._taken)
        self._scores.append((self._taken, float(self._felt.mean()), error, contact))

    @property
    def growth(self) -> dict[str, np.ndarray]:
        """How the model of the body grew, as arrays; none if it did not ask."""
        growth = None if self._grew is None else self._grew.growth
        return {} if growth is None else growth.to_arrays()

    @property
    def curves(self) -> LifeCurves:
        """The life so far."""
        touches, coverage, error, contact = np.array(self._scores, dtype=float).reshape(-1, 4).T
        blocks, every = self.life.surprise, self.life.every
        means = [block.mean() for block in blocks]
        return LifeCurves(
            touches=touches.astype(int),
            coverage=coverage,
            error=error,
            contact=contact,
            block_touches=every * np.cumsum([len(block) for block in blocks], dtype=int),
            surprise=np.array(means, dtype=float),
            changed=np.array([c for c in self._changes if c < self._taken], dtype=int),
            noticed=every * np.array([one.row + 1 for one in self.life.noticed], dtype=int),
            mended=every * np.array([one.explained_at for one in self.life.noticed], dtype=int),
        )
