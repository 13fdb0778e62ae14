"""Statistics of the touches of a run, and what is said about them."""

import warnings
from typing import Any

import numpy as np

from selftouch_drake.bodies.embodiment import World
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.run.directory import RunDirectory

# mN, largest force in the histogram from which the median comes.
_MOST_FORCE_MN = 1_000_000


class NeverTouchedWarning(UserWarning):
    """A skin was never touched, or something that touches never touched."""


class ChangedBodyWarning(UserWarning):
    """The body changed in the middle of the experience, which is learned from as one body's."""


def touch_metrics(run: RunDirectory, world: World) -> dict[str, Any]:
    """Metrics of the touches of a run with a robot of Drake's, in constant memory.

    A touch of two skins counts for both. The median force is known to a millinewton.

    Warns:
        NeverTouchedWarning: in one line, of skins without a touch and touchers that never touched.
    """
    robot = world.robot
    by_skin = np.zeros(len(robot.skins), int)
    by_toucher = np.zeros(len(robot.touchers) + len(by_skin), int)
    for contacts in ExperienceReader(run.truth).contacts():
        for found, counts in ((contacts.skin, by_skin), (contacts.toucher, by_toucher)):
            pairs = np.unique(contacts.row * len(counts) + found)
            counts += np.bincount(pairs % len(counts), minlength=len(counts))
    # A link that touches with its own skin is numbered as that skin.
    for number, toucher in enumerate(robot.touchers):
        for skin, worn in enumerate(robot.skins):
            if worn.geometry_id in toucher.geometry_ids:
                by_toucher[number] += by_toucher[len(robot.touchers) + skin]
    forces, largest = np.zeros(_MOST_FORCE_MN + 1, dtype=np.int64), 0.0
    for felt in ExperienceReader(run.experience).batches("sensation"):
        force = felt.sum(axis=1)
        largest = max(largest, float(force.max()))
        bins = np.rint(1e3 * force).astype(np.int64).clip(0, _MOST_FORCE_MN)
        forces += np.bincount(bins, minlength=len(forces))
    skins = {skin.model.name: int(n) for skin, n in zip(robot.skins, by_skin, strict=True)}
    never = [f"skins.{name} was never touched" for name, number in skins.items() if not number]
    never += [
        f"touching.{toucher.name} never touched"
        for toucher, number in zip(robot.touchers, by_toucher, strict=False)
        if not number
    ]
    if never:
        warnings.warn(
            f"{', '.join(never)} in {run.experiment.babbling.num_samples:,} touches; see what can "
            f"touch what with `selftouch robot {run.path / 'experiment.yaml'} --show`",
            NeverTouchedWarning,
            stacklevel=3,
        )
    return {
        "babbling_touches_by_skin": skins,
        "babbling_force_median_N": int(np.searchsorted(np.cumsum(forces), forces.sum() / 2)) / 1e3,
        "babbling_force_max_N": largest,
    }


def warn_of_changes(run: RunDirectory) -> None:
    """Warns that all touches are learned from as one body's, if the body changes on the way."""
    num_samples = run.experiment.babbling.num_samples
    when = [one.after for one in run.experiment.changes if 0 < one.after < num_samples]
    if when:
        warnings.warn(
            f"changes[].after is {', '.join(f'{touches:,}' for touches in when)}: the body changes "
            f"within its {num_samples:,} touches, and this run learns from all of them as one "
            f"body's; follow the change with `selftouch live {run.path}`",
            ChangedBodyWarning,
            stacklevel=3,
        )
