"""Metrics of what was learned, alone and against the truth, as `metrics.json` names them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.agent.shape import SHAPE_METRICS, Body, recover
from selftouch_drake.evaluation import (
    KernelTruth,
    PartOnSkin,
    TruePart,
    count_touches,
    coverage,
    distance_distortion,
    kernel_truth,
    neighbour_agreement,
    parts_on_skins,
    shape_errors,
    surface_distances,
    touch_density,
    true_parts,
    trustworthiness,
)
from selftouch_drake.experience import ExperienceReader
from selftouch_drake.geometry import ReceptiveFields
from selftouch_drake.robot import World
from selftouch_drake.run.directory import RunDirectory

Metrics = dict[str, Any]
# Trustworthiness compares this many neighbours, and needs more than twice as many kernels.
_LEAST_FOR_RANKS = 25


def score_body(
    run: RunDirectory, world: World, representation: QuotientRepresentation, body: Body
) -> Metrics:
    """Scores what was learned against the truth.

    With several fingers on one hand, a kernel is a pose of the hand and not a place on a skin: all
    metrics that compare places are absent.

    Args:
        run: the run, with its truth.
        world: its world.
        representation: of the agent.
        body: as `learn` recovered it.
    """
    fields = [skin.fields for skin in world.skins]
    counts = count_touches(fields, ExperienceReader(run.truth).contacts())
    metrics: Metrics = coverage(
        [
            (skin.vertices, skin.faces, touch_density(skin.vertices, skin.faces, touches))
            for skin, touches in zip(fields, counts.counts, strict=True)
        ]
    )
    contacts = ExperienceReader(run.truth).take_contacts(representation.kernel_row)
    truth = kernel_truth(representation, contacts)
    if not truth.is_surface:
        return metrics
    bodies = {body.metric: body} | _by_other_metrics(run, representation, body.metric)
    parts = true_parts(fields, counts, truth)
    return {
        **metrics,
        **confidence_metrics(body),
        **part_metrics(body, parts, several=_several(run, body)),
        "kernel_spread_median_m": float(np.median(truth.spread)),
        "kernel_spread_worst_m": float(truth.spread.max()),
        **_shape_metrics(world, representation, truth, bodies, body.metric),
        **_distance_metrics(fields, representation, truth, bodies, body.metric),
    }


def found_metrics(run: RunDirectory, body: Body) -> Metrics:
    """What the agent found out about its body: one number for one part, a list for several."""
    holes = [part.topology for part in body.parts]
    betti = [None if found is None else list(found.betti) for found in holes]
    margins = [found.margin for found in holes if found is not None]
    dimensions = [part.dimension for part in body.parts]
    metrics: Metrics = {"parts_found": len(body.parts)}
    if any(part.doubt for part in body.parts):
        metrics["shape_doubt_by_part"] = [part.doubt for part in body.parts]
    # Of other runs, the truth will say whether there is a shape to be sure of.
    if run.experiment.imported is not None:
        metrics |= confidence_metrics(body)
    if margins:
        metrics["topology_margin"] = min(margins)
    metrics["embedding_fourth_eigenvalue"] = max(
        part.embedding.fourth_eigenvalue for part in body.parts
    )
    if _several(run, body):
        metrics |= {"topology_betti_by_part": betti, "intrinsic_dimension_by_part": dimensions}
    else:
        metrics |= {"topology_betti": betti[0], "intrinsic_dimension": dimensions[0]}
    return {key: value for key, value in metrics.items() if value is not None}


def confidence_metrics(body: Body) -> Metrics:
    """How sure the agent is of the shape; nothing if its metric is not calibrated."""
    if body.expected_error is None:
        return {}
    return {"shape_expected_error": body.expected_error, "shape_trusted": body.trusted}


def part_metrics(body: Body, parts: Sequence[TruePart], *, several: bool) -> Metrics:
    """The true parts, each beside the part of the agent's body that has most of its kernels.

    Args:
        body: K kernels.
        parts: of the truth.
        several: whether the body or the robot has several parts, so that lists make sense.
    """
    metrics: Metrics = {"parts_true": len(parts)}
    if several:
        betti = []
        for part in body.parts:
            shared = [np.isin(part.kernels, true.kernels).sum() for true in parts]
            true = parts[int(np.argmax(shared))] if any(shared) else None
            betti.append(None if true is None or true.betti is None else list(true.betti))
        metrics["topology_betti_true_by_part"] = betti
    return metrics


def _several(run: RunDirectory, body: Body) -> bool:
    return len(body.parts) > 1 or len(run.experiment.skins) > 1


def _by_other_metrics(
    run: RunDirectory, representation: QuotientRepresentation, chosen: str
) -> dict[str, Body]:
    asked = run.experiment.evaluation.shape_metrics
    if asked is None:
        asked = [name for name, metric in SHAPE_METRICS.items() if metric.naive]
    seed = run.experiment.seed
    return {
        name: recover(representation, name, seed=seed, holes=False)
        for name in SHAPE_METRICS
        if name in asked and name != chosen
    }


def _shape_metrics(
    world: World,
    representation: QuotientRepresentation,
    truth: KernelTruth,
    bodies: dict[str, Body],
    chosen: str,
) -> Metrics:
    part = representation.part
    on_surface = truth.on_surface([skin.fields for skin in world.skins])
    errors = {name: shape_errors(body.positions, part, truth) for name, body in bodies.items()}
    sizes = {entry.skin: len(entry.kernels) for entry in parts_on_skins(part, truth)}

    def over_skins(found: dict[int, float]) -> float:
        return _weighted([(error, sizes[skin]) for skin, error in found.items()])

    mean = {name: over_skins(found) for name, found in errors.items() if found}
    near = [
        (
            neighbour_agreement(
                representation.set_distance[np.ix_(entry.kernels, entry.kernels)],
                truth.positions[entry.kernels],
            ),
            len(entry.kernels),
        )
        for entry in parts_on_skins(part, truth)
    ]
    metrics: Metrics = {"neighbour_agreement": _weighted(near)} if near else {}
    from_surface = shape_errors(bodies[chosen].positions, part, on_surface)
    for key, found in (("shape", errors[chosen]), ("surface", from_surface)):
        if found:
            metrics[f"{key}_rms_fraction"] = over_skins(found)
        if len(world.skins) > 1:
            metrics[f"{key}_rms_fraction_by_skin"] = {
                world.skins[skin].name: error for skin, error in found.items()
            }
    return metrics | {"shape_rms_fraction_by_metric": mean}


def _distance_metrics(
    fields: Sequence[ReceptiveFields],
    representation: QuotientRepresentation,
    truth: KernelTruth,
    bodies: dict[str, Body],
    chosen: str,
) -> Metrics:
    entries = [
        entry
        for entry in parts_on_skins(representation.part, truth)
        if len(entry.kernels) >= _LEAST_FOR_RANKS
    ]
    if not entries:
        return {}
    true = [
        surface_distances(
            fields[entry.skin].vertices, fields[entry.skin].faces, truth.positions[entry.kernels]
        )
        for entry in entries
    ]

    def mean(score: Callable[[np.ndarray, np.ndarray], float], body: Body) -> float:
        """Of all skins, each weighing as much as it has kernels."""
        return _weighted(
            [
                (score(_along(body, entry), distances), len(entry.kernels))
                for entry, distances in zip(entries, true, strict=True)
            ]
        )

    by_metric = {
        name: mean(lambda found, true: distance_distortion(found, true).median, body)
        for name, body in bodies.items()
    }
    return {
        "trustworthiness": mean(trustworthiness, bodies[chosen]),
        "continuity": mean(lambda found, true: trustworthiness(true, found), bodies[chosen]),
        "distance_distortion_median_fraction": by_metric[chosen],
        "distance_distortion_p95_fraction": mean(
            lambda found, true: distance_distortion(found, true).p95, bodies[chosen]
        ),
        "distance_distortion_median_fraction_by_metric": by_metric,
    }


def _along(body: Body, entry: PartOnSkin) -> np.ndarray:
    return body.distances[np.ix_(entry.kernels, entry.kernels)]


def _weighted(values: Sequence[tuple[float, int]]) -> float:
    numbers, weights = zip(*values, strict=True)
    return float(np.average(numbers, weights=weights))
