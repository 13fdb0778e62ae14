"""BabyBench, self touch: the agent in the environment of others, scored by their own script.

    python benchmarks/others/babybench.py --babybench PATH --seeds 100 101 102 103 104
    python benchmarks/others/babybench.py --babybench PATH --steps 10000 --film build/babybench.gif

PATH is the BabyBench 2025 starter kit (github.com/babybench/BabyBench2025_Starter_Kit). It needs
`gymnasium==0.28.1`, `mujoco==3.3.0` and the other packages of its `requirements.txt`, without torch
and stable-baselines3: give it an environment of its own, with what this package needs, and this
repository on PYTHONPATH (installed, its environments need a newer gymnasium). The agent begins
without experience and explores by `babbling.seek: postures`. Every step of the environment counts.
"""

from __future__ import annotations

import argparse
import os
import pickle
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from selftouch_drake.agent.body import Felt, Followed
from selftouch_drake.experience.exploration import Exploration
from selftouch_drake.experiment import load_experiment

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.results import add_update_option, results

# Steps between two looks at the skin: 0.02 s.
LOOK = 4
# Servo of each joint: share of full effort per rad, and per rad/s.
STIFFNESS, DAMPING = 20.0, 0.3
# Touches in a round of the agent, 5 s.
ROUND = 250
# Steps between two scores.
SCORED = 10_000
# Steps between two pictures of a film, 0.2 s; and how wide each side of one is, 0.9 m in pixels.
SEEN, WIDTH = 40, 240


class OverError(Exception):
    """All steps are made."""


class Baby:
    """MIMo as a `Body`: each motor turns one joint; the skin says how hard a receptor is pressed.

    Args:
        env: BabyBench's.
        num_steps: after which `OverError` is raised.
        seed: of the environment.
        scored: called every `SCORED` steps.
        seen: called every `SEEN` steps.
    """

    jumps = False

    def __init__(self, env: Any, num_steps: int, seed: int, scored: Any, seen: Any):
        self._env, self._left, self._scored, self._seen = env, num_steps, scored, seen
        inner = env.unwrapped
        motors = [inner.model.actuator(number) for number in inner.mimo_actuators]
        joints = [int(motor.trnid[0]) for motor in motors]
        names = [inner.model.joint(joint).name for joint in joints]
        self.joint_names = names
        self.lower, self.upper = inner.model.jnt_range[joints].T.copy()
        # The servo is fast; only what is asked of it is limited.
        self.velocity = 10.0 * (self.upper - self.lower)
        self.acceleration = 10.0 * self.velocity
        self.robot_s, self._step_s = 0.0, float(inner.dt)
        # The environment joins what it observes in the order of these names.
        sizes = {key: len(value) for key, value in inner.proprioception.sensor_outputs.items()}
        keys = sorted(sizes)
        ends = np.cumsum([sizes[key] for key in keys])
        starts = {key: end - sizes[key] for key, end in zip(keys, ends, strict=True)}
        order = np.array([inner.proprioception.sensor_names["qpos"].index(name) for name in names])
        self._at, self._speed = starts["qpos"] + order, starts["qvel"] + order
        inner.action_space.seed(seed)
        self._take(env.reset(seed=seed)[0])
        self.num_receptors = len(self._sensation)

    def feel(self, q: np.ndarray) -> Felt:
        """As in `Body`."""
        path = np.concatenate([self._q[None], q])
        felt = self.follow(0.25 * np.arange(len(path)), path).felt()
        return felt.of_rows(np.linspace(0, len(felt.q) - 1, len(q) + 1).astype(int)[1:])

    def follow(self, time_s: np.ndarray, q: np.ndarray) -> Followed:
        """As in `Body`; when an episode ends, it goes on from where the next one begins."""
        times = np.arange(0.0, time_s[-1] + 1e-9, LOOK * self._step_s)
        path = np.stack([np.interp(times, time_s, column) for column in q.T], axis=1)
        where, felt = [self._q], [self._sensation]
        for target in path[1:]:
            for _ in range(LOOK):
                self._step(target)
            where.append(self._q)
            felt.append(self._sensation)
        return Followed(time_s=times, q=np.array(where), sensation=np.array(felt))

    def _step(self, target: np.ndarray) -> None:
        space = self._env.action_space
        action = STIFFNESS * (target - self._q) - DAMPING * self._v
        action = action.clip(space.low, space.high).astype(space.dtype)
        observation, _, terminated, truncated, _ = self._env.step(action)
        self.robot_s += self._step_s
        self._left -= 1
        if terminated or truncated:
            observation, _ = self._env.reset()
        if self._left % SCORED == 0:
            self._scored()
        if self._left % SEEN == 0:
            self._seen()
        if not self._left:
            raise OverError
        self._take(observation)

    def _take(self, observation: dict[str, np.ndarray]) -> None:
        self._q = observation["observation"][self._at]
        self._v = observation["observation"][self._speed]
        force = observation["touch"].reshape(-1, 3)
        self._sensation = np.sqrt(np.square(force).sum(axis=1))


