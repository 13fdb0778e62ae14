"""Accuracy of the body model against the truth, on experiments and seeds by command.

    python benchmarks/accuracy/body_model.py cube --seeds 5 6 7
    python benchmarks/accuracy/body_model.py turning_body --seeds 5 6 --touches 20000
    python benchmarks/accuracy/body_model.py gantry --seeds 5 --touches 1000
    python benchmarks/accuracy/body_model.py two_arms --seeds 1 --touches 3000 --targets 200
    python benchmarks/accuracy/body_model.py cube --seeds 5 --corrupt labels 0.3
    python benchmarks/accuracy/body_model.py infant --seeds 1 2 --radius 0.024

For each seed a run is made (or taken from --runs), its joints are shuffled, and the body is found.
Printed are the root mean square error of places of single touches and of means over kernels, in %
of the skin's extent after one similarity for each skin, whether the order of joints is right,
whether the body was accepted, and the seconds of the fit. With --radius also the error of contacts:
places less the toucher's mean radius along the skin's normal, which touch cannot tell.
"""

import argparse
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq

from selftouch_drake.agent.body_model import few
from selftouch_drake.agent.body_model.find import find_body_model
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.body_model.support import beside, blended_normals
from selftouch_drake.agent.representation.kernel_sensations import kernel_sensations
from selftouch_drake.experience.store import ExperienceReader

TOUCHES = {
    "turning_body": 20_000, "gantry": 30_000, "two_arms": 60_000, "infant": 60_000,
}  # fmt: skip
#: What can be made wrong on purpose, by an amount.
CORRUPTIONS = {
    "labels": "share of labels that are shuffled",
    "rows": "all labels are shuffled between rows",
    "mixed": "rad, readings that mix joints: q + amount sin(2 q'), q' in reverse order",
    "noise": "on joints, in standard deviations of each",
    "backlash": "rad, play of each joint",
    "slip": "degrees that a clutch gave way between two halves of the touches",
    "missing": "number of the joint that is left out",
}
#: True orders from the skin outwards; joints in one tuple may change places.
ORDERS = {
    "turning_body": [(2,), (1,), (0, 3), (4,), (5,), (6,), (7,), (8,)],
    "gantry": [(0, 1, 2), (3,), (4,)],
}


class Truth(NamedTuple):
    """Of each stored touch: `(n, 3)` first contact, and what touched what."""

    place: np.ndarray
    single: np.ndarray
    toucher: np.ndarray
    skin: np.ndarray


def the_run(name: str, seed: int, touches: int, folder: Path, targets: int = 0) -> Path:
    """A run of the experiment, with so many target sensations if not 0; made if it is not there."""
    run = folder / f"{name}-{seed}"
    if not (run / "representation.npz").exists():
        from click.testing import CliRunner

        from selftouch_drake.cli import cli

        number = f", num_targets: {targets}" if targets else ""
        changes = (
            f"{{seed: {seed}, babbling: {{num_samples: {touches}}}, "
            f"representation: {{body_model: off{number}}}}}"
        )
        for arguments in (
            ["babble", name, "--out", str(run), "--set", changes],
            ["learn", str(run)],
        ):
            CliRunner().invoke(cli, arguments, catch_exceptions=False)
    return run


def the_truth(run: Path, rows: np.ndarray) -> Truth:
    """What the stored touches were."""
    columns: dict[str, list[np.ndarray]] = {name: [] for name in Truth._fields}
    for path in sorted((run / "truth").glob("part-*.parquet")):
        table = pq.read_table(path)
        lists = {name: table.column(name).combine_chunks() for name in ("p_LC", "toucher", "skin")}
        first = lists["toucher"].offsets.to_numpy()
        places = lists["p_LC"].values.flatten().to_numpy().reshape(-1, 3)
        columns["place"].append(places[first[:-1]])
        columns["single"].append(np.diff(first) == 1)
        columns["toucher"].append(lists["toucher"].values.to_numpy()[first[:-1]])
        columns["skin"].append(lists["skin"].values.to_numpy()[first[:-1]])
    return Truth(*(np.concatenate(columns[name])[rows] for name in Truth._fields))


