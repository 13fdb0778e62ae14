"""What an import found, in the lines that an engineer would check."""

import numpy as np

from selftouch_drake.experience.recorded import Recording
from selftouch_drake.experiment import Experiment
from selftouch_drake.run.import_oddities import listed, oddities
from selftouch_drake.run.imported import Data


def summary(data: Data, experiment: Experiment) -> list[str]:
    """Lines that say what the recording holds, what was left out, and what looks odd."""
    recording, felt = data.recording, data.felt
    baseline, imported = felt.baseline, experiment.imported
    assert imported is not None
    limits = baseline.threshold[~felt.loose]
    num_alive = len(recording.receptors) - len(data.silent) - len(data.loose)
    found = [
        f"rows: {recording.num_rows:,}, of which {recording.num_incomplete:,} are incomplete and "
        f"{len(felt.null):,} feel nothing; {len(felt.rows):,} touches",
        _time(recording),
        f"joints: {listed(recording.joints)}",
        f"ranges: {_ranges(recording)}",
        f"receptors: {listed(recording.receptors)}; readings "
        f"{'rise' if baseline.rising else 'fall'} with pressure",
        f"alive: {num_alive:,} of {len(recording.receptors):,} receptors feel something",
        f"at rest: {_range(baseline.offset)}, drift {_range(baseline.drift)}, noise "
        f"{_range(baseline.noise)}, threshold {_range(limits)} above rest (median, least to most)",
        *(f"understood: {note}" for note in recording.notes),
        *(f"left out: {num:,} rows: {reason}" for reason, num in recording.left_out.items()),
        len(felt.lost)
        and f"left out: {len(felt.lost):,} rows: nearly all receptors are far from rest at once, "
        "as in a lost packet",
        data.loose
        and f"set aside: {listed(data.loose)}: pressed far longer than the others, whatever "
        "these feel, as by a loose contact",
        baseline.smoothed and "spikes: each reading is the median of three in time",
        felt.num_lone
        and f"spikes: {felt.num_lone:,} readings that no other receptor shared are left out",
        felt.num_fading
        and f"hysteresis: {felt.num_fading:,} rows in which pressure falls are left out, because "
        "readings come back slowly",
        data.silent and f"receptors that never read anything: {listed(data.silent)}",
        data.still and f"joints that never move: {listed(data.still)}",
        *(
            f"column {name} holds {listed(values)}: if it says what touches, choose one by --rows "
            f"'{name}={values[0]}'; several that press one part blur its shape"
            for name, values in recording.choices.items()
        ),
        recording.unused and f"not read: {listed(recording.unused)}",
        *(f"odd: {what}" for what in oddities(data)),
        f"limits of plans: {_range(np.array(imported.max_velocity))} per second, "
        f"{_range(np.array(imported.max_acceleration))} per second²",
    ]
    return [line for line in found if isinstance(line, str)]


def _range(values: np.ndarray) -> str:
    return f"{np.median(values):.3g} ({values.min():.3g} to {values.max():.3g})"


def _time(recording: Recording) -> str:
    """Duration, rate, and where the times are from."""
    pieces = len(np.unique(recording.piece))
    several = f"; {pieces:,} pieces of motion" if pieces > 1 else ""
    if recording.time_s is None:
        return f"time: none, so speeds are not known{several}"
    dt = np.diff(recording.time_s)[recording.follows]
    dt = dt[dt > 0]
    if not len(dt):
        return f"time: {recording.time_from}, which stands still{several}"
    gaps = f", {recording.num_gaps:,} gaps" if recording.num_gaps else ""
    return (
        f"time: {dt.sum():,.4g} s at {1 / np.median(dt):.4g} Hz, from "
        f"{recording.time_from}{gaps}{several}"
    )


def _ranges(recording: Recording) -> str:
    """The range of each joint, of the first twelve."""
    ends = zip(recording.joints, recording.q.min(axis=0), recording.q.max(axis=0), strict=True)
    shown = [f"{name} {low:.3g} to {high:.3g}" for name, low, high in ends]
    return ", ".join(shown[:12]) + (", ..." if len(shown) > 12 else "")
