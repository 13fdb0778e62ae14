"""Statistics of the touches of a run: their force, and their number by skin and by toucher."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np

from selftouch_drake.experience import ExperienceReader
from selftouch_drake.robot import Robot
from selftouch_drake.run.directory import RunDirectory

# mN, largest force in the histogram from which the median comes.
_MOST_FORCE_MN = 1_000_000


class NeverTouchedWarning(UserWarning):
    """A skin was never touched, or something that touches never touched."""


class ChangedBodyWarning(UserWarning):
    """The body changed in the middle of the experience, which is learned from as one body's."""


def force_metrics(run: RunDirectory) -> tuple[float, float]:
    """Median (to a millinewton) and largest force of the touches, in constant memory."""
    counts, largest = np.zeros(_MOST_FORCE_MN + 1, dtype=np.int64), 0.0
    for felt in ExperienceReader(run.experience).batches("sensation"):
        force = felt.sum(axis=1)
        largest = max(largest, float(force.max()))
        bins = np.rint(1e3 * force).astype(np.int64).clip(0, _MOST_FORCE_MN)
        counts += np.bincount(bins, minlength=len(counts))
    return int(np.searchsorted(np.cumsum(counts), counts.sum() / 2)) / 1e3, largest


def touch_counts(run: RunDirectory, robot: Robot) -> tuple[dict[str, int], dict[str, int]]:
    """Number of touches of each skin and by each toucher; a touch of two skins counts for both."""
    skins = [skin.model.name for skin in robot.skins]
    touchers = [toucher.name for toucher in robot.touchers]
    of_skin, by_toucher = np.zeros(len(skins), int), np.zeros(len(touchers) + len(skins), int)
    for contacts in ExperienceReader(run.truth).contacts():
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


def warn_of_untouched(
    run: RunDirectory, by_skin: Mapping[str, int], by_toucher: Mapping[str, int]
) -> None:
    """Warns of skins without a touch, and of touchers that never touched.

    Args:
        run: the run.
        by_skin: touches of each skin, as of `touch_counts`.
        by_toucher: touches by each toucher.

    Warns:
        NeverTouchedWarning: in one line, if there is such a skin or toucher.
    """
    never = [f"skins.{name} was never touched" for name, number in by_skin.items() if not number]
    never += [f"touching.{name} never touched" for name, number in by_toucher.items() if not number]
    if never:
        warnings.warn(
            f"{', '.join(never)} in {run.experiment.babbling.num_samples:,} touches; see what can "
            f"touch what with `selftouch robot {run.path / 'experiment.yaml'} --show`",
            NeverTouchedWarning,
            stacklevel=3,
        )


def warn_of_changes(run: RunDirectory) -> None:
    """Warns that all touches are learned from as one body's, if the body changes on the way.

    Warns:
        ChangedBodyWarning: in one line.
    """
    num_samples = run.experiment.babbling.num_samples
    when = [one.after for one in run.experiment.changes if 0 < one.after < num_samples]
    if when:
        warnings.warn(
            f"changes[].after is {', '.join(f'{touches:,}' for touches in when)}: the body changes "
            f"within its {num_samples:,} touches, and this run learns from all of them as one "
            f"body's; follow the change with `selftouch live {run.path / 'experiment.yaml'}`",
            ChangedBodyWarning,
            stacklevel=3,
        )
