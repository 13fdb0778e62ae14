"""Judges what any method, in any language, makes of a recording whose truth is known.

A recording `NAME.npz` has what a method may use; `NAME.truth.npz` beside it has the truth.
`benchmarks/make/recordings.py` makes both and says what they hold.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from selftouch_drake.agent.representation.quotient import LEAST_OF_PART
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
# rad or m, in any joint: a plan begins within this of its first touch.
_AT_START = 0.01
# rad or m of path, between samples of a plan.
_SAMPLED = 0.01

#: What a file holds. Places are judged at C cells, small patches of skin, which are to any method
#: what kernels are to ours.
Arrays = Mapping[str, np.ndarray]


def judge_submission(file: Path, recording: str) -> dict[str, Any]:
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
    _check_arrays(file, handed)
    named = [name for name in PLACES if name in handed]
    if len(named) != 1 and (named or "plans" not in handed):
        raise ValueError(
            f"{file} has {' and '.join(named) or 'no places'}; give one of {', '.join(PLACES)}"
        )
    metrics: dict[str, Any] = {}
    if named:
        metrics |= _of_places(named[0], handed, truth)
    if "plans" in handed:
        metrics |= _of_plans(handed["plans"], given, truth)
    return metrics


def _check_arrays(file: Path, handed: Arrays) -> None:
    """Raises a ValueError if an array has no meaning, or holds what is no number."""
    for name, array in handed.items():
        if name not in KEYS:
            hint = closest(name, KEYS) or f"give some of {', '.join(KEYS)}"
            raise ValueError(f"{file} has an array {shown(name)}, which has no meaning: {hint}")
        if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
            raise ValueError(
                f"{name} holds {array.dtype}, or NaN or infinity; give numbers, and leave things "
                "out by -1 in parts"
            )


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
    """Metrics of touches' or receptors' places, or of distances between them."""
    num_touches, num_receptors = len(truth["cell"]), len(truth["receptor_places"])
    places, rows = handed[kind].astype(float), handed.get("rows", np.arange(num_touches))
    _check_rows(rows, num_touches)
    are_distances = kind == "distances"
    of_receptors = kind == "receptor_places" or (
        are_distances and len(places) == num_receptors and "rows" not in handed
    )
    num, items = (num_receptors, "receptors") if of_receptors else (len(rows), "touches")
    if are_distances:
        _check_distances(places, num, items)
    else:
        fits = places.ndim == 2 and len(places) == num and places.shape[1] in (2, 3)
        _require(fits, kind, places, f"({num}, 2) or ({num}, 3), for {num} {items}")
    part = handed.get("parts", np.zeros(num, dtype=int))
    fits = part.shape == (num,) and part.dtype.kind in "iu" and part.min() >= -1
    _require(fits, "parts", part, f"({num},) whole numbers from 0 on, or -1, for {num} {items}")
    if are_distances:
        places = _laid_out(places, part)
    places = np.pad(places, ((0, 0), (0, 3 - places.shape[1])))
    places[part < 0] = np.nan
    if of_receptors:
        return _scores(truth, truth["cell_receptors"], places, truth["receptor_places"], part)
    weight = truth["cell"][rows] == np.arange(len(truth["cell_skin"]))[:, None]
    return _scores(truth, weight.astype(np.float32), places, truth["touch_places"][rows], part)


def _check_rows(rows: np.ndarray, num_touches: int) -> None:
    """Raises a ValueError if these do not number touches, each once."""
    once = rows.dtype.kind in "iu" and rows.ndim == 1 and len(np.unique(rows)) == len(rows)
    fits = once and 0 <= rows.min(initial=0) <= rows.max(initial=0) < num_touches
    _require(fits, "rows", rows, f"whole numbers of 0 to {num_touches - 1}, each once")


def _check_distances(distances: np.ndarray, num: int, items: str) -> None:
    """Raises a ValueError if these cannot be distances between a number of items."""
    fits = (
        distances.shape == (num, num)
        and num <= _MOST_ITEMS
        and np.allclose(distances, distances.T)
        and not distances.diagonal().any()
        and distances.min() >= 0
    )
    wanted = f"({num}, {num}) of {num} {items}, at most {_MOST_ITEMS}, symmetric, 0 on the diagonal"
    _require(bool(fits), "distances", distances, wanted)


def _laid_out(distances: np.ndarray, part: np.ndarray) -> np.ndarray:
    """`(n, 3)` places by `(n, n)` symmetric, finite distances, each of `(n,)` parts by itself.

    They may be straight or along the skin; NaN in parts of less than `LEAST_OF_PART` items.
    """
    places = np.full((len(part), 3), np.nan)
    for number in np.unique(part):
        here = np.flatnonzero(part == number)
        if len(here) >= LEAST_OF_PART:
            apart = distances[np.ix_(here, here)]
            edges = connected_edges(neighbour_edges(apart), apart)
            places[here] = curvature_corrected_mds(edges, apart).positions
    return places


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Cells:
    """Where a method laid the cells that can be judged.

    Attributes:
        places: `(n, 3)` in the method's own unit and pose.
        part: `(n,)` the part that most items of each cell are on.
        true_part: `(n,)` the true one; -1 where that is unknown.
        kernels: where they truly are.
    """

    places: np.ndarray
    part: np.ndarray
    true_part: np.ndarray
    kernels: KernelTruth


def _scores(
    truth: Arrays, weight: np.ndarray, places: np.ndarray, true: np.ndarray, part: np.ndarray
) -> dict[str, Any]:
    """Metrics of n items, touches or receptors, by their `(C, n)` weight in each cell.

    The items are at `(n, 3)` places of `(n,)` parts, and truly at `(n, 3)`. All else is as for the
    kernels of a run.
    """
    cells = _cells(truth, weight, places, true, part)
    found: dict[str, Any] = {"judged_share": len(cells.part) / len(truth["cell_skin"])}
    return found | _part_scores(truth, cells) | _place_scores(truth, cells)


def _cells(
    truth: Arrays, weight: np.ndarray, places: np.ndarray, true: np.ndarray, part: np.ndarray
) -> _Cells:
    """The cells of items, as in `_scores`.

    A cell lies at the mean of the places of its items, those of the part that most of them are on,
    and truly at the mean of their true places: so right places have no error, however few they are.
    """
    known = np.isfinite(places).all(axis=1)
    weight, both = weight[:, known], np.hstack([places, np.nan_to_num(true)])[known]
    _, number = np.unique(part[known], return_inverse=True)
    of_part = np.eye(number.max(initial=0) + 1)[number]
    part_of_cell = (weight @ of_part).argmax(axis=1)
    weight = weight * of_part[:, part_of_cell].T
    judged = np.flatnonzero(weight.any(axis=1))
    mean = weight[judged] @ both / weight[judged].sum(axis=1, keepdims=True)
    kernels = KernelTruth(
        skin=truth["cell_skin"][judged],
        positions=mean[:, 3:],
        spread=np.zeros(len(judged)),
        share_single=1.0,
    )
    return _Cells(
        places=mean[:, :3],
        part=part_of_cell[judged],
        true_part=truth["cell_part"][judged],
        kernels=kernels,
    )


def _part_scores(truth: Arrays, cells: _Cells) -> dict[str, Any]:
    """Number and topology of the parts that are large enough, beside those of the true ones."""
    sizes = np.bincount(cells.part, minlength=1)
    parts = [p for p in np.argsort(-sizes, kind="stable") if sizes[p] >= LEAST_OF_PART]
    topologies, betti_true = [], list[list[int] | None]()
    for part in parts:
        here = cells.part == part
        topologies.append(None if flat(cells.places[here]) else topology(cells.places[here]))
        shared = cells.true_part[here & (cells.true_part >= 0)]
        betti = truth["part_betti"][np.bincount(shared).argmax()] if len(shared) else [-1]
        betti_true.append([int(number) for number in betti] if betti[0] >= 0 else None)
    found: dict[str, Any] = {
        "parts_found": len(parts),
        "parts_true": len(truth["part_betti"]),
        "topology_betti_by_part": [
            None if found is None else list(found.betti) for found in topologies
        ],
        "topology_betti_true_by_part": betti_true,
    }
    if margins := [found.margin for found in topologies if found is not None]:
        found["topology_margin"] = float(min(margins))
    return found


def _place_scores(truth: Arrays, cells: _Cells) -> dict[str, Any]:
    """Errors of places: the mean of all skins, each weighted by its cells; none without cells."""
    agreement, error, sizes = list[float](), dict[str, float](), list[int]()
    for skin, here in parts_on_skins(cells.part, cells.kernels).items():
        place, true = cells.places[here], cells.kernels.positions[here]
        agreement.append(neighbour_agreement(cdist(place, place), true))
        error[str(truth["skins"][skin])] = shape_rms_fraction(place, true)
        sizes.append(len(here))
    if not sizes:
        return {}
    return {
        "neighbour_agreement": float(np.average(agreement, weights=sizes)),
        "surface_rms_fraction": float(np.average([*error.values()], weights=sizes)),
        "surface_rms_fraction_by_skin": error,
    }


def _of_plans(plans: np.ndarray, given: Arrays, truth: Arrays) -> dict[str, Any]:
    """How long plans touch, and whether they arrive, in the world that was recorded.

    As in a run, a plan arrives if what is felt at its end is nearest to what is felt at its goal,
    of what is felt in all cells.
    """
    q, (first, last) = given["q"], given["pairs"].T
    fits = (
        plans.ndim == 3
        and plans.shape[::2] == (len(first), q.shape[1])
        and plans.shape[1] > 1
        and np.abs(plans[:, 0] - q[first]).max() < _AT_START
    )
    wanted = f"({len(first)}, T, {q.shape[1]}), each from the first touch of one of the pairs on"
    _require(bool(fits), "plans", plans, wanted)
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
    # The cell that feels most alike; -1 where nothing is felt.
    cell = np.where(felt.any(axis=1), (felt @ like.T).argmax(axis=1), -1)
    there, goal = np.split(cell, 2)
    return {
        "unpractised_reach_rate": float(np.mean((there == goal) & (goal >= 0))),
        "unpractised_contact_mean": float(np.mean(contact)),
        "unpractised_contact_worst": float(np.min(contact)),
    }


def _require(valid: bool, name: str, found: np.ndarray, wanted: str) -> None:
    """Raises a ValueError that says what an array is and what is wanted, unless it is valid."""
    if not valid:
        around = f", {found.min():g} to {found.max():g}" if found.size else ""
        raise ValueError(f"{name} is {found.dtype} {found.shape}{around}; give {wanted}")
