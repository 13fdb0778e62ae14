"""Saves and loads what the agent of a run made; the only module that does.

Files are written whole, and checked when they are read. Files of learning carry a stamp of the
experience; those of another experience or version are refused with the remedy.
"""

import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body_model.model import BodyModel, VersionError
from selftouch_drake.agent.memory import ForeignMemoryError, RehearsalMemory
from selftouch_drake.agent.motions import Execution, Motion
from selftouch_drake.agent.planning.touch_model import TouchModel
from selftouch_drake.agent.representation.embedded import EmbeddedRepresentation
from selftouch_drake.agent.representation.graphs import to_networkx, without_vectors
from selftouch_drake.agent.representation.kernel_sensations import kernel_sensations
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.files import load_arrays, save_arrays, written_whole
from selftouch_drake.run.directory import MissingError, RunDirectory, RunError
from selftouch_drake.run.metrics import keys_of
from selftouch_drake.run.trajectory import write_trajectory

if TYPE_CHECKING:
    from selftouch_drake.agent.shape.recovery import RecoveredBody, RecoveredPart

Arrays = Mapping[str, np.ndarray]


def load_agent(run: RunDirectory, *, predicts: bool = False) -> Agent:
    """The agent of a run that has learned, with its memory of rehearsals.

    If it `predicts`, it predicts sensations from stored touches, where it cannot follow a plan by
    touch first; this reads the whole experience.

    Raises:
        RunError: the run has learned nothing, or something else.
        ValueError: a file is damaged.
    """
    representation = load_representation(run)
    return Agent.of(
        representation,
        memory=load_memory(run, representation),
        kernel_sensation=stored_sensations(run, representation) if predicts else None,
        knot_spacing=run.experiment.planning.knot_spacing,
        prefer=run.experiment.planning.prefer,
        touch_model=_load_touch_model(run),
        body_model=_known_body_model(run),
    )


def stored_sensations(run: RunDirectory, representation: QuotientRepresentation) -> csr_array:
    """`(R, S)` unit L2 norm, the sensation at each row of `kernel_q`; reads all experience."""
    return kernel_sensations(representation.kernel_row, run.touches().batches("sensation"))


def _load_touch_model(run: RunDirectory) -> TouchModel | None:
    """What the agent learned of the ways between its touches; None in an older run."""
    file = run.touch_model
    if not file.exists():
        return None
    arrays = load_arrays(file)
    run.require_stamp(file, arrays)
    with _read_as("a model of touch", file, f"run `selftouch learn {run.path}`"):
        return TouchModel.from_arrays(arrays)


def _known_body_model(run: RunDirectory) -> BodyModel | None:
    """What it found out about its mechanics; None if it was never asked."""
    try:
        return load_body_model(run)
    except MissingError:
        return None


def load_representation(run: RunDirectory) -> EmbeddedRepresentation:
    """The representation of a run that has learned.

    Raises:
        MissingError: there is none.
        RunError: it belongs to another experiment.
        ValueError: the file is damaged.
    """
    file, remedy = run.representation, f"run `selftouch learn {run.path}`"
    if not file.exists():
        raise MissingError(f"{run.path} has learned nothing yet; {remedy}")
    arrays = load_arrays(file)
    with _read_as("a representation", file, remedy):
        representation = EmbeddedRepresentation.from_arrays(arrays)
    _require_sizes(run, file, representation.target_sensations.shape, remedy)
    run.require_stamp(file, arrays)
    return representation


def _require_sizes(run: RunDirectory, file: Path, found: tuple[int, ...], remedy: str) -> None:
    """Rejects a file with other numbers of targets and receptors than the experiment's."""
    wanted = (run.experiment.representation.num_targets, run.num_receptors)
    if found != wanted:
        raise RunError(
            f"{file} has {found[0]} targets over {found[1]} receptors, the experiment {wanted[0]} "
            f"over {wanted[1]}; {remedy}"
        )


def save_learned(
    run: RunDirectory,
    representation: EmbeddedRepresentation,
    body: "RecoveredBody",
    touch_model: TouchModel,
) -> None:
    """Saves what was learned, embedded in the body: everything or nothing.

    Metrics of the old learning and everything that was made from it are dropped.
    """
    stamp = run.stamp()
    # The old files stay as they are until the new ones are complete.
    with ExitStack() as files:
        for file, arrays in (
            (run.representation, representation.to_arrays()),
            (run.touch_model, touch_model.to_arrays()),
            (run.topology, _topology_arrays(body)),
            (run.body_distances, {"distances": body.distances.astype(np.float32)}),
        ):
            save_arrays(files.enter_context(written_whole(file)), arrays | stamp)
        run.drop_metrics(keys_of("learn", "evaluate"))
        run.body_model.unlink(missing_ok=True)
        shutil.rmtree(run.path / "plans", ignore_errors=True)
        run.rehearsal.unlink(missing_ok=True)
        run.trials.unlink(missing_ok=True)