def misfit(found: np.ndarray, true: np.ndarray, extent: float) -> float:
    """Root mean square distance in % after one similarity."""
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    U, s, V = np.linalg.svd(a.T @ b)
    apart = (s.sum() / (a**2).sum()) * a @ (U @ V) - b
    return 100 * float(np.sqrt((apart**2).sum(axis=1).mean())) / extent


def off(
    found: np.ndarray, true: np.ndarray, kernel: np.ndarray, skin: np.ndarray
) -> tuple[float, float]:
    """The misfits of touches and of means over kernels, in % of the extent.

    A part may have skins on several links, whose true places have frames of their own: each skin
    has its similarity, and counts as often as it was touched.
    """
    errors, number = [], []
    for one in np.unique(skin):
        own = skin == one
        if own.sum() <= 20:
            continue
        extent = float(np.linalg.norm(np.ptp(true[own], axis=0)))
        middle = [means(values[own], kernel[own]) for values in (found, true)]
        errors.append((misfit(found[own], true[own], extent), misfit(*middle, extent)))
        number.append(own.sum())
    if not errors:
        return np.nan, np.nan
    of_touches, of_kernels = np.sqrt(np.average(np.square(errors), axis=0, weights=number))
    return float(of_touches), float(of_kernels)


def contacts(
    model: BodyModel, place: np.ndarray, target: np.ndarray, true: np.ndarray, radius: float
) -> np.ndarray:
    """`(n, 3)` where touchers of a mean radius in metres touch one part.

    The truth gives the scale.
    """
    part = model.kernel_part == model.kernel_part[target[0]]
    of_part = np.where(part[:, None], model.kernel_place, np.nan)
    near = beside(of_part, model.kernel_part)
    normal = blended_normals(of_part, model.kernel_normal, near, place)
    found = place
    for _ in range(30):
        a, b = found - found.mean(axis=0), true - true.mean(axis=0)
        scale = np.linalg.svd(a.T @ b)[1].sum() / (a**2).sum()
        found = place - radius / scale * normal
    return found


