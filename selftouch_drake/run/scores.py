"""Metrics of what was learned, alone and against the truth, as `metrics.json` names them."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.representation.gaps import doubts_of_parts
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.agent.shape.metrics import SHAPE_METRICS
from selftouch_drake.agent.shape.recovery import RecoveredBody, recover
from selftouch_drake.bodies.embodiment import World
from selftouch_drake.evaluation.body_model import place_errors, summary
from selftouch_drake.evaluation.coverage import coverage
from selftouch_drake.evaluation.parts import TouchCounts, TruePart, true_parts
from selftouch_drake.evaluation.shape import (
    KernelTruth,
    distance_distortion,
    kernel_truth,
    neighbour_agreement,
    parts_on_skins,
    shape_rms_fraction,
    trustworthiness,
)
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.geometry.geodesics import surface_distances
from selftouch_drake.run.directory import RunDirectory

Metrics = dict[str, Any]
# Trustworthiness compares this many neighbours, and needs more than twice as many kernels.
_LEAST_FOR_RANKS = 25


def score_body(
    run: RunDirectory, world: World, representation: QuotientRepresentation, body: RecoveredBody
) -> Metrics:
    """Scores what was learned against the truth.

    With several fingers on one hand, a kernel is a pose of the hand and not a place on a skin: all
    metrics that compare places are absent.
    """
    fields = [skin.fields for skin in world.skins]
    counts = TouchCounts(fields, ExperienceReader(run.truth).contacts())
    metrics: Metrics = coverage(
        [(s.vertices, s.faces, n) for s, n in zip(fields, counts.counts, strict=True)]
    )
    contacts = ExperienceReader(run.truth).take_contacts(representation.kernel_row)
    truth = kernel_truth(representation, contacts, world.receptor_skin)
    if not truth.is_surface:
        return metrics
    wanted = run.experiment.evaluation.shape_metrics
    bodies = {body.metric: body}
    for name in SHAPE_METRICS:
        if name != body.metric and (wanted is None or name in wanted):
            seed = run.experiment.seed
            bodies[name] = recover(representation, name, seed=seed, holes=False)
    parts = true_parts(fields, counts, truth)
    return {
        **metrics,
        **confidence_metrics(body),
        **part_metrics(body, parts, several=_several(run, body)),
        **not_recovered(body, truth, run.metrics().get("babbling_touches_by_skin", {})),
        "kernel_spread_median_m": float(np.median(truth.spread)),
        "kernel_spread_worst_m": float(truth.spread.max()),
        **_place_metrics(world, representation, truth, bodies, body.metric),
    }


def score_model(
    run: RunDirectory, world: World, representation: QuotientRepresentation, model: BodyModel
) -> Metrics:
    """Scores a body model against the truth; nothing where no part was accepted."""
    contacts = ExperienceReader(run.truth).take_contacts(representation.kernel_row)
    truth = kernel_truth(representation, contacts, world.receptor_skin)
    errors = place_errors(model, representation, contacts, truth)
    return summary(errors, [skin.name for skin in world.skins])


def found_metrics(
    run: RunDirectory, representation: QuotientRepresentation, body: RecoveredBody
) -> Metrics:
    """What the agent found out about its body: one number for one part, a list for several."""
    topologies = [part.topology for part in body.parts]
    metrics: Metrics = {"parts_found": len(body.parts)}
    if doubts := doubts_of_parts(representation, next(run.touches().touches())[0], topologies):
        metrics["parts_doubt"] = doubts
    in_fragments = representation.num_targets - sum(len(part.kernels) for part in body.parts)
    if in_fragments:
        metrics["kernels_in_fragments"] = in_fragments
    if any(part.doubt for part in body.parts):
        metrics["shape_doubt_by_part"] = [part.doubt for part in body.parts]
    # Of other runs, the truth will say whether there is a shape to be sure of.
    if not run.experiment.has_truth:
        metrics |= confidence_metrics(body)
    if margins := [found.margin for found in topologies if found is not None]:
        metrics["topology_margin"] = min(margins)
    metrics["embedding_fourth_eigenvalue"] = max(
        part.embedding.fourth_eigenvalue for part in body.parts
    )
    by_part: dict[str, list[Any]] = {
        "topology_betti": [None if found is None else list(found.betti) for found in topologies],
        "intrinsic_dimension": [part.dimension for part in body.parts],
        "skin_dimension": [part.skin_dimension for part in body.parts],
        "embedding_dimension": [part.space_dimension for part in body.parts],
    }
    if _several(run, body):
        metrics |= {f"{name}_by_part": values for name, values in by_part.items()}
    else:
        metrics |= {name: values[0] for name, values in by_part.items()}
    return {key: value for key, value in metrics.items() if value is not None}


def confidence_metrics(body: RecoveredBody) -> Metrics:
    """How sure the agent is of the shape; nothing if its metric is not calibrated."""
    if body.expected_error is None:
        return {}
    return {"shape_expected_error": body.expected_error, "shape_trusted": body.trusted}


def part_metrics(body: RecoveredBody, parts: Sequence[TruePart], *, several: bool) -> Metrics:
    """The true parts, each beside the part of the agent's body that has most of its kernels.

    Lists make sense where the body or the robot has several.
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