def save_body_model(run: RunDirectory, model: BodyModel) -> None:
    """Saves a body model, accepted or not.

    Metrics of an older one, and of what was evaluated since, are dropped.
    """
    of_models = {key for key in keys_of("learn") if key.startswith("body_model_")}
    run.drop_metrics(of_models | keys_of("evaluate"))
    save_arrays(run.body_model, model.to_arrays() | run.model_stamp())


def load_body_model(run: RunDirectory) -> BodyModel:
    """What the agent found out about the mechanics of its body, whether it accepted it or not.

    Raises:
        MissingError: there is none, because an older version learned or learning was interrupted.
        RunError: it belongs to another experiment or version.
        ValueError: the file is damaged.
    """
    file, remedy = run.body_model, f"run `selftouch learn {run.path}`"
    try:
        arrays = load_arrays(file)
    except FileNotFoundError:
        if not run.representation.exists():
            raise MissingError(f"{run.path} has learned nothing yet; {remedy}") from None
        raise MissingError(f"{run.path} has no body model yet; {remedy}, which adds it") from None
    with _read_as("a body model", file, remedy):
        try:
            model = BodyModel.from_arrays(arrays)
        except VersionError:
            raise RunError(
                f"{file} was made by another version of this program; {remedy}"
            ) from None
    run.require_stamp(file, arrays, stamp=run.model_stamp())
    _require_sizes(run, file, (len(model.kernel_part), len(model.receptor_part)), remedy)
    return model


def load_body(run: RunDirectory, representation: EmbeddedRepresentation) -> "RecoveredBody":
    """The body that `learn` recovered.

    Raises:
        MissingError: it is not there.
        RunError: it is of another experiment.
        ValueError: a file is damaged.
    """
    from selftouch_drake.agent.shape.recovery import RecoveredBody  # not needed to plan

    remedy = f"run `selftouch learn {run.path}`"
    arrays: dict[str, np.ndarray] = {}
    for file, names in ((run.topology, ["num_parts"]), (run.body_distances, ["distances"])):
        try:
            read = load_arrays(file, names)
        except FileNotFoundError:
            raise MissingError(f"{file} is missing; {remedy}") from None
        run.require_stamp(file, read)
        arrays |= read
    distances = arrays["distances"]
    num_kernels = representation.num_targets
    if distances.shape != (num_kernels, num_kernels):
        raise RunError(
            f"{run.body_distances} has shape {distances.shape}, not {(num_kernels, num_kernels)}; "
            f"{remedy}"
        )
    with _read_as("a topology", run.topology, remedy):
        parts = tuple(
            _part_from(arrays, number, representation, distances)
            for number in range(int(arrays["num_parts"]))
        )
    metric = run.experiment.representation.metric
    return RecoveredBody(metric=metric, parts=parts, num_kernels=num_kernels)


def load_memory(run: RunDirectory, representation: QuotientRepresentation) -> RehearsalMemory:
    """The memory of the rehearsals of a run; blank if there were none.

    Raises:
        RunError: the file belongs to another representation.
    """
    file = run.rehearsal
    if not file.exists():
        return RehearsalMemory.blank(representation)
    arrays = load_arrays(file)
    try:
        with _read_as("a memory of rehearsals", file, "delete it"):
            return RehearsalMemory.restored(arrays, representation)
    except ForeignMemoryError:
        raise RunError(
            f"{file} belongs to another representation; delete it and rehearse again"
        ) from None


def save_memory(run: RunDirectory, memory: RehearsalMemory) -> None:
    """Saves the memory of rehearsals."""
    save_arrays(run.rehearsal, memory.to_arrays())


def save_plan(
    run: RunDirectory, plan: Motion | Execution, *targets: int | str, **numbers: float
) -> None:
    """Saves a motion, executed or not, and more numbers, under the targets that name it.

    The motion is written as CSV, too.
    """
    file = run.plan(*targets)
    more = {name: np.array(number) for name, number in numbers.items()}
    save_arrays(file, plan.to_arrays() | more | run.stamp())
    motion = plan.motion if isinstance(plan, Execution) else plan
    write_trajectory(file.with_suffix(".csv"), motion, run.joint_names())


def load_motion(run: RunDirectory, *targets: int | str) -> Motion:
    """The stored motion that the targets name, executed or not; `free_start` names a free start.

    Raises:
        MissingError: there is no such plan.
        RunError: it belongs to another representation.
        ValueError: the file is damaged.
    """
    return _load_plan(run, Motion, targets)


def load_execution(run: RunDirectory, *targets: int | str) -> Execution:
    """A stored execution; arguments and errors as in `load_motion`."""
    return _load_plan(run, Execution, targets)


def stored_pairs(run: RunDirectory) -> list[tuple[int, int]]:
    """Start and goal of all stored plans between two target sensations, in order."""
    names = (path.stem for path in (run.path / "plans").glob("*-*.npz"))
    pairs = (re.fullmatch("([0-9]+)-([0-9]+)", name) for name in names)
    return sorted((int(pair[1]), int(pair[2])) for pair in pairs if pair)


