"""Number of touches by skin and by toucher."""

from __future__ import annotations

import numpy as np

from selftouch_drake.experience import ExperienceReader
from selftouch_drake.robot import Robot


def touch_counts(truth: ExperienceReader, robot: Robot) -> tuple[dict[str, int], dict[str, int]]:
    """Number of touches of each skin and by each toucher; a touch of two skins counts for both."""
    skins = [skin.model.name for skin in robot.skins]
    touchers = [toucher.name for toucher in robot.touchers]
    of_skin, by_toucher = np.zeros(len(skins), int), np.zeros(len(touchers) + len(skins), int)
    for contacts in truth.contacts():
        for found, counts in ((contacts.skin, of_skin), (contacts.toucher, by_toucher)):
            pairs = np.unique(contacts.row * len(counts) + found)
            counts += np.bincount(pairs % len(counts), minlength=len(counts))
    # A link that touches with its own skin is numbered as that skin.
    for number, toucher in enumerate(robot.touchers):
        for skin, worn in enumerate(robot.skins):
            if worn.geometry_id in toucher.geometry_ids:
                by_toucher[number] += by_toucher[len(touchers) + skin]
    return (
        dict(zip(skins, of_skin.tolist(), strict=True)),
        dict(zip(touchers, by_toucher[: len(touchers)].tolist(), strict=True)),
    )