class Film:
    """Pictures of all receptors, from two sides, those that feel something in red.

    Args:
        env: BabyBench's.
        path: of a GIF.
    """

    def __init__(self, env: Any, path: Path):
        self._data, self._touch = env.unwrapped.data, env.unwrapped.touch
        self._path, self._frames = path, list[Image.Image]()

    def look(self) -> None:
        """Adds a picture."""
        places, felt = [], []
        for body, here in self._touch.sensor_positions.items():
            turn = self._data.xmat[body].reshape(3, 3)
            places.append(here @ turn.T + self._data.xpos[body])
            felt.append(np.abs(self._touch.sensor_outputs[body]).sum(axis=1) > 0)
        place, red = np.concatenate(places), np.concatenate(felt)
        image = Image.new("P", (2 * WIDTH, WIDTH))
        image.putpalette([255, 255, 255, 150, 160, 175, 215, 40, 40])
        for number, axes in enumerate(([0, 1], [0, 2])):
            flat = (place - self._data.body("hip").xpos)[:, axes] * (WIDTH / 0.9) * [1, -1]
            flat = np.rint(flat + WIDTH / 2).astype(int)
            flat = flat.clip(0, WIDTH - 1) + np.array([number * WIDTH, 0])
            for colour, those in ((1, ~red), (2, red)):
                for x, y in flat[those].tolist():
                    image.putpixel((x, y), colour)
        self._frames.append(image)

    def save(self) -> None:
        """Writes what it has seen."""
        first, *rest = self._frames
        first.save(self._path, save_all=True, append_images=rest, duration=100, loop=0)


def episodes(
    kit: Path, seed: int, num_steps: int, film: Path | None = None
) -> list[dict[str, Any]]:
    """The rows of one life: the score after every `SCORED` steps."""
    import babybench.eval as kit_eval
    import babybench.utils as kit_utils
    import yaml

    rows = list[dict[str, Any]]()
    with tempfile.TemporaryDirectory() as folder:
        config = yaml.safe_load((kit / "examples" / "config_selftouch.yml").read_text())
        config["save_dir"] = folder
        env = kit_utils.make_env(config)
        scorer = kit_eval.EVALS[config["behavior"]](
            env=env, duration=config["max_episode_steps"], render=False, save_dir=folder
        )

        def scored() -> None:
            logs = pickle.loads(Path(folder, "logs", "training.pkl").read_bytes())
            score = float(scorer._eval_logs(logs))
            steps = sum(log["steps"] for log in logs)
            rows.append({"seed": seed, "steps": steps, "score": round(score, 4)})
            print(rows[-1], flush=True)

        given = {"strategy": "active", "seek": "postures", "jumps": False}
        # Of the experiment only seed and babbling count: the body is another.
        experiment = load_experiment("cube", {"seed": seed, "babbling": given})
        seen = Film(env, film) if film else None
        baby = Baby(env, num_steps, seed, scored, seen.look if seen else lambda: None)
        life = Exploration(experiment, baby)
        try:
            while True:
                life.explore(ROUND)
                life.round += 1  # from a posture of its own
        except OverError:
            env.close()
        if seen:
            seen.save()
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--babybench", type=Path, required=True, help="the starter kit")
    parser.add_argument("--steps", type=int, default=100_000, help="of the environment")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--film", type=Path, help="GIF of the last seed")
    add_update_option(parser, "babybench")
    arguments = parser.parse_args()
    if arguments.steps <= 0 or arguments.steps % SCORED:
        parser.error(f"--steps is {arguments.steps}; give a multiple of {SCORED}")
    kit = arguments.babybench.resolve()
    if not (kit / "babybench" / "eval.py").is_file():
        parser.error(f"--babybench is {kit}, which has no babybench/eval.py; give the starter kit")
    os.environ.setdefault("MUJOCO_GL", "disabled")
    # This script is called as the kit's package is.
    sys.path[:0] = [str(kit), str(kit / "MIMo")]
    warnings.simplefilter("ignore")
    last = []
    with results("babybench", update=arguments.update) as add:
        for seed in arguments.seeds:
            rows = episodes(kit, seed, arguments.steps, arguments.film)
            for row in rows:
                add(row)
            last.append(rows[-1]["score"])
    print(f"score: mean {np.mean(last):.3f}, worst {min(last):.3f}")


if __name__ == "__main__":
    main()
