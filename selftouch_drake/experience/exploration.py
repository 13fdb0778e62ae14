"""Active babbling: in rounds, the agent goes where it knows least, and keeps what it touches.

What the agent knows in a round depends on the rounds stored before and on nothing else. So a
stopped run reads the stored rounds again and goes on, to the same bytes.

If the body may change in the course of the experiment, the agent watches for that: it lives a
`Life`, and explores by what it knows after it adapted. It gets no signal of a change.
"""

import warnings
from collections.abc import Callable
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body import Body, Felt
from selftouch_drake.agent.body_model.known_chain import ChainLearner
from selftouch_drake.agent.lifelong.explorer import (
    RESTLESS,
    ContactExplorer,
    Explorer,
    ModelExplorer,
    PostureHolder,
)
from selftouch_drake.agent.lifelong.learner import OnlineLearner
from selftouch_drake.agent.lifelong.life import Life
from selftouch_drake.experience.collect import keep_touches, stored_walks, time_left, walker_of
from selftouch_drake.experience.store import ExperienceReader, Shard, WalkCounts, write_shard
from selftouch_drake.experience.walk import CHOICE_S, strides, walk_range
from selftouch_drake.experiment import Experiment
from selftouch_drake.quotient.graph import DisconnectedWarning

#: Number of target sensations that the agent uses while it explores a body that stays as it is.
#: The learn stage and a life have their own numbers.
_NUM_TARGETS = 150

#: Most touches of each of these target sensations.
_KERNEL_SIZE = 300

#: Touches before the agent goes by what it knows.
_AT_RANDOM = 500


def new_life(experiment: Experiment) -> Life:
    """The life of an experiment's agent, at birth."""
    settings, seed = experiment.representation, experiment.seed
    born = partial(OnlineLearner, settings.num_targets, settings.max_kernel_size, seed=seed)
    samples = round(experiment.babbling.step_duration / CHOICE_S)
    every = max(samples, 1) if experiment.babbling.mode == "dynamic" else 1
    return Life(born, seed=seed, every=every, asks=settings.body_model == "auto")


class Exploration:
    """An agent in its body, which explores in rounds and learns from each.

    Args:
        experiment: decides everything that happens.
        body: the body of the experiment.
        explorer: decides where the agent goes; by default the one that suits the body.

    Attributes:
        mind: takes the touches; a life if the body changes in the course of the experiment.
        round: number of the next round.
        num_touches: number of touches in the rounds before.
    """

    def __init__(self, experiment: Experiment, body: Body, explorer: type[Explorer] | None = None):
        self.experiment, self._explorer = experiment, explorer
        self.enter(body)
        self.mind: Life | OnlineLearner
        if any(change.after > 0 for change in experiment.changes):
            self.mind = new_life(experiment)
        else:
            (seed,) = experiment.random_stream("explorer").generate_state(1)
            self.mind = OnlineLearner(_NUM_TARGETS, _KERNEL_SIZE, seed=int(seed))
        self._chain = ChainLearner(seed=experiment.seed)
        self.round = self.num_touches = 0
        self._q: np.ndarray | None = None
        self._agent: Agent | None = None

    def enter(self, body: Body) -> None:
        """From now on, the agent has this body."""
        self.body, self._leader = body, walker_of(self.experiment, body)

    def remember(self, q: np.ndarray, sensation: np.ndarray) -> None:
        """Learns from the next round, as stored: `q` `(n, J)` and `sensation` `(n, S)` N."""
        self.num_touches += len(q)
        self._q = q[-1]
        self.round += 1
        if self.experiment.babbling.seek == "postures" and not isinstance(self.mind, Life):
            return  # it does not go by what it knows
        self.mind.take(q, sensation)
        # One chain explains one part; where time counts, the agent does not ask for it.
        several = self._agent is not None and self._agent.representation.num_parts > 1
        asks = self.experiment.representation.body_model == "auto"
        if asks and not (self._leader.timed or several):
            self._chain.take(q, sensation)
        learner = self.mind.learner if isinstance(self.mind, Life) else self.mind
        self._agent = None
        if learner.num_touches >= _AT_RANDOM and learner.knows:
            # Asked for once a round, also when stored rounds are read again: what the learner
            # measures again depends on when it was last asked.
            with warnings.catch_warnings():
                # A graph in pieces is no surprise here: the agent explores in order to join them.
                warnings.simplefilter("ignore", DisconnectedWarning)
                self._agent = Agent.of(
                    learner.representation, kernel_sensation=learner.kernel_sensation
                )

    def _explorer_of(self, timed: bool) -> Callable[..., Explorer]:
        """Makes the explorer of a round, which may be of a body that is led in time."""
        if self.experiment.babbling.seek == "postures":
            return partial(PostureHolder, timed=timed)
        if self._explorer is not None:
            return self._explorer
        if not timed:
            return partial(ModelExplorer, chain=self._chain.known)
        if isinstance(self.mind, Life):
            return partial(ContactExplorer, dwell=RESTLESS)
        return ContactExplorer

    def explore(self, num_rows: int, most_s: float = np.inf) -> Shard:
        """The next round: explores until `num_rows` configurations that the body can take touch.

        After `most_s` s of the body's own time, the round ends with what it has.

        Raises:
            NeverTouchesError: there was no touch in very many steps.
        """
        rng = np.random.default_rng(self.experiment.random_stream("walk", self.round))
        babbling, leader = self.experiment.babbling, self._leader
        lower, upper = walk_range(self.body)
        start = rng.uniform(lower, upper) if self._q is None else self._q
        leader.begin_at(start)
        explorer = self._explorer_of(leader.timed)
        moves = explorer(
            agent=self._agent,
            q=start,
            felt=np.zeros(self.body.num_receptors),
            rng=rng,
            lower=lower,
            upper=upper,
            stride=strides(self.body, babbling.step_size),
            # Each sample decides on the next step; the agent moves as fast as random babbling.
            pace=CHOICE_S / babbling.step_duration if leader.timed else 1.0,
        ).moves()
        path = next(moves)

        def next_steps() -> Felt:
            nonlocal path
            felt = leader.walk(path, CHOICE_S)
            # In a posture that it cannot take, a body feels nothing.
            path = moves.send((felt.q, np.where(felt.reached[:, None], felt.sensation, 0.0)))
            return felt

        return keep_touches(next_steps, self.body, self.round, num_rows, most_s)


def explore(
    exploration: Exploration,
    folder: Path,
    *,
    fingerprint: str,
    body_of: Callable[[Experiment, str], Body],
    progress: Callable[[int], None] = lambda num_rows: None,
) -> WalkCounts:
    """Collects the missing experience of an active run, in this process: rounds follow each other.

    The exploration is at its beginning; all else is as in `collect`, with rounds for walks.
    """
    experiment = exploration.experiment
    counts, missing = stored_walks(experiment, folder, fingerprint=fingerprint, progress=progress)
    now = experiment.after(0)
    for number, num_rows, then in missing:
        if (left := time_left(experiment, counts)) <= 0:
            break
        stored = ExperienceReader(folder / "experience").touches() if number else iter(())
        for sensation, q in islice(stored, exploration.round, number):
            exploration.remember(q, sensation)
        if then != now:
            now = then
            exploration.enter(body_of(now, fingerprint))
        shard = exploration.explore(num_rows, left)
        exploration.remember(shard.q, shard.sensation)
        write_shard(folder, shard, fingerprint=fingerprint)
        counts += shard.counts
        progress(shard.counts.num_rows)
    return counts