def not_recovered(
    body: RecoveredBody, truth: KernelTruth, touches_by_skin: Mapping[str, int]
) -> Metrics:
    """Touches of each skin that was touched, but on which no part of the body was recovered."""
    found = {int(truth.skin[k]) for part in body.parts for k in part.kernels}
    missing = {
        name: touches
        for number, (name, touches) in enumerate(touches_by_skin.items())
        if touches and number not in found
    }
    return {"skins_not_recovered": missing} if missing else {}


def _several(run: RunDirectory, body: RecoveredBody) -> bool:
    return len(body.parts) > 1 or len(run.experiment.skins) > 1


# Scores by their key in `metrics.json` and the shape metric, then by the name of the skin.
_Scores = dict[tuple[str, str], dict[str, float]]


def _place_metrics(
    world: World,
    representation: QuotientRepresentation,
    truth: KernelTruth,
    bodies: dict[str, RecoveredBody],
    chosen: str,
) -> Metrics:
    """Scores of the recovered places: the mean of all skins, each weighted by its kernels."""
    on_surface = truth.on_surface([skin.fields for skin in world.skins])
    sizes: dict[str, int] = {}
    scores: _Scores = defaultdict(dict)
    for number, here in parts_on_skins(representation.part, truth).items():
        skin = world.skins[number]
        sizes[skin.name] = len(here)
        true_places = truth.positions[here]
        near = representation.set_distance[np.ix_(here, here)]
        scores["neighbour_agreement", chosen][skin.name] = neighbour_agreement(near, true_places)
        for name, body in bodies.items():
            places = body.positions[here]
            if np.isfinite(places).all():
                shape = shape_rms_fraction(places, true_places)
                surface = shape_rms_fraction(places, on_surface.positions[here])
                scores["shape_rms_fraction", name][skin.name] = shape
                scores["surface_rms_fraction", name][skin.name] = surface
        if len(here) >= _LEAST_FOR_RANKS:
            true = surface_distances(skin.fields.vertices, skin.fields.faces, true_places)
            for name, body in bodies.items():
                found = _distance_scores(body.distances[np.ix_(here, here)], true)
                for key, score in found.items():
                    scores[key, name][skin.name] = score
    metrics = _means(scores, sizes, bodies, chosen)
    if len(world.skins) > 1:
        for key in ("shape_rms_fraction", "surface_rms_fraction"):
            if by_skin := scores.get((key, chosen)):
                metrics[f"{key}_by_skin"] = by_skin
    return metrics


def _distance_scores(found: np.ndarray, true: np.ndarray) -> dict[str, float]:
    """Scores of `(n, n)` distances along the recovered surface, beside the true ones."""
    median, p95 = distance_distortion(found, true)
    return {
        "trustworthiness": trustworthiness(found, true),
        "continuity": trustworthiness(true, found),
        "distance_distortion_median_fraction": median,
        "distance_distortion_p95_fraction": p95,
    }


def _means(scores: _Scores, sizes: dict[str, int], names: Iterable[str], chosen: str) -> Metrics:
    """Means over all skins, of the chosen shape metric; of two scores also of all others."""
    mean = {
        key: float(np.average([*by_skin.values()], weights=[sizes[skin] for skin in by_skin]))
        for key, by_skin in scores.items()
    }
    metrics: Metrics = {key: score for (key, name), score in mean.items() if name == chosen}
    for key in ("shape_rms_fraction", "distance_distortion_median_fraction"):
        if by_metric := {name: mean[key, name] for name in names if (key, name) in mean}:
            metrics[f"{key}_by_metric"] = by_metric
    return metrics
