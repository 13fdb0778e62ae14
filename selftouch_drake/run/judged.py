"""Judges what any method, in any language, makes of a recording whose truth is known.

A recording `NAME.npz` has what a method may use; `NAME.truth.npz` beside it has the truth.
`benchmarks/make/recordings.py` makes both and says what they hold.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from selftouch_drake.agent.representation.quotient import LEAST_KERNELS
from selftouch_drake.bodies.embodiment import build_world
from selftouch_drake.evaluation.shape import (
    KernelTruth,
    neighbour_agreement,
    parts_on_skins,
    shape_rms_fraction,
)
from selftouch_drake.experiment import closest, load_experiment, shown
from selftouch_drake.files import load_arrays
from selftouch_drake.quotient.alpha import flat
from selftouch_drake.quotient.graph import connected_edges, neighbour_edges
from selftouch_drake.quotient.holes import topology
from selftouch_drake.quotient.layout import curvature_corrected_mds
from selftouch_drake.resources import RECORDINGS

#: Arrays that say where things are: a file holds one of them, or plans alone.
PLACES = ("touch_places", "receptor_places", "distances")
KEYS = (*PLACES, "rows", "parts", "plans")
_TRUTH = ".truth.npz"
# Most items with distances between them: so many are laid out in half a minute.
_MOST_ITEMS = 2000
# rad or m: how far from its first touch a plan may begin, and between samples of a plan.
_AT_START, _SAMPLED = 0.01, 0.01

#: What a file holds. Places are judged at C cells, small patches of skin, which are to any method
#: what kernels are to ours.
Arrays = Mapping[str, np.ndarray]


def judge(file: Path, recording: str) -> dict[str, Any]:
    """Metrics of what a method hands in for a recording, as `metrics.json` names them.

    Args:
        file: `.npz` with one of `touch_places` `(n, d)`, `receptor_places` `(S, d)` and
            `distances` `(n, n)` or `(S, S)`; d is 2 or 3, unit and pose are free. For fewer touches
            than the recording has, `rows` `(n,)` are their numbers. A method that finds parts gives
            `parts` `(n,)` or `(S,)`, the number of each, -1 for what it leaves out. One that plans
            gives `plans` `(P, T, J)`, joint positions along a plan for each of the `pairs`.
        recording: path of a recording, or the name of a shipped one.

    Raises:
        FileNotFoundError: there is no such file or recording, or no truth beside it.
        ValueError: the file does not fit the recording; the text names array and remedy.
    """
    path = find_recording(recording)
    given = load_arrays(path, ("q", "sensation", "pairs"))
    truth = load_arrays(path.with_name(path.stem + _TRUTH), ("cell", "touch_places"))
    handed = load_arrays(file)
    for name, array in handed.items():
        if name not in KEYS:
            hint = closest(name, KEYS) or f"give some of {', '.join(KEYS)}"
            raise ValueError(f"{file} has an array {shown(name)}, which has no meaning: {hint}")
        if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
            raise ValueError(
                f"{name} holds {array.dtype}, or NaN or infinity; give numbers, and leave things "
                "out by -1 in parts"
            )
    named = [name for name in PLACES if name in handed]
    if len(named) != 1 and (named or "plans" not in handed):
        raise ValueError(
            f"{file} has {' and '.join(named) or 'no places'}; give one of {', '.join(PLACES)}"
        )
    metrics = _of_places(named[0], handed, truth) if named else {}
    return metrics | (_of_plans(handed["plans"], given, truth) if "plans" in handed else {})


def find_recording(recording: str) -> Path:
    """The path of a recording; raises a FileNotFoundError if there is none."""
    for path in (Path(recording), RECORDINGS / f"{recording}.npz"):
        if path.is_file():
            return path
    names = sorted(p.stem for p in RECORDINGS.glob("*.npz") if not p.name.endswith(_TRUTH))
    hint = closest(recording, names) or f"shipped are {', '.join(names)}"
    raise FileNotFoundError(
        f"--recording is {shown(recording)}, neither a file nor shipped: {hint}; "
        "benchmarks/make/recordings.py makes all"
    )


def _of_places(kind: str, handed: Arrays, truth: Arrays) -> dict[str, Any]:
    N, S = len(truth["cell"]), len(truth["receptor_places"])
    places, rows = handed[kind].astype(float), handed.get("rows", np.arange(N))
    once = rows.dtype.kind in "iu" and rows.ndim == 1 and len(np.unique(rows)) == len(rows)
    fits = once and 0 <= rows.min(initial=0) <= rows.max(initial=0) < N
    _require(fits, "rows", rows, f"whole numbers of 0 to {N - 1}, each once")
    apart = kind == "distances"
    of_receptors = kind == "receptor_places" or (
        apart and len(places) == S and "rows" not in handed
    )
    n, items = (S, "receptors") if of_receptors else (len(rows), "touches")
    if apart:
        wanted = f"({n}, {n}) of {n} {items}, at most {_MOST_ITEMS}, symmetric, 0 on the diagonal"
        fits = places.shape == (n, n) and n <= _MOST_ITEMS and np.allclose(places, places.T)
        fits = fits and not places.diagonal().any() and places.min() >= 0
    else:
        wanted = f"({n}, 2) or ({n}, 3), for {n} {items}"
        fits = places.ndim == 2 and len(places) == n and places.shape[1] in (2, 3)
    _require(fits, kind, places, wanted)
    part = handed.get("parts", np.zeros(n, dtype=int))
    fits = part.shape == (n,) and part.dtype.kind in "iu" and part.min() >= -1
    _require(fits, "parts", part, f"({n},) whole numbers from 0 on, or -1, for {n} {items}")
    if apart:
        places = _laid_out(places, part)
    places = np.pad(places, ((0, 0), (0, 3 - places.shape[1])))
    places[part < 0] = np.nan
    if of_receptors:
        return _scores(truth, truth["cell_receptors"], places, truth["receptor_places"], part)
    weight = truth["cell"][rows] == np.arange(len(truth["cell_skin"]))[:, None]
    return _scores(truth, weight.astype(np.float32), places, truth["touch_places"][rows], part)


def _laid_out(distances: np.ndarray, part: np.ndarray) -> np.ndarray:
    """`(n, 3)` places by `(n, n)` symmetric, finite distances, each of `(n,)` parts by itself.

    They may be straight or along the skin; NaN in parts of less than `LEAST_KERNELS` items.
    """
    places = np.full((len(part), 3), np.nan)
    for number in np.unique(part):
        here = np.flatnonzero(part == number)
        if len(here) >= LEAST_KERNELS:
            apart = distances[np.ix_(here, here)]
            edges = connected_edges(neighbour_edges(apart), apart)
            places[here] = curvature_corrected_mds(edges, apart).positions
    return places


def _scores(
    truth: Arrays, weight: np.ndarray, places: np.ndarray, true: np.ndarray, part: np.ndarray
) -> dict[str, Any]:
    """Metrics of n items, touches or receptors, by their `(C, n)` weight in each cell.

    A cell lies at the mean of the `(n, 3)` places of its items, those of the part that most of them
    are on, and truly at the mean of their `(n, 3)` true places: so right places have no error,
    however few they are. All else is as for the kernels of a run.
    """
    known = np.isfinite(places).all(axis=1)
    weight, both = weight[:, known], np.hstack([places, np.nan_to_num(true)])[known]
    _, number = np.unique(part[known], return_inverse=True)
    of_part = np.eye(number.max(initial=0) + 1)[number]
    of_cell = (weight @ of_part).argmax(axis=1)
    weight = weight * of_part[:, of_cell].T
    judged = np.flatnonzero(weight.any(axis=1))
    mean = weight[judged] @ both / weight[judged].sum(axis=1, keepdims=True)
    laid, of_cell, true_part = mean[:, :3], of_cell[judged], truth["cell_part"][judged]
    kernels = KernelTruth(
        skin=truth["cell_skin"][judged],
        positions=mean[:, 3:],
        spread=np.zeros(len(judged)),
        share_single=1.0,
    )
    sizes = np.bincount(of_cell, minlength=1)
    parts = [p for p in np.argsort(-sizes, kind="stable") if sizes[p] >= LEAST_KERNELS]
    holes = [None if flat(laid[of_cell == p]) else topology(laid[of_cell == p]) for p in parts]
    shared = [true_part[(of_cell == p) & (true_part >= 0)] for p in parts]
    betti = [truth["part_betti"][np.bincount(s).argmax()] if len(s) else [-1] for s in shared]
    found: dict[str, Any] = {
        "judged_share": len(judged) / len(truth["cell_skin"]),
        "parts_found": len(parts),
        "parts_true": len(truth["part_betti"]),
        "topology_betti_by_part": [None if one is None else list(one.betti) for one in holes],
        "topology_betti_true_by_part": [list(map(int, b)) if b[0] >= 0 else None for b in betti],
    }
    if margins := [one.margin for one in holes if one is not None]:
        found["topology_margin"] = float(min(margins))
    near, error, size = {}, {}, []
    for skin, here in parts_on_skins(of_cell, kernels).items():
        place, name = kernels.positions[here], str(truth["skins"][skin])
        near[name] = neighbour_agreement(cdist(laid[here], laid[here]), place)
        error[name] = shape_rms_fraction(laid[here], place)
        size.append(len(here))
    if size:
        found["neighbour_agreement"] = float(np.average([*near.values()], weights=size))
        found["surface_rms_fraction"] = float(np.average([*error.values()], weights=size))
        found["surface_rms_fraction_by_skin"] = error
    return found


def _of_plans(plans: np.ndarray, given: Arrays, truth: Arrays) -> dict[str, Any]:
    """How long plans touch, and whether they arrive, in the world that was recorded.

    As in a run, a plan arrives if what is felt at its end is nearest to what is felt at its goal,
    of what is felt in all cells.
    """
    q, (first, last) = given["q"], given["pairs"].T
    fits = plans.ndim == 3 and plans.shape[::2] == (len(first), q.shape[1]) and plans.shape[1] > 1
    fits = fits and np.abs(plans[:, 0] - q[first]).max() < _AT_START
    wanted = f"({len(first)}, T, {q.shape[1]}), each from the first touch of one of the pairs on"
    _require(fits, "plans", plans, wanted)
    world = build_world(load_experiment(str(truth["experiment"]), {"seed": int(truth["seed"])}))
    contact, ends = [], []
    for plan in plans:
        length = np.cumsum([0.0, *np.linalg.norm(np.diff(plan, axis=0), axis=1)])
        s = np.linspace(0.0, length[-1], max(2, int(length[-1] / _SAMPLED)))
        samples = np.stack([np.interp(s, length, joint) for joint in plan.T], axis=1)
        felt = world.probe.sensations(samples)
        contact.append(float(felt.any(axis=1).mean()))
        ends.append(felt[-1])
    felt = np.concatenate([ends, world.probe.sensations(q[last])])
    like = truth["cell_receptors"] / np.linalg.norm(truth["cell_receptors"], axis=1)[:, None]
    there, goal = np.split(np.where(felt.any(axis=1), (felt @ like.T).argmax(axis=1), -1), 2)
    return {
        "unpractised_reach_rate": float(np.mean((there == goal) & (goal >= 0))),
        "unpractised_contact_mean": float(np.mean(contact)),
        "unpractised_contact_worst": float(np.min(contact)),
    }


def _require(valid: bool, name: str, found: np.ndarray, wanted: str) -> None:
    if not valid:
        around = f", {found.min():g} to {found.max():g}" if found.size else ""
        raise ValueError(f"{name} is {found.dtype} {found.shape}{around}; give {wanted}")
