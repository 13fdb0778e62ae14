"""Plans that are practised in imagination only, without following them.

    python benchmarks/imagined.py RUN... --pairs 20

From its stored touches an agent learns a network that separates them from configurations whose
joints are drawn from different touches, or anywhere: where it would be in touch. Along that network
it slides, as it would slide along its skin. Prints, for each run, which must have learned: the
share of the plans in contact, straight and with slides that it imagined, mean and worst; the
numbers are in docs/planning.md.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.motions import Plan
from selftouch_drake.agent.network import Network, train
from selftouch_drake.agent.rehearsal import RehearsalMemory
from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.agent.sliding import Slider
from selftouch_drake.evaluation import contact_along, random_pairs
from selftouch_drake.experience import ExperienceReader
from selftouch_drake.robot import World
from selftouch_drake.run import stages
from selftouch_drake.run.acting import Pilot
from selftouch_drake.run.artifacts import load_agent
from selftouch_drake.run.directory import RunDirectory

#: Rows of a batch, half of them touches; units of each hidden layer; the network's inputs cover
#: -1.7 to 1.7, a deviation of 1.
_BATCH, _WIDTH, _RANGE = 2048, 128, 1.7

#: Passes over a plan: what is mended may pass other kernels.
_PASSES = 3


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Imagination:
    """Log odds that a configuration touches, relative to random configurations."""

    network: Network
    middle: np.ndarray
    half: np.ndarray

    def inputs(self, q: np.ndarray) -> np.ndarray:
        return (_RANGE * (q - self.middle) / self.half).astype(np.float32)

    def odds(self, q: np.ndarray) -> np.ndarray:
        return self.network(self.inputs(q))[:, 0].astype(float)

    @classmethod
    def learned(cls, q: np.ndarray, num_steps: int, seed: int) -> Imagination:
        """Trains on the `(n, J)` configurations of touches."""
        rng, (num, num_joints) = np.random.default_rng(seed), q.shape
        lower, upper = q.min(axis=0), q.max(axis=0)
        network = Network.random([num_joints, _WIDTH, _WIDTH, _WIDTH, 1], rng)
        found = cls(network, (lower + upper) / 2, (upper - lower) / 2)
        touches = found.inputs(q)
        is_touch = np.repeat([1.0, 0.0], _BATCH // 2)[:, None].astype(np.float32)

        def batch() -> np.ndarray:
            drawn = touches[rng.integers(num, size=_BATCH)]
            some, anywhere = drawn[_BATCH // 2 :], rng.uniform(-1, 1, (_BATCH // 4, num_joints))
            others = touches[rng.integers(num, size=_BATCH // 4)]
            swapped = rng.random(others.shape) < 0.5
            some[: _BATCH // 4] = _RANGE * anywhere
            some[_BATCH // 4 :] = np.where(swapped, others, some[_BATCH // 4 :])
            return drawn

        train(network, batch, lambda o: (1 / (1 + np.exp(-o)) - is_touch) / _BATCH, num_steps)
        return found

    def slider(
        self, representation: QuotientRepresentation, world: World, least_odds: float
    ) -> Slider:
        """A slider in imagination: every receptor feels the odds above a threshold."""
        num = representation.target_sensations.shape[1]

        def feel(x: np.ndarray) -> np.ndarray:
            beyond = np.maximum(self.odds(representation.unscaled(x)) - least_odds, 0.0)
            return np.repeat(beyond[:, None], num, axis=1) / np.sqrt(num)

        return Slider(
            feel=feel,
            possible=lambda x: np.ones(len(x), dtype=bool),
            lower=representation.scaled(world.robot.lower),
            upper=representation.scaled(world.robot.upper),
        )


def imagined(
    agent: Agent, slider: Slider, q_start: np.ndarray, pair: tuple[int, int], plan: Plan
) -> Plan:
    """The plan after practice in imagination."""
    for _ in range(_PASSES):
        passage, before = agent.go_along(plan, slider), agent
        if not len(passage.lost):
            break
        agent = agent.prepare(plan, passage.lost, slider)
        if agent.memory.same_as(before.memory):
            break
        plan = agent.tour(pair, q_start=q_start)
    return plan


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", type=Path, nargs="+", help="runs that have learned")
    parser.add_argument("--pairs", type=int, default=20, help="of start and goal, in each run")
    parser.add_argument("--steps", type=int, default=6000, help="of training")
    parser.add_argument("--least-odds", type=float, nargs="+", default=[1.0])
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for path in arguments.runs:
        run = RunDirectory.open(path)
        evaluation = dataclasses.replace(run.experiment.evaluation, num_pairs=arguments.pairs)
        experiment = dataclasses.replace(run.experiment, evaluation=evaluation)
        agent, world = load_agent(run), stages.make_world(run)
        agent = agent.recalling(RehearsalMemory.blank(agent.representation))
        q = ExperienceReader(run.experience).read("q")
        learned = Imagination.learned(q, arguments.steps, arguments.seed)
        pilot, found = Pilot(agent, world), dict[str, list[float]]()
        for pair in random_pairs(experiment, agent.representation):
            q_start = pilot.start_of(*pair)
            straight = agent.tour(pair, q_start=q_start)
            found.setdefault("straight", []).append(contact_along(world, straight))
            for least in arguments.least_odds:
                slider = learned.slider(agent.representation, world, least)
                plan = imagined(agent, slider, q_start, pair, straight)
                found.setdefault(f"imagined, {least:g}", []).append(contact_along(world, plan))
        for name, shares in found.items():
            print(f"| {path.name} | {name} | {np.mean(shares):.1%} / {min(shares):.0%} |")


if __name__ == "__main__":
    main()