def means(values: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Means over kernels with four touches and more."""
    _, number, count = np.unique(kernel, return_inverse=True, return_counts=True)
    sums = [np.bincount(number, weights=values[:, axis]) for axis in range(3)]
    return (np.stack(sums, axis=1) / count[:, None])[count >= 4]


def corrupted(q, target, how):
    """Readings or labels that are wrong on purpose."""
    if not how:
        return q, target
    kind, amount, random = how[0], float(how[1]), np.random.default_rng(11)
    if kind == "labels":
        chosen = np.flatnonzero(random.random(len(q)) < amount)
        target = target.copy()
        target[chosen] = target[random.permutation(chosen)]
    elif kind == "rows":
        target = random.permutation(target)
    elif kind == "mixed":
        q = q + amount * np.sin(2 * q[:, ::-1])
    elif kind == "noise":
        q = q + amount * q.std(axis=0) * random.standard_normal(q.shape)
    elif kind == "backlash":
        # A joint lags behind its reading by half of the play, on the side that it came from.
        q = q + amount / 2 * random.choice([-1.0, 1.0], q.shape)
    elif kind == "slip":
        # The clutch of the third joint gives way in one direction, once, half-way through.
        q = q.copy()
        q[random.permutation(len(q))[: len(q) // 2], 2] += np.deg2rad(amount)
    elif kind == "missing":
        q = np.delete(q, int(amount), axis=1)
    else:
        raise SystemExit(f"--corrupt is {kind!r}: {', '.join(CORRUPTIONS)}")
    return q, target


def order_right(name: str, order: list[int]) -> str:
    """Whether the order of joints is the true one, where that is known here."""
    if name not in ORDERS and name not in ("cube", "torus", "sphere", "ellipsoid", "double_torus"):
        return "-"
    left = list(order)
    for some in ORDERS.get(name, [(joint,) for joint in range(6)]):
        if set(left[: len(some)]) != set(some):
            return "no"
        left = left[len(some) :]
    return "no" if left else "yes"


def look(name: str, seed: int, args: argparse.Namespace) -> list[tuple[float, float, bool]]:
    """Finds the body of one run and prints its rows, one for each part."""
    touches = args.touches or TOUCHES.get(name, 100_000)
    run = the_run(name, seed, touches, args.runs, args.targets)
    with np.load(run / "representation.npz") as arrays:
        offsets, q = arrays["kernel_offsets"], arrays["kernel_q"].astype(float)
        part, rows = arrays["part"], arrays["kernel_row"]
    target = np.repeat(np.arange(len(part)), np.diff(offsets))
    some = np.sort(np.random.default_rng(seed).permutation(len(q))[:touches])
    q, target, truth = q[some], target[some], the_truth(run, rows[some])
    # Few touches have a benchmark of their own.
    stored = ExperienceReader(run / "experience").batches("sensation")
    felt = kernel_sensations(rows, stored)[some] if len(some) > few.MOST else None
    readings, labels = corrupted(q, target, args.corrupt)
    shuffled = np.random.default_rng(seed + 99).permutation(readings.shape[1])
    readings = readings[:, shuffled]
    began = time.perf_counter()
    with ThreadPoolExecutor(args.threads) as pool:
        model = find_body_model(
            readings, felt, labels, part, joint_names=[f"joint {j}" for j in shuffled],
            seed=seed, each=pool.map,
        )  # fmt: skip
    seconds = time.perf_counter() - began
    chain = model.chain(int(model.toucher_link[0])) if len(model.toucher_link) else []
    right = order_right(name, [int(shuffled[joint]) for joint in chain])
    # Labels may be wrong on purpose: true ones say which part is meant.
    place = model.place(readings, target)
    result = []
    for number in range(len(model.accepted_by_part)):
        own = (model.kernel_part[target] == number) & truth.single & np.isfinite(place).all(axis=1)
        errors, touched = (np.nan, np.nan), ""
        if own.sum() > 20:
            errors = off(place[own], truth.place[own], target[own], truth.skin[own])
            if args.radius:
                extent = float(np.linalg.norm(np.ptp(truth.place[own], axis=0)))
                at = contacts(model, place[own], target[own], truth.place[own], args.radius)
                touched = f"  contacts {misfit(at, truth.place[own], extent):5.2f} %"
        accepted = bool(model.accepted_by_part[number])
        hands = ""
        if len(model.toucher_link) > 1 and own.any():
            found = model.kernel_toucher[own]
            best = [
                np.bincount(truth.toucher[own][found == u]).max()
                for u in np.unique(found[found >= 0])
            ]
            hands = f"  who touched right {sum(best) / max((found >= 0).sum(), 1):6.1%}"
        print(
            f"{name:20s} seed {seed:3d} part {number}  {own.sum():6d} touches",
            f"place {errors[0]:6.2f} kernels {errors[1]:6.2f} %  order right {right:3s}",
            f"accepted {accepted!s:5s}  near {model.held_out[number]:.3f}",
            f"inliers {model.inliers[number]:.3f}{hands}{touched}  {seconds:5.1f} s",
            sep="  ",
            flush=True,
        )
        result.append((*errors, accepted))
    return result


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("experiments", nargs="+")
    parser.add_argument("--seeds", nargs="+", type=int, default=[5, 6, 7, 8, 9])
    parser.add_argument("--touches", type=int, default=0)
    parser.add_argument("--targets", type=int, default=0, help="target sensations")
    parser.add_argument("--runs", type=Path, default=Path("runs/body_model"))
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--radius", type=float, default=0.0, help="metres, of the touchers")
    kinds = "; ".join(f"{kind}: {what}" for kind, what in CORRUPTIONS.items())
    parser.add_argument("--corrupt", nargs=2, metavar=("KIND", "AMOUNT"), help=kinds)
    args = parser.parse_args()
    for name in args.experiments:
        rows = [row for seed in args.seeds for row in look(name, seed, args)]
        place, kernels = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
        print(
            f"{name}: place median {np.nanmedian(place):.2f} worst {np.nanmax(place):.2f} %,",
            f"kernels median {np.nanmedian(kernels):.2f} worst {np.nanmax(kernels):.2f} %,",
            f"accepted {sum(row[2] for row in rows)} of {len(rows)}",
        )


if __name__ == "__main__":
    main()
