"""Runs with experience that another robot recorded, without a robot model and without truth.

An imported run has an experience, like any other, and `learn`, `plan` and `report` work on it. Its
experiment has `imported` in place of robot, skins and touching.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.motions import Motion, Plan
from selftouch_drake.agent.pilot import RATE_HZ
from selftouch_drake.agent.planning.timing import time_path
from selftouch_drake.agent.readings.found_touches import FoundTouches, find_touches
from selftouch_drake.agent.readings.turns import turning, within_a_turn
from selftouch_drake.experience.collect import walk_sizes
from selftouch_drake.experience.recording import Recording, read_recording
from selftouch_drake.experience.store import Shard, write_shard
from selftouch_drake.experiment import Experiment, ExperimentError, experiment_from_fields
from selftouch_drake.experiment.loading import merged
from selftouch_drake.experiment.schema import Imported
from selftouch_drake.files import save_arrays
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.recording_checks import without_faults

# Quantile of the speeds of a joint between rows that sets its limit: the fastest 1 % are slips.
_FAST = 0.99
# 1/s, acceleration allowed per speed allowed, as the default limits of an experiment have it.
# Second differences of recorded joints are mostly noise.
_ACCELERATION_PER_SPEED = 5.0
# Most rows without a touch that a run keeps, at most half of them next to a touch.
_MOST_FREE = 100_000
# rad/s or m/s, if the data have no times.
_DEFAULT_SPEED = 1.0
# How touches are found; everything else says how a recording is read.
_OF_TOUCHES = ("offset", "threshold", "rising", "filtering")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Data:
    """A recording, and the touches in it.

    Attributes:
        source: the file or folder of the recording.
        recording: n rows of J joints and S receptors.
        felt: the touches.
    """

    source: Path
    recording: Recording
    felt: FoundTouches

    @property
    def still(self) -> list[str]:
        """Names of the joints that never move."""
        travel = np.ptp(self.recording.q, axis=0)
        return [self.recording.joints[joint] for joint in np.flatnonzero(travel == 0)]

    @property
    def silent(self) -> list[str]:
        """Names of the receptors that never feel anything."""
        loose = set(np.flatnonzero(self.felt.loose).tolist())
        return [self.recording.receptors[n] for n in self.felt.silent.tolist() if n not in loose]

    @property
    def loose(self) -> list[str]:
        """Names of the receptors that are set aside as loose contacts."""
        return [self.recording.receptors[number] for number in np.flatnonzero(self.felt.loose)]


def read_data(source: Path, **how: Any) -> Data:
    """Reads a recording as `read_recording` and finds the touches in it as `find_touches`.

    Raises:
        FileNotFoundError: there is no recording.
        ValueError: it cannot be used; the text says why.
    """
    settings = {name: how.pop(name) for name in _OF_TOUCHES if name in how}
    recording = without_faults(read_recording(source, **how))
    felt = find_touches(recording.q, recording.readings, **settings)
    turn = turning(felt.q, felt.sensation)
    if turn.any():
        names = [recording.joints[joint] for joint in np.flatnonzero(turn)]
        note = (
            f"{', '.join(names)} turned more than once, and touches come back after a turn: taken "
            "within one turn, as plans will be"
        )
        recording = replace(
            recording,
            q=within_a_turn(recording.q, turn),
            turn=turn,
            notes=(*recording.notes, note),
        )
        felt = replace(felt, q=recording.q[felt.rows].astype(float))
    return Data(source=source.resolve(), recording=recording, felt=felt)


def imported_experiment(
    data: Data,
    *,
    overrides: Mapping[str, Any] | None = None,
    max_velocity: float | None = None,
    max_acceleration: float | None = None,
) -> Experiment:
    """The experiment of a run whose data come from another robot.

    `overrides` are as in `load_experiment`. The limits, in rad or m per s and per s², hold for all
    joints; by default the velocity of each is the 99th percentile of its recorded speeds, or 1
    if no time was recorded, and the acceleration five times that.

    Raises:
        ExperimentError: a field has an impossible value.
    """
    recording, felt = data.recording, data.felt
    num_joints = len(recording.joints)
    velocity = np.full(num_joints, _DEFAULT_SPEED if max_velocity is None else max_velocity)
    if max_velocity is None and len(speeds := recording.speeds()):
        fast = np.quantile(speeds, _FAST, axis=0)
        velocity = np.where(fast > 0, fast, velocity)
    acceleration = _ACCELERATION_PER_SPEED * velocity
    if max_acceleration is not None:
        acceleration[:] = max_acceleration
    given = {"name": data.source.stem, **(overrides or {})}
    if taken := [name for name in ("imported", "babbling") if name in given]:
        raise ExperimentError(f"{taken[0]} comes from the imported data; leave it out of --set")
    fields = {
        "babbling": {"num_samples": len(felt.rows)},
        "imported": {
            "source": str(data.source),
            "content": _content(felt),
            "joints": list(recording.joints),
            "num_receptors": len(recording.receptors),
            "max_velocity": velocity.tolist(),
            "max_acceleration": acceleration.tolist(),
        },
    }
    return experiment_from_fields(merged(fields, given))


def _are_numbers(names: Sequence[str]) -> bool:
    """Whether names only count the columns of one array, as `touch[0]`, `touch[1]`, ..."""
    array = names[0].rpartition("[")[0] if names else ""
    return list(names) == [f"{array}[{number}]" for number in range(len(names))]


def store(run: RunDirectory, data: Data) -> None:
    """Writes touches, names and baseline of the receptors, and where nothing was felt."""
    felt, baseline, last = data.felt, data.felt.baseline, 0
    if not _are_numbers(data.recording.receptors):
        run.keep_receptor_names(data.recording.receptors)
    run.keep_baseline(baseline)
    save_arrays(run.free, free_rows(data, run.experiment.seed) | run.body_stamp())
    ends = np.cumsum(walk_sizes(run.experiment)).tolist()
    for walk, (first, end) in enumerate(zip([0, *ends], ends, strict=False)):
        rows = felt.rows[first:end]
        before, last = last, len(data.recording.q) if end == ends[-1] else int(rows[-1]) + 1
        shard = Shard(
            walk=walk,
            num_steps=last - before,
            step=data.recording.row[rows],
            q=felt.q[first:end],
            sensation=felt.sensation[first:end],
        )
        write_shard(run.path, shard, fingerprint=run.fingerprint())
    run.add_metrics(
        {
            "babbling_num_samples": len(felt.rows),
            "import_num_rows": data.recording.num_rows,
            "import_num_incomplete": data.recording.num_incomplete,
            "import_num_null": len(felt.null),
            "import_offset_median": float(np.median(baseline.offset)),
            "import_drift_max": float(baseline.drift.max()),
            "import_noise_median": float(np.median(baseline.noise)),
            "import_threshold_median": float(np.median(baseline.threshold[~felt.loose])),
            "import_num_lost": len(felt.lost),
            "import_num_left_out": sum(data.recording.left_out.values()),
            "import_num_lone": felt.num_lone,
            "import_num_fading": felt.num_fading,
            **({"import_silent_receptors": data.silent} if data.silent else {}),
            **({"import_loose_receptors": data.loose} if data.loose else {}),
            **({"import_still_joints": data.still} if data.still else {}),
        }
    )


def free_rows(data: Data, seed: int) -> dict[str, np.ndarray]:
    """A thin sample of the configurations in which nothing is felt: where the robot can be.

    Returns:
        `q`: `(m, J)` float32, in the order of the recording; `next_to_touch`: `(m,)` bool, the last
        before a touch or the first after one. At most 100,000.
    """
    rng, piece, null = np.random.default_rng(seed), data.recording.piece, data.felt.null
    touching = np.ones(len(piece), dtype=bool)
    touching[null] = touching[data.felt.lost] = False
    turns = (touching[1:] != touching[:-1]) & (piece[1:] == piece[:-1]) & data.felt.successive
    beside = np.append(turns, False) | np.insert(turns, 0, False)
    kinds = null[beside[null]], null[~beside[null]]
    rows = np.sort(np.concatenate([rng.permutation(kind)[: _MOST_FREE // 2] for kind in kinds]))
    return {"q": data.recording.q[rows].astype(np.float32), "next_to_touch": beside[rows]}


def timed(agent: Agent, plan: Plan, imported: Imported) -> Motion:
    """A plan with times within the limits of an imported run, and what the agent expects to feel.

    Raises:
        ValueError: the limits are so low that the motion would take too long.
    """
    found = time_path(
        plan.path,
        velocity_limit=np.array(imported.max_velocity),
        acceleration_limit=np.array(imported.max_acceleration),
        rate_hz=RATE_HZ,
    )
    return agent.motion(plan, time_s=found.time_s, s=found.s, q=found.q, v=found.v)


def _content(felt: FoundTouches) -> str:
    digest = hashlib.sha256()
    for array in (felt.rows, felt.q.astype(np.float32), felt.sensation):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
