"""The run directory, in which every stage stores its results and finds earlier ones."""

import json
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from selftouch_drake.agent.readings.baseline import Baseline
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experiment import Experiment, dump_experiment, load_experiment
from selftouch_drake.files import (
    UNFINISHED,
    content_digest,
    load_arrays,
    locked,
    remove_unfinished,
    save_arrays,
    write_text_whole,
)
from selftouch_drake.run.fingerprint import (
    Digests,
    experience_fingerprint,
    fingerprint_of,
    model_digests,
)
from selftouch_drake.run.naming import fields_of

#: Increased whenever a file of a run changes its meaning.
RUN_FORMAT = 2
# Digests of the robot's models and meshes.
_MODELS = "models.json"
# What `locked` leaves in a folder.
_LOCK = ".lock"
# What a run has before its first touch; all of it is made again.
_BEFORE_TOUCHES = frozenset(
    {"experiment.yaml", _MODELS, "joints.json", "receptors.json", "skin.npz", "calibration.npz"}
    | {"cache"}
)
_HEADER = "# A run of selftouch_drake, format "


class RunError(ValueError):
    """A run directory that cannot be used; the text names it and the remedy."""


class MissingError(RunError):
    """Something was not made yet, or cannot be; the text says why, and what makes it."""


class Inside:
    """The path of a file or folder of a run or sweep, and what is in it."""

    def __init__(self, name: str, meaning: str):
        self._name, self.meaning = name, meaning

    def __get__(self, run: Any, kind: type) -> Path:
        return run.path / self._name