def was_executed(run: RunDirectory, *targets: int | str) -> bool:
    """Whether a stored plan was executed."""
    return "felt" in load_arrays(run.plan(*targets))


def export_graph(run: RunDirectory, representation: QuotientRepresentation) -> None:
    """Writes the quotient graph as GraphML, for other tools."""
    import networkx as nx  # needed here alone

    graph = without_vectors(to_networkx(representation))
    with written_whole(run.path / "quotient_graph.graphml") as aside:
        nx.write_graphml(graph, aside)


def _load_plan(run: RunDirectory, kind, targets: tuple[int | str, ...]):
    file = run.plan(*targets)
    what, options = _described(*targets)
    remedy = f"with `selftouch plan {run.path} {options}`"
    if not file.exists():
        raise MissingError(f"{run.path} has no {what}; make one {remedy}")
    arrays = load_arrays(file)
    run.require_stamp(file, arrays, remedy=f"make it again {remedy}")
    if kind is Execution and "felt" not in arrays:
        raise MissingError(
            f"{run.path} has not executed its {what}; run `selftouch execute {run.path} {options}`"
        )
    with _read_as("a plan", file, f"make it again {remedy}"):
        return kind.from_arrays(arrays)


@contextmanager
def _read_as(what: str, file: Path, remedy: str) -> Iterator[None]:
    """Turns errors of arrays that do not fit together into one short line."""
    try:
        yield
    except (ForeignMemoryError, RunError):
        raise
    except (KeyError, ValueError, IndexError, TypeError) as error:
        text = " ".join(str(error).split()).rstrip(".")
        reason = text if len(text) <= 200 else f"{text[:200]}..."
        raise RunError(f"{file} is not {what}: {reason}; {remedy}") from None


def _described(start: int | str, *goals: int | str) -> tuple[str, str]:
    """A plan in words, and the options that ask for it."""
    if isinstance(start, str):  # a free start, as in q=0.1,0,2
        return f"plan from {start} to {goals[-1]}", f"--from-q Q --to {goals[-1]}"
    if len(goals) > 1:
        through = ",".join(map(str, (start, *goals)))
        return f"plan through {through}", f"--through {through}"
    return f"plan from {start} to {goals[0]}", f"--from {start} --to {goals[0]}"


def _prefix(number: int) -> str:
    """What the names of the arrays of a part begin with; those of the first have no number."""
    return f"part_{number}_" if number else ""


def _topology_arrays(body: "RecoveredBody") -> dict[str, np.ndarray]:
    """The parts of a body, without what the representation and the distances hold."""
    arrays = {"num_parts": np.array(len(body.parts))}
    for number, part in enumerate(body.parts):
        found: dict[str, Any] = {
            "doubt": part.doubt or "",
            "kernels": part.kernels,
            "pieces": np.pad(part.pieces, ((0, 0), (0, 3 - part.pieces.shape[1]))),
            "skin_dimension": part.skin_dimension,
            "embedding_dimension": part.space_dimension,
            "stress": part.embedding.stress,
            "spectrum": part.embedding.spectrum,
        }
        if part.dimension is not None:
            found["dimension"] = part.dimension
        if (holes := part.topology) is not None:
            found["betti"] = holes.betti
            found["scales"] = [holes.margin, holes.scale, holes.meeting_radius]
            found |= {f"diagram_{d}": bars for d, bars in enumerate(holes.diagram)}
        arrays |= {f"{_prefix(number)}{name}": np.array(value) for name, value in found.items()}
    return arrays


def _part_from(
    arrays: Arrays, number: int, representation: EmbeddedRepresentation, distances: np.ndarray
) -> "RecoveredPart":
    from selftouch_drake.agent.shape.recovery import RecoveredPart
    from selftouch_drake.quotient.holes import Topology
    from selftouch_drake.quotient.layout import Embedding

    prefix = _prefix(number)
    found = {
        name.removeprefix(prefix): array
        for name, array in arrays.items()
        if name.startswith(prefix)
    }
    kernels, holes = found["kernels"], None
    if "betti" in found:
        margin, scale, meeting_radius = found["scales"].tolist()
        components, loops, voids = found["betti"].tolist()
        holes = Topology(
            betti=(components, loops, voids),
            margin=margin,
            scale=scale,
            meeting_radius=meeting_radius,
            diagram=(found["diagram_0"], found["diagram_1"], found["diagram_2"]),
        )
    space = int(found["embedding_dimension"])
    return RecoveredPart(
        doubt=str(found["doubt"]) or None,
        kernels=kernels,
        distances=distances[np.ix_(kernels, kernels)],
        skin_dimension=int(found["skin_dimension"]),
        space_dimension=space,
        embedding=Embedding(
            positions=representation.embedding[kernels, :space],
            stress=float(found["stress"]),
            spectrum=found["spectrum"],
        ),
        pieces=found["pieces"][:, :space],
        topology=holes,
        dimension=float(found["dimension"]) if "dimension" in found else None,
    )
