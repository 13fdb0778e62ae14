"""What a stored touch costs, beside what a user would write instead. Run: `make bench`.

Four ways through the same random walk, on one core, in turn, medians of several turns:

- `loop`: a bare Python loop of SetPositions and ComputeContactSurfaces, that stores nothing;
- `selftouch`: the whole of it: walk, screen, contact, receptors, Parquet;
- `selftouch x2`: the same walks in two processes;
- `mujoco`: the same arm and a solid sphere in MuJoCo, point contact, the same receptive fields in
  numpy, stored in memory only.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from pydrake.geometry import HydroelasticContactRepresentation

from selftouch_drake.experience import RandomWalk, collect, collect_walk, write_shard
from selftouch_drake.experience.sources import KinematicSource
from selftouch_drake.experiment import load_experiment
from selftouch_drake.geometry import FINGERTIP_RADIUS, P_B_SHOULDER, build_body
from selftouch_drake.robot import MakeDynamicStation
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import local_executor


class Loop:
    """SetPositions and ComputeContactSurfaces, as one would write it first."""

    def __init__(self, experiment):
        station = MakeDynamicStation(experiment, *build_body(experiment))
        self.plant, self.diagram = station.agent.plant, station.diagram
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
    """What `selftouch babble` does for one walk, writing included."""

    def __init__(self, experiment, folder: Path):
        self.experiment, self.folder = experiment, folder
        self.source = KinematicSource(experiment, *build_body(experiment))

    def run(self, walk_number: int, num_touches: int) -> None:
        shard = collect_walk(self.source, self.experiment, walk_number, num_touches)
        write_shard(self.folder, shard, fingerprint="benchmark")


class Mujoco:
    """The same kinematics and receptive fields on MuJoCo's collision with a solid sphere."""

    def __init__(self, experiment):
        import mujoco

        self.mujoco = mujoco
        skin, self.fields = build_body(experiment)
        self.deepest = skin.thickness + 2 * FINGERTIP_RADIUS
        joints = (("0 0 1", 0.0), ("0 1 0", 0.0), ("0 1 0", 0.4))
        joints += (("1 0 0", 0.4), ("0 1 0", 0.0), ("0 0 1", 0.0))
        opened = "".join(
            f'<body pos="{along} 0 0"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
            f'<joint axis="{axis}"/>'
            for axis, along in joints
        )
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><worldbody>
            <geom name="skin" type="sphere" size="{experiment.body.radius}"/>
            <body pos="{" ".join(map(str, P_B_SHOULDER))}">{opened}
            <geom name="tip" type="sphere" size="{FINGERTIP_RADIUS}" pos="0.12 0 0"/>
            {"</body>" * len(joints)}</body></worldbody></mujoco>"""
        )
        self.model, self.data = model, mujoco.MjData(model)

    def run(self, walk: RandomWalk, num_touches: int) -> None:
        mujoco, model, data = self.mujoco, self.model, self.data
        stored = 0
        while stored < num_touches:
            q, points, depths = [], [], []
            for step in walk.steps(4096):
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


def measure(num_touches: int, turns: int) -> list[tuple[str, float]]:
    """Stored touches a second of each way: medians over turns that go round."""
    experiment = load_experiment("sphere")
    limits = {"step_size": 0.15, "persistence": 0.9}

    with tempfile.TemporaryDirectory() as folder:
        selftouch, loop = Selftouch(experiment, Path(folder)), Loop(experiment)
        agent = selftouch.source.agent

        def walk(turn: int) -> RandomWalk:
            seed = experiment.random_stream("walk", turn)
            return RandomWalk(lower=agent.lower, upper=agent.upper, seed=seed, **limits)

        ways = {
            "loop": lambda turn: loop.run(walk(turn), num_touches),
            "selftouch": lambda turn: selftouch.run(turn, num_touches),
        }
        try:
            mujoco = Mujoco(experiment)
            ways["mujoco"] = lambda turn: mujoco.run(walk(turn), num_touches)
        except ImportError:
            print("mujoco is not installed: `pip install mujoco` to compare with it")
        seconds: dict[str, list[float]] = {name: [] for name in ways}
        for turn in range(turns):
            for name, way in ways.items():
                began = time.perf_counter()
                way(turn)
                seconds[name].append(time.perf_counter() - began)
    return [(name, num_touches / statistics.median(times)) for name, times in seconds.items()]


def measure_processes(num_touches: int, turns: int) -> dict[int, float]:
    """Stored touches a second of one and of two processes that are already warm."""
    seconds: dict[int, list[float]] = {1: [], 2: []}
    executors = {workers: local_executor(workers) for workers in seconds}
    overrides = {"babbling": {"num_samples": num_touches, "walk_size": num_touches // 20}}
    experiment = load_experiment("sphere", overrides)
    for turn in range(turns + 1):
        for workers, executor in executors.items():
            with tempfile.TemporaryDirectory() as folder:
                run = RunDirectory.create(Path(folder) / "run", experiment)
                began = time.perf_counter()
                collect(run, executor=executor)
                if turn:  # the first turn builds the world in the workers
                    seconds[workers].append(time.perf_counter() - began)
    for executor in executors.values():
        executor.shutdown()
    return {workers: num_touches / statistics.median(times) for workers, times in seconds.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--touches", type=int, default=5000, help="stored in one turn")
    parser.add_argument("--turns", type=int, default=5)
    arguments = parser.parse_args()
    rates = measure(arguments.touches, arguments.turns)
    base = dict(rates)["loop"]
    print(f"{'one core':<16}{'touches/s':>12}{'over loop':>12}")
    for name, rate in rates:
        print(f"{name:<16}{rate:>12,.0f}{rate / base:>12.2f}")
    by_workers = measure_processes(10 * arguments.touches, max(arguments.turns // 2, 1))
    print(f"\n{'processes':<16}{'touches/s':>12}{'speed-up':>12}")
    for workers, rate in by_workers.items():
        print(f"{workers:<16}{rate:>12,.0f}{rate / by_workers[1]:>12.2f}")


if __name__ == "__main__":
    main()
