"""Statistics of the touches of a run, and what is said about them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np

from selftouch_drake.experience import ExperienceReader
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
            f"body's; follow the change with `selftouch live {run.path}`",
            ChangedBodyWarning,
            stacklevel=3,
        )
