"""Cost of a stored touch, compared with code that a user would write. Run: `make bench`.

Three ways through the same random walks at the sphere, on one core, in turn, medians of several
turns:

- `loop`: a bare Python loop of SetPositions and ComputeContactSurfaces, that stores nothing;
- `selftouch`: the whole of it: walk, screen, contact, receptors, Parquet;
- `mujoco`: the same arm and a solid sphere in MuJoCo, point contact, the same receptive fields in
  numpy, stored in memory only.

Then the same walks in one process and in two, what a step costs that touches nothing, for one arm
and for an infant, and the first minute: the first touches of a process with and without numba's
cache.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from pydrake.geometry import HydroelasticContactRepresentation

from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.bodies.embodiment import body_of
from selftouch_drake.experience.collect import collect, collect_walk, random_walk
from selftouch_drake.experience.store import write_shard
from selftouch_drake.experience.walk import RandomWalk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.robot.broadphase import BroadPhase
from selftouch_drake.run.executors import local_executor
from selftouch_drake.systems import MakeDynamicStation

# Steps of a walk made at once.
_BATCH = 4096


class Loop:
    """The obvious loop: SetPositions, then ComputeContactSurfaces."""

    def __init__(self, world: World):
        station = MakeDynamicStation(world.experiment, world.skins)
        self.plant, self.diagram = station.robot.plant, station.diagram
        self.context = self.diagram.CreateDefaultContext()

    def run(self, walk: RandomWalk, num_touches: int) -> None:
        plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        query_port = self.diagram.GetOutputPort("query_object")
        found = 0
        while found < num_touches:
            for q in walk.steps(1000):
                self.plant.SetPositions(plant_context, q)
                query = query_port.Eval(self.context)
                polygon = HydroelasticContactRepresentation.kPolygon
                found += bool(query.ComputeContactSurfaces(polygon))


class Selftouch:
    """The work of `selftouch babble` for one walk, including writing."""

    def __init__(self, world: World, folder: Path):
        self.experiment, self.folder = world.experiment, folder
        self.body = DrakeBody(world)

    def run(self, walk_number: int, num_touches: int) -> None:
        shard = collect_walk(self.body, self.experiment, walk_number, num_touches)
        write_shard(self.folder, shard, fingerprint="benchmark")


class Mujoco:
    """The same kinematics and receptive fields on MuJoCo's collision with a solid sphere."""

    def __init__(self, world: World):
        import mujoco

        self.mujoco = mujoco
        (skin,), experiment = world.skins, world.experiment
        (tip,) = experiment.touching.values()
        self.fields, self.deepest = skin.fields, skin.wall.thickness + 2 * tip.radius
        joints = (("0 0 1", 0.0), ("0 1 0", 0.0), ("0 1 0", 0.4))
        joints += (("1 0 0", 0.4), ("0 1 0", 0.0), ("0 0 1", 0.0))
        opened = "".join(
            f'<body pos="{along} 0 0"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
            f'<joint axis="{axis}"/>'
            for axis, along in joints
        )
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><worldbody>
            <geom name="skin" type="sphere" size="{experiment.skins["body"].surface.radius}"/>
            <body pos="0 0 0.4">{opened}
            <geom name="tip" type="sphere" size="{tip.radius}" pos="0.12 0 0"/>
            {"</body>" * len(joints)}</body></worldbody></mujoco>"""
        )
        self.model, self.data = model, mujoco.MjData(model)

    def run(self, walk: RandomWalk, num_touches: int) -> None:
        mujoco, model, data = self.mujoco, self.model, self.data
        stored = 0
        while stored < num_touches:
            q, points, depths = [], [], []
            for step in walk.steps(_BATCH):
                data.qpos[:] = step
                mujoco.mj_kinematics(model, data)
                mujoco.mj_collision(model, data)
                # A solid sphere is touched at any depth; kept is what would touch a hollow skin.
                if data.ncon and -data.contact.dist[0] < self.deepest:
                    q.append(step)
                    points.append(data.contact.pos[0])
                    depths.append(-data.contact.dist[0])
            if q:
                sensation = self.fields.weights_at(np.array(points)).multiply(
                    np.array(depths)[:, None]
                )
                stored += len(sensation.toarray().astype(np.float32))


def in_turn(
    ways: dict[str, Callable[[int], object]],
    turns: int,
    clock: Callable[[], float] = time.process_time,
) -> dict[str, float]:
    """Seconds for each method: medians over interleaved turns, without the first."""
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for turn in range(turns + 1):
        for name, way in ways.items():
            began = clock()
            way(turn)
            if turn:
                seconds[name].append(clock() - began)
    return {name: statistics.median(times) for name, times in seconds.items()}


def measure(num_touches: int, turns: int) -> dict[str, float]:
    """Stored touches per second for each method."""
    world = World(load_experiment("sphere"))
    with tempfile.TemporaryDirectory() as folder:
        selftouch, loop = Selftouch(world, Path(folder)), Loop(world)

        def walk(turn: int) -> RandomWalk:
            return random_walk(world.experiment, selftouch.body, turn)

        ways = {
            "loop": lambda turn: loop.run(walk(turn), num_touches),
            "selftouch": lambda turn: selftouch.run(turn, num_touches),
        }
        try:
            mujoco = Mujoco(world)
            ways["mujoco"] = lambda turn: mujoco.run(walk(turn), num_touches)
        except ImportError:
            print("mujoco is not installed: `pip install mujoco` to compare with it")
        return {name: num_touches / seconds for name, seconds in in_turn(ways, turns).items()}


def measure_processes(num_touches: int, turns: int) -> dict[int, float]:
    """Stored touches per second with one and with two warm processes."""
    executors = {workers: local_executor(workers) for workers in (1, 2)}
    overrides = {"babbling": {"num_samples": num_touches, "walk_size": num_touches // 20}}
    experiment = load_experiment("sphere", overrides)

    def collected(workers: int) -> None:
        with tempfile.TemporaryDirectory() as folder:
            how = {"executor": executors[workers], "body_of": body_of}
            collect(experiment, Path(folder), fingerprint="benchmark", **how)

    # The first turn builds the world in the workers.
    ways = {str(workers): lambda _, w=workers: collected(w) for workers in executors}
    seconds = in_turn(ways, turns, time.perf_counter)
    for executor in executors.values():
        executor.shutdown()
    return {int(workers): num_touches / seconds[workers] for workers in seconds}


def measure_steps(turns: int) -> dict[str, float]:
    """Rejected steps per second: share of the walk and of the screen."""
    ways: dict[str, Callable[[int], object]] = {}
    num_steps = 10 * _BATCH
    for name in ("sphere", "infant"):
        world = World(load_experiment(name))
        walk = random_walk(world.experiment, DrakeBody(world), 0)
        q = walk.steps(2 * num_steps).astype(np.float32)
        away = q[~BroadPhase(world.robot).near(q).any(axis=1)]
        away = np.resize(away, (num_steps, q.shape[1]))
        # A probe builds its screen when it has been asked for many configurations.
        world.probe.felt_rows(np.resize(away, (250_000, q.shape[1])))
        ways[f"{name}, walk"] = lambda _, w=walk: [w.steps(_BATCH) for _ in range(10)]
        ways[f"{name}, screen"] = lambda _, p=world.probe, a=away: [
            p.felt_rows(a[k * _BATCH : (k + 1) * _BATCH]) for k in range(10)
        ]
    return {name: num_steps / seconds for name, seconds in in_turn(ways, turns).items()}


_FIRST_TOUCHES = """
import time
from selftouch_drake.bodies.drake import DrakeBody
from selftouch_drake.experience.collect import collect_walk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
experiment = load_experiment("sphere")
body = DrakeBody(World(experiment))
began = time.perf_counter()
collect_walk(body, experiment, 0, 100)
print(time.perf_counter() - began)
"""


def measure_start() -> dict[str, float]:
    """s until a new process has its first hundred touches: with cold and warm caches."""

    def first_touches(cache: str) -> float:
        ran = subprocess.run(
            [sys.executable, "-c", _FIRST_TOUCHES],
            env={**os.environ, "NUMBA_CACHE_DIR": cache},
            capture_output=True,
            text=True,
            check=True,
        )
        return float(ran.stdout)

    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        found = {"nothing compiled": first_touches(one), "compiled before": first_touches(one)}
        with ThreadPoolExecutor(2) as threads:
            found["nothing compiled, two processes"] = max(threads.map(first_touches, [two, two]))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--touches", type=int, default=5000, help="stored in one turn")
    parser.add_argument("--turns", type=int, default=5)
    arguments = parser.parse_args()
    rates = measure(arguments.touches, arguments.turns)
    print(f"{'one core':<32}{'touches/s':>12}{'over loop':>12}")
    for name, rate in rates.items():
        print(f"{name:<32}{rate:>12,.0f}{rate / rates['loop']:>12.2f}")
    by_workers = measure_processes(10 * arguments.touches, max(arguments.turns // 2, 1))
    print(f"\n{'processes':<32}{'touches/s':>12}{'speed-up':>12}")
    for workers, rate in by_workers.items():
        print(f"{workers:<32}{rate:>12,.0f}{rate / by_workers[1]:>12.2f}")
    print(f"\n{'steps that touch nothing':<32}{'steps/s':>12}")
    for name, rate in measure_steps(arguments.turns).items():
        print(f"{name:<32}{rate:>12,.0f}")
    print(f"\n{'first hundred touches':<32}{'s':>12}")
    for name, seconds in measure_start().items():
        print(f"{name:<32}{seconds:>12.1f}")


if __name__ == "__main__":
    main()
