"""How the cost of a touch grows with receptors, joints and skins. Run it as a script.

Times are of the processor, of one core. The tables stand in docs/performance.md.
"""

from __future__ import annotations

import argparse
import time

from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.experience.collect import collect_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World

ROBOTS = ("cube", "torus", "gantry", "turning_body", "two_arms", "infant")
RECEPTORS = (50, 100, 200, 400)


def measure(name: str, overrides: dict, num_touches: int) -> str:
    """A line of the table: size of the robot and cost of its touches."""
    experiment = load_experiment(name, overrides)
    began = time.process_time()
    world = World(experiment)
    body = DrakeBody(world)
    built = time.process_time() - began
    collect_walk(body, experiment, 0, 50)
    began = time.process_time()
    shard = collect_walk(body, experiment, 1, num_touches)
    spent = time.process_time() - began
    return (
        f"| {name} | {world.robot.num_joints} | {len(world.skins)} | {experiment.num_receptors} "
        f"| {built:.1f} | {num_touches / shard.num_steps:.2%} | {1e6 * spent / num_touches:,.0f} "
        f"| {1e6 * spent / shard.num_steps:.2f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--touches", type=int, default=2000, help="of each robot")
    parser.add_argument("--robots", nargs="+", default=ROBOTS, help="shipped experiments")
    options = parser.parse_args()
    print("| experiment | joints | skins | receptors | built in (s) | steps that touch ", end="")
    print("| µs a stored touch | µs a step |")
    print("|---" * 8 + "|")
    for name in options.robots:
        print(measure(name, {}, options.touches), flush=True)
    for number in RECEPTORS:
        skins = {"skins": {"body": {"num_receptors": number}}}
        print(measure("sphere", skins, options.touches), flush=True)


if __name__ == "__main__":
    main()
