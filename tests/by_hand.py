"""Representations that tests lay by hand: the one place that fills in what a test does not say."""

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from selftouch_drake.agent.representation.embedded import EmbeddedRepresentation
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.quotient.representation import Representation

Kind = TypeVar("Kind", bound=Representation)


def laid_by_hand(
    configurations: Sequence[Any],
    edges: Any = (),
    *,
    kind: type[Kind] = QuotientRepresentation,  # type: ignore[assignment]
    **fields: Any,
) -> Kind:
    """A representation whose kernels hold the given configurations, of one part and one mode.

    The configurations of a kernel are `(n, J)`, or `(n,)` for one joint. By default kernels feel
    nothing in common, all touches are equally firm and typical, and everything is at distance 0;
    `fields` replace that.
    """
    kernel_q = np.concatenate(
        [np.asarray(q, dtype=float).reshape(len(q), -1) for q in configurations]
    )
    (num_rows, num_joints), num_kernels = kernel_q.shape, len(configurations)
    edges = np.array(edges, dtype=int).reshape(-1, 2)
    fields = {
        "target_sensations": np.eye(num_kernels),
        "kernel_offsets": np.cumsum([0, *map(len, configurations)]),
        "kernel_q": kernel_q,
        "kernel_row": np.arange(num_rows),
        "kernel_strength": np.ones(num_rows),
        "kernel_error": np.zeros(num_rows),
        "joint_scale": np.ones(num_joints),
        "set_distance": np.zeros((num_kernels, num_kernels)),
        "edges": edges,
        "edge_cost": np.ones(len(edges)),
        "num_touches": num_rows,
    } | fields
    if issubclass(kind, QuotientRepresentation):
        num_receptors = fields["target_sensations"].shape[1]
        fields = {
            "kernel_mode": np.zeros(num_rows, dtype=int),
            "mode_joints": np.ones((1, num_joints), dtype=bool),
            "overlap": np.ones((num_receptors, num_receptors), dtype=bool),
            "part": np.zeros(num_kernels, dtype=int),
        } | fields
    if issubclass(kind, EmbeddedRepresentation):
        fields = {"embedding": np.zeros((num_kernels, 3))} | fields
    return kind(**fields)


def ring_by_hand(
    num_kernels: int = 24,
    members: int = 6,
    *,
    links: Sequence[tuple[int, int]] | None = None,
    seed: int = 0,
    kind: type[Kind] = QuotientRepresentation,  # type: ignore[assignment]
) -> Kind:
    """Kernels on a circle of radius 1 rad in the first two of three joints."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(num_kernels) / num_kernels
    centre = np.stack([np.cos(angle), np.sin(angle), np.zeros(num_kernels)], axis=1)
    kernel_q = np.repeat(centre, members, axis=0)
    kernel_q = kernel_q + 0.03 * rng.normal(size=kernel_q.shape)
    sensor = 2 * np.pi * np.arange(12) / 12
    targets = np.exp(2.0 * np.cos(angle[:, None] - sensor))
    targets /= np.linalg.norm(targets, axis=1, keepdims=True)
    if links is None:
        links = [(k, (k + 1) % num_kernels) for k in range(num_kernels)]
    edges = np.array(sorted((min(e), max(e)) for e in links), dtype=int).reshape(-1, 2)
    distance = np.linalg.norm(centre[:, None] - centre, axis=2)
    fields = {"embedding": centre} if issubclass(kind, EmbeddedRepresentation) else {}
    return laid_by_hand(
        np.split(kernel_q, num_kernels),
        edges,
        kind=kind,
        target_sensations=targets,
        kernel_strength=rng.uniform(1.0, 2.0, len(kernel_q)),
        kernel_error=rng.uniform(0.0, 0.1, len(kernel_q)),
        set_distance=distance,
        edge_cost=distance[edges[:, 0], edges[:, 1]],
        **fields,
    )
