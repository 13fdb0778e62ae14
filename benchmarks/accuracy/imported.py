"""How much a raw skin costs, compared with a clean one. Run it as a script.

    python benchmarks/accuracy/imported.py --out runs/recorded

A torus with 300 receptors turns on one joint of its neck, and an arm of six joints touches it with
a fingertip: seven joints. They wander at about 0.5 rad/s and are recorded at 50 Hz, touching or
not. Every recording is a folder of Parquet files with the columns `q`, `sensation` and `time_s`,
which `selftouch import` reads too:

- `clean`: N, what a perfect skin feels;
- `raw`: eight bits, with offsets, drift, noise, hysteresis and spikes in 1 % of the readings
  (`benchmarks/shared/raw_skin.py`);
- `raw_no_spikes`: the same without spikes.

Each is imported, learned and recovered as `selftouch` does it; then the shapes are compared with
the truth, and it is looked where along twenty random plans the perfect skin is touched: those that
the body model imagines, if it was accepted, and those of the paper's representation. Recordings
that are there already are not made again.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from selftouch_drake.agent.agent import Agent
from selftouch_drake.evaluation.shape import kernel_truth, shape_errors
from selftouch_drake.experience.store import Contacts
from selftouch_drake.experience.walk import RandomWalk
from selftouch_drake.experiment import load_experiment
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.robot import World
from selftouch_drake.run.import_summary import summary
from selftouch_drake.run.imported import Data, imported_experiment, read_data

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.raw_skin import RawSkin

RATE_HZ = 50.0
# rad per row, standard deviation.
STEP = 0.01
# N, that a firm touch presses on one receptor of 300.
FIRM = 1.0
NUM_PLANS = 20
# Rows of a file.
PIECE = 25_000
SPIKES = {"clean": None, "raw": 0.01, "raw_no_spikes": 0.0}
JOINTS = ["turning_body::neck_z", *(f"arm::{name}" for name in (
    "shoulder_yaw", "shoulder_pitch", "elbow_pitch", "wrist_x", "wrist_y", "wrist_z"
))]  # fmt: skip


def make_world(seed: int) -> World:
    skins = {"body": {"num_receptors": 300}}
    changes = {"seed": seed, "robot": {"joints": JOINTS}, "skins": skins}
    return World(load_experiment("turning_body", changes))


def record(folder: Path, world: World, num_rows: int) -> None:
    """Makes all recordings of one motion, and their truth."""
    experiment, seed = world.experiment, world.experiment.seed
    lower, upper = world.robot.babbled_range
    walk = RandomWalk(
        lower=lower,
        upper=upper,
        step_size=STEP,
        persistence=0.95,
        seed=experiment.random_stream("walk", 0),
    )
    skins = {
        name: RawSkin(300, FIRM, num_rows, spikes=spikes, seed=seed)
        for name, spikes in SPIKES.items()
        if spikes is not None
    }
    contacts = []
    for first in range(0, num_rows, PIECE):
        q = walk.steps(min(PIECE, num_rows - first)).astype(np.float32)
        touches = [world.probe.touches(q[start : start + 5000]) for start in range(0, len(q), 5000)]
        force = np.concatenate([found.sensation for found in touches]).astype(np.float32)
        contacts += [Contacts.of_rows(t, np.arange(len(t.sensation))) for t in touches]
        time_s = (first + np.arange(len(q))) / RATE_HZ
        for name in SPIKES:
            sensation = force if name == "clean" else skins[name].read(force)
            (folder / name).mkdir(parents=True, exist_ok=True)
            table = {"q": lists(q), "sensation": lists(sensation), "time_s": pa.array(time_s)}
            file = folder / name / f"part-{first // PIECE:03d}.parquet"
            pq.write_table(pa.table(table), file, compression="zstd")
        print(f"recorded {first + len(q):,} rows", flush=True)
    joined = Contacts.joined(contacts)
    names = ("offsets", "skin", "toucher", "p_LC")
    save_arrays(folder / "truth.npz", {name: getattr(joined, name) for name in names})


def lists(rows: np.ndarray) -> pa.Array:
    return pa.FixedSizeListArray.from_arrays(pa.array(rows.reshape(-1)), rows.shape[1])


def contact(agent: Agent, world: World) -> tuple[np.ndarray, int]:
    """How random plans touch a perfect skin, and how many lift off.

    The share of each plan's length on which it means to touch that does; time in the air is not
    lost contact.
    """
    rng, shares, lifts = np.random.default_rng(0), [], 0
    for _ in range(NUM_PLANS):
        start, goal = rng.choice(agent.representation.num_targets, 2, replace=False)
        plan = agent.plan(int(start), int(goal))
        s = np.linspace(*plan.path.t[[0, -1]], 500)
        meant = plan.touching(s)
        lifts += not meant.all()
        felt = world.probe.sensations(plan.path(s[meant])).any(axis=1)
        shares.append(felt.mean() if meant.any() else 1.0)
    return 100 * np.array(shares), lifts


def scored(data: Data, contacts: Contacts, world: World, num_targets: int, metric: str) -> str:
    """One row of the table."""
    felt = data.felt
    false = np.mean(np.diff(contacts.offsets)[felt.rows] == 0)
    began = time.process_time()
    agent = Agent.learn(felt.q, felt.sensation, num_targets=num_targets)
    body = agent.recover(metric)
    seconds = time.process_time() - began
    model = agent.find_body_model()
    modelled = time.process_time() - began - seconds
    imagining = dataclasses.replace(agent, body_model=model)
    known = agent.representation
    truth = kernel_truth(known, contacts[felt.rows[known.kernel_row]], world.receptor_skin)
    errors = shape_errors(body.positions, known.part, truth)
    part = body.parts[0]
    held, lifts = contact(agent, world)
    imagined, imagined_lifts = contact(imagining, world)
    holes = "" if part.topology is None else " ".join(map(str, part.topology.betti))
    margin = "" if part.topology is None else f"{part.topology.margin:.1f}"
    return (
        f"| {len(felt.rows):,} | {100 * false:.1f} % | {100 * errors.get(0, np.nan):.1f} % "
        f"| {holes} | {margin} | {part.dimension or np.nan:.2f} | {body.metric} "
        f"| {held.mean():.1f} % | {held.min():.0f} % | {lifts} | {seconds:.0f} s "
        f"| {model.held_out[0]:.2f} | {imagined.mean():.1f} % | {imagined.min():.0f} % "
        f"| {imagined_lifts} | {modelled:.0f} s |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs/recorded"))
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--skins", nargs="+", default=list(SPIKES), choices=list(SPIKES))
    parser.add_argument("--metrics", nargs="+", default=["learned"])
    options = parser.parse_args()
    world = make_world(options.seed)
    if not (options.out / "truth.npz").exists():
        record(options.out, world, options.rows)
    contacts = Contacts(**load_arrays(options.out / "truth.npz"))
    rows = []
    for name in options.skins:
        perfect = {"offset": 0.0, "threshold": 0.0} if name == "clean" else {}
        data = read_data(options.out / name, **perfect)
        print(f"{name}:", *summary(data, imported_experiment(data)), sep="\n  ", flush=True)
        for metric in options.metrics:
            rows.append(f"| {name} {scored(data, contacts, world, options.targets, metric)}")
            print(rows[-1], flush=True)
    print(
        "\n| skin | touches | false | shape error | holes | margin | dimension | metric "
        "| contact | worst | lift off | time | near | imagined | worst | lift off | time |"
    )
    print("|---" * 17 + "|")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
