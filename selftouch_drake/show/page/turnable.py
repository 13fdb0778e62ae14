"""The recovered body as data for the report's viewer, in which a reader turns it."""

from __future__ import annotations

import json

import numpy as np

from selftouch_drake.geometry import farthest_points
from selftouch_drake.show.run_data import RunData

# Numbers of sensations that are written on the body; more would cover it.
_NUM_LABELS = 40
# Digits of a place, in units of the body's half size: a picture has no more.
_DIGITS = 3


def turnable_body(data: RunData) -> str:
    """The recovered body as JSON, fitted to the real one, in units of its half size.

    Raises:
        MissingError: nothing was learned, or the recovered body is not a surface.
    """
    skins = data.recovered
    kernels_of = [data.body.parts[skin.part].kernels for skin in skins]
    everything = np.concatenate([skin.places for skin in skins])
    low, high = everything.min(axis=0), everything.max(axis=0)
    half = float((high - low).max()) / 2 or 1.0
    places = np.concatenate([skin.positions for skin in skins])
    labels = farthest_points(lambda k: np.linalg.norm(places - places[k], axis=1), _NUM_LABELS)
    parts = [
        {
            "places": np.round((skin.places - (low + high) / 2) / half, _DIGITS).tolist(),
            "faces": skin.faces.tolist(),
            "kernels": kernels.tolist(),
            "closed": skin.closed,
        }
        for skin, kernels in zip(skins, kernels_of, strict=True)
    ]
    named = np.concatenate(kernels_of)[labels].tolist()
    return json.dumps({"parts": parts, "labels": named}, separators=(",", ":"))