@dataclass(frozen=True, slots=True)
class RunDirectory:
    """Paths and metrics of one run.

    Use `create` to begin or resume a run, and `open` for a run that exists.
    """

    path: Path
    experiment: Experiment

    experience = Inside("experience", "The agent's experience, in shards.")
    met = Inside("met", "Touches that were met in practice, execution and life, in shards.")
    added = Inside("added", "Touches that `learn --add` added to the experience, in shards.")
    truth = Inside("truth", "The truth, in shards; only the experimenter may read it.")
    skin = Inside("skin.npz", "Receptors and outer surfaces of the skins; part of the truth.")
    baseline = Inside(
        "calibration.npz", "How raw readings become sensations, if the robot is not Drake's."
    )
    free = Inside("free.npz", "Where nothing was felt, of an imported run.")
    representation = Inside("representation.npz", "What the agent learned.")
    touch_model = Inside(
        "touch_model.npz", "How firmly the agent expects to touch, between touches."
    )
    body_model = Inside(
        "body_model.npz", "What the agent found out about the mechanics of its body."
    )
    joints = Inside("joints.json", "The names of the joints, in the order of their readings.")
    receptors = Inside(
        "receptors.json", "The names of the receptors of an imported run, in the order of readings."
    )
    rehearsal = Inside("rehearsal.npz", "What the agent remembers of its rehearsals.")
    trials = Inside("trials.npz", "The result of each random pair.")
    topology = Inside("topology.npz", "The persistence diagram of the recovered body.")
    body_distances = Inside("body_distances.npz", "Distances of kernels on the recovered body.")
    life = Inside("life.npz", "The life of the agent, as curves.")
    cache = Inside("cache", "What commands keep to start sooner; it may be removed at any time.")
    figures = Inside("figures", "Pictures.")
    babbling = Inside("babbling.html", "The first seconds of babbling, to be watched.")
    playback = Inside("playback.html", "The recording of one plan.")
    report = Inside("report.html", "The report of the run.")

    @staticmethod
    def create(path: Path, experiment: Experiment) -> "RunDirectory":
        """Begins a run of `experiment`, or resumes a run of the same experiment."""
        if (path / "experiment.yaml").exists():
            run = RunDirectory.open(path)
            there, here = _all_fields(run.experiment), _all_fields(experiment)
            for name in {**there, **here}:
                if (old := there.get(name)) != (new := here.get(name)):
                    raise RunError(
                        f"{path} was begun with {name} {old!r}, not {new!r}; choose another --out"
                    )
            return run
        # A killed start leaves its orphan, and no run yet.
        if path.exists() and not (
            path.is_dir()
            and all(p.name in (_MODELS, _LOCK) or p.match(UNFINISHED) for p in path.iterdir())
        ):
            raise RunError(f"{path} is neither a run nor empty; choose another --out")
        digests = model_digests(experiment)
        path.mkdir(parents=True, exist_ok=True)
        write_text_whole(path / _MODELS, json.dumps(digests, indent=2) + "\n")
        header = f"{_HEADER}{RUN_FORMAT}\n"
        write_text_whole(path / "experiment.yaml", header + dump_experiment(experiment))
        return RunDirectory(path, experiment)

    @staticmethod
    def open(path: Path) -> "RunDirectory":
        """Opens a run that exists.

        Raises:
            RunError: it is not a run of this version, or a model was edited since its start.
        """
        file = path / "experiment.yaml"
        if not file.is_file():
            raise RunError(
                f"{path} is not a run: it has no experiment.yaml; make one with `selftouch run`"
            )
        with file.open(encoding="utf-8", errors="replace") as lines:
            header = lines.readline().strip()
        if not header.startswith(_HEADER):
            raise RunError(f"{file} does not belong to a run; choose the directory of a run")
        if header != f"{_HEADER}{RUN_FORMAT}":
            raise RunError(
                f"{path} was made by another version (format {header.removeprefix(_HEADER)}, this "
                f"is {RUN_FORMAT}); run the experiment again with another --out"
            )
        run = RunDirectory(path, load_experiment(file))
        for model, digest in run.digests().items():
            # Without the models, everything that needs no world still works.
            if Path(model).is_file() and content_digest(Path(model)) != digest:
                raise run.changed(model)
        return run

    @property
    def num_receptors(self) -> int:
        """S, number of receptors; of a body that alone knows, as in its experience.

        Raises:
            StoreError: it has no experience yet.
        """
        if self.experiment.body_from in ("robot", "imported"):
            return self.experiment.num_receptors
        return next(ExperienceReader(self.experience).batches("sensation")).shape[1]

    def touches(self) -> ExperienceReader:
        """The experience, with what was added to it later."""
        return ExperienceReader(self.experience, self.added)

    def joint_names(self) -> list[str] | None:
        """The names of the joints; None in an older run.

        Raises:
            RunError: the file that holds them is damaged.
        """
        if (imported := self.experiment.imported) is not None:
            return list(imported.joints)
        if not self.joints.exists():
            return None
        return _read_names(self.joints, "the joints get numbers")

    def keep_joint_names(self, names: Sequence[str]) -> None:
        """Stores the names of the joints, unless they are known."""
        if self.experiment.imported is None and not self.joints.exists():
            write_text_whole(self.joints, json.dumps(list(names)) + "\n")

    def receptor_names(self) -> list[str] | None:
        """The names that a recording gives its receptors; None of other runs, and of older ones.

        Raises:
            RunError: the file that holds them is damaged.
        """
        if not self.receptors.exists():
            return None
        return _read_names(self.receptors, "the receptors get numbers")

    def keep_receptor_names(self, names: Sequence[str]) -> None:
        """Stores the names of the receptors."""
        write_text_whole(self.receptors, json.dumps(list(names)) + "\n")

    def known_baseline(self) -> Baseline | None:
        """How raw readings become sensations, if the run knows."""
        if not self.baseline.exists():
            return None
        return Baseline.from_arrays(load_arrays(self.baseline))

    def keep_baseline(self, baseline: Baseline) -> None:
        """Stores how raw readings become sensations."""
        save_arrays(self.baseline, baseline.to_arrays() | self.body_stamp())

    def digests(self) -> Digests:
        """The content of the robot's models and meshes at the start of the run.

        Raises:
            RunError: the file that holds them is damaged.
        """
        file = self.path / _MODELS
        if not file.exists():
            return model_digests(self.experiment)
        digests = _read_json(file)
        if not (isinstance(digests, dict) and all(isinstance(d, str) for d in digests.values())):
            raise RunError(f"{file} is damaged; run the experiment again with another --out")
        return digests

    def require_models(self) -> None:
        """Refuses a world whose models differ from those at the start of the run.

        Raises:
            ExperimentError: a model is not found.
            RunError: the content of a model differs; the text names the model.
        """
        there = set(self.digests().values())
        for model, digest in model_digests(self.experiment).items():
            if digest not in there:
                raise self.changed(model)

    def changed(self, model: str) -> RunError:
        """The error for an edited model file."""
        return RunError(
            f"{model} has changed since {self.path} was begun; restore it, or run the experiment "
            "again with another --out"
        )

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Locks the run for one writer, as `locked`; a RunError refuses a second one."""
        refusal = RunError(
            f"{self.path} is being written by another process; wait for it, or choose another --out"
        )
        with locked(self.path, refusal):
            remove_unfinished(self.path)
            try:
                yield
            finally:
                # A worker that ended at once may have left one.
                remove_unfinished(self.path)

    def discard(self) -> None:
        """Removes what a run without a touch has left, so that a corrected robot can be tried.

        A run that holds anything else, as a touch, stays as it is.
        """
        folders = (self.experience, self.truth)
        made = [file for file in self.path.iterdir() if not file.match(UNFINISHED)]
        if any(
            file.name not in (*_BEFORE_TOUCHES, _LOCK)
            and not (file in folders and not any(file.iterdir()))
            for file in made
        ):
            return
        for file in made:
            if file.is_dir():
                shutil.rmtree(file)
            elif file.name != _LOCK:
                file.unlink()

    def plan(self, *targets: int | str) -> Path:
        """The file of the plan through target sensations, such as `3-50-120`.

        A free start is named by `free_start`.
        """
        return self.path / "plans" / f"{'-'.join(map(str, targets))}.npz"

    def metrics(self) -> dict[str, Any]:
        """All metrics so far; empty before the first stage is done.

        Raises:
            RunError: they are damaged, or of another experience.
        """
        file = self.path / "metrics.json"
        if not file.exists():
            return {}
        found = _read_json(file)
        if not isinstance(found, dict):
            raise RunError(f"{file} is damaged; delete it and evaluate again")
        if found.pop("made_for", None) != str(self.body_stamp()["made_for"]):
            raise RunError(
                f"{file} belongs to another experiment or version; delete it, then babble and "
                "evaluate again: stored walks are kept"
            )
        return found

    def add_metrics(self, metrics: dict[str, Any]) -> None:
        """Adds metrics to `metrics.json`; those of the same name are replaced."""
        self._write_metrics(self.metrics() | metrics)

    def drop_metrics(self, names: Collection[str]) -> None:
        """Removes metrics that are no longer true because an earlier stage ran again."""
        self._write_metrics({k: v for k, v in self.metrics().items() if k not in names})

    def _write_metrics(self, metrics: dict[str, Any]) -> None:
        # What numpy computed becomes plain numbers and lists.
        text = json.dumps(self.body_stamp() | metrics, indent=2, default=lambda it: it.tolist())
        write_text_whole(self.path / "metrics.json", text + "\n")

    def fingerprint(self) -> str:
        """Identifies what decides the experience: see `experience_fingerprint`."""
        return experience_fingerprint(self.experiment, self.digests())

    def learning_fingerprint(self) -> str:
        """Identifies what decides the representation: the experience, and how it is learned from.

        A body model is found beside the representation, and leaves it as it is.
        """
        settings = asdict(self.experiment.representation)
        del settings["body_model"]
        return fingerprint_of([self.fingerprint(), settings])

    def stamp(self) -> dict[str, np.ndarray]:
        """The array that marks files of learning: their format and their experience."""
        return {"made_for": np.array(f"format {RUN_FORMAT}, {self.learning_fingerprint()}")}

    def model_stamp(self) -> dict[str, np.ndarray]:
        """The array that marks the body model: what it was learned from, and whether it was."""
        made_from = [self.learning_fingerprint(), self.experiment.representation.body_model]
        return {"made_for": np.array(f"format {RUN_FORMAT}, {fingerprint_of(made_from)}")}

    def body_stamp(self) -> dict[str, np.ndarray]:
        """The array that marks files of the body, which exist before learning."""
        return {"made_for": np.array(f"format {RUN_FORMAT}, {self.fingerprint()}")}

    def require_stamp(
        self,
        file: Path,
        arrays: Mapping[str, np.ndarray],
        *,
        remedy: str = "",
        stamp: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Refuses the arrays of a file that follows from learning, unless they carry its stamp.

        Raises:
            RunError: they carry another, or none; the remedy is to learn again by default.
        """
        if str(arrays.get("made_for")) != str((stamp or self.stamp())["made_for"]):
            remedy = remedy or f"run `selftouch learn {self.path}`"
            raise RunError(f"{file} belongs to another experiment or version; {remedy}")


def _read_names(file: Path, else_: str) -> list[str]:
    """Names in a file.

    Raises:
        RunError: it is damaged; the text says what happens without it.
    """
    names = _read_json(file)
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        raise RunError(f"{file} is damaged; delete it, and {else_}")
    return names


def _read_json(file: Path) -> Any:
    """What a file holds; None if it is damaged."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return None


def _all_fields(experiment: Experiment) -> dict[str, Any]:
    # The order of skins is that of the readings in a sensation.
    order = {f"the order of {key}": list(getattr(experiment, key)) for key in ("skins", "touching")}
    return fields_of(experiment) | order
