"""The recovered body as data for the report's viewer, in which a reader turns it."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from selftouch_drake.geometry import farthest_points
from selftouch_drake.show.run_data import RunData

# Numbers of sensations that are written on the body; more would cover it.
_NUM_LABELS = 40
# Digits of a place, in units of the body's half size: a picture has no more.
_DIGITS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnableSurface:
    """One part of the recovered body.

    Attributes:
        kernels: `(n,)` numbers of its sensations.
        places: `(N, 3)` any unit: these, and then others that its faces need.
        faces: `(F, 3)` indices into `places`, outward.
        closed: whether it has no rim.
    """

    kernels: np.ndarray
    places: np.ndarray
    faces: np.ndarray
    closed: bool


def turnable_body(data: RunData) -> str:
    """The recovered body as JSON, laid on the real one, in units of its half size.

    Raises:
        MissingError: nothing was learned, or the recovered body is not a surface.
    """
    parts = data.body.parts
    return as_json(
        [
            TurnableSurface(
                kernels=parts[skin.part].kernels,
                places=skin.places,
                faces=skin.faces,
                closed=skin.closed,
            )
            for skin in data.recovered
        ]
    )


def as_json(surfaces: list[TurnableSurface]) -> str:
    """Parts of a body as JSON for the viewer: places, faces, sensations, and which are named."""
    everything = np.concatenate([surface.places for surface in surfaces])
    low, high = everything.min(axis=0), everything.max(axis=0)
    half = float((high - low).max()) / 2 or 1.0
    first = np.concatenate([s.places[: len(s.kernels)] for s in surfaces])
    kernels = np.concatenate([s.kernels for s in surfaces])
    spread = farthest_points(lambda k: np.linalg.norm(first - first[k], axis=1), _NUM_LABELS)
    return json.dumps(
        {
            "parts": [
                {
                    "places": np.round((s.places - (low + high) / 2) / half, _DIGITS).tolist(),
                    "faces": s.faces.tolist(),
                    "kernels": s.kernels.tolist(),
                    "closed": s.closed,
                }
                for s in surfaces
            ],
            "labels": kernels[spread].tolist(),
        },
        separators=(",", ":"),
    )
