"""Commands that plan a motion of a run, execute it, and record it."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from selftouch_drake.cli.opening import in_a_body, of_a_run, require_something_to_show
from selftouch_drake.cli.options import numbers

if TYPE_CHECKING:
    import numpy as np

    from selftouch_drake.agent.motions import Execution, Motion
    from selftouch_drake.robot import World
    from selftouch_drake.run.directory import RunDirectory

FROM = click.option(
    "--from", "start", type=int, help="Number of the target sensation to start from."
)
FROM_Q = click.option(
    "--from-q",
    "q_start",
    callback=numbers(float),
    metavar="Q1,Q2,...",
    help="Joint positions to start from, in rad or m, touching or not; instead of --from.",
)
TO = click.option("--to", "goal", type=int, help="Number of the target sensation to reach.")
TO_RECEPTOR = click.option(
    "--to-receptor",
    "receptor",
    metavar="RECEPTOR",
    help="Number or name of a receptor to feel most, instead of --to.",
)
TO_PLACE = click.option(
    "--to-place",
    "place",
    callback=numbers(float),
    metavar="PART,X,Y,Z",
    help="Place on a part of the body model, in its own unit, to touch, instead of --to.",
)
TO_PATTERN = click.option(
    "--to-pattern",
    "pattern",
    metavar="FILE",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="CSV file of one row, with a reading for each receptor, to feel, instead of --to.",
)
THROUGH = click.option(
    "--through",
    callback=numbers(int),
    metavar="I,J,...",
    help="Target sensations to visit in this order, instead of --from and --to.",
)


def of_a_plan(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the run, and the targets that name one of its plans, as `directory` and `targets`."""

    @functools.wraps(command)
    def named(
        directory: "RunDirectory",
        start: int | None,
        q_start: list[float] | None,
        goal: int | None,
        receptor: str | None,
        place: list[float] | None,
        pattern: Path | None,
        through: list[int] | None,
        **options: Any,
    ) -> None:
        goals = {
            "--to": goal,
            "--to-receptor": receptor,
            "--to-place": place,
            "--to-pattern": pattern,
        }
        given = [option for option, value in goals.items() if value is not None]
        if len(given) > 1:
            raise click.UsageError(f"{' and '.join(given)} are both given; give one of them")
        if receptor is not None:
            goal = _target_of(directory, receptor)
        elif place is not None:
            goal = _target_at(directory, place)
        elif pattern is not None:
            goal = _target_like(directory, pattern)
        command(directory, _targets(start, q_start, goal, through), **options)

    return of_a_run(FROM(FROM_Q(TO(TO_RECEPTOR(TO_PLACE(TO_PATTERN(THROUGH(named))))))))


@click.command()
@of_a_plan
@in_a_body
def plan(directory: "RunDirectory", targets: list) -> None:
    """Plan a smooth motion from one sensation to another.

    RUN is a run directory that has learned. The report of the run has a map of the numbers.
    """
    given = click.get_current_context().params
    q_start = given["q_start"]
    imported = directory.experiment.imported is not None
    if imported and given["body"] is None:
        motion = _plan_blind(directory, targets, q_start)
    else:
        motion = _plan_in_a_body(directory, targets, q_start)
    click.echo(f"route: {route_in_words(motion)}\nduration: {motion.time_s[-1]:.2f} s")
    for line in doubts_in_words(motion):
        click.echo(line)
    path = directory.plan(*targets)
    click.echo(f"plan: {path}\njoint trajectory: {path.with_suffix('.csv')}")


@click.command()
@of_a_plan
@click.option(
    "--rehearse",
    "max_tries",
    type=click.IntRange(min=1),
    metavar="N",
    help="Plan and execute up to N times until contact is never lost; remember what failed.",
)
@in_a_body
def execute(directory: "RunDirectory", targets: list, max_tries: int | None) -> None:
    """Execute a plan under full dynamics and store the sensations.

    RUN is a run directory. Make the plan first, with `selftouch plan` and the same options.
    """
    given = click.get_current_context().params
    if max_tries is not None and given["start"] is None:
        option = "--from-q" if given["q_start"] else "--through"
        raise click.UsageError(f"--rehearse is given with {option}; use --from and --to instead")

    from selftouch_drake.agent.tries import best
    from selftouch_drake.run import stages

    if max_tries is None:
        kept = stages.execute(directory, *targets)
    else:
        tries = stages.rehearse(directory, targets[0], targets[1], max_tries)
        kept = best(tries)
        click.echo("tries: " + ", ".join(f"{one.contact:.1%}" for one in tries))
    world = stages.run_bodies(directory).world
    click.echo(f"tracking: {tracking_in_words(kept.execution, world)}")
    click.echo(f"in contact: {kept.contact:.1%} of the time")
    click.echo(f"sensation {targets[-1]}: {'reached' if kept.reached else 'missed'}")
    path, rows = directory.plan(*targets), len(kept.execution.q_measured)
    click.echo(f"stored: what the joints did (q_measured) and what was felt (felt), {rows} rows")
    click.echo(f"plan: {path}\njoint trajectory: {path.with_suffix('.csv')}")


@click.command()
@of_a_plan
def record(directory: "RunDirectory", targets: list) -> None:
    """Record an executed plan as a 3D page.

    The HTML page is written beside the plan in the run directory RUN, and needs no network. The
    report has a recording of its own.
    """
    require_something_to_show(directory, "record")

    from selftouch_drake.show.outputs import write_recording

    path = write_recording(directory, *targets, path=directory.plan(*targets).with_suffix(".html"))
    click.echo(f"recording: {path}")


def route_in_words(motion: "Motion") -> str:
    """The target sensations of the route, and a line that explains each sign used."""
    words: list[str] = []
    visited: list[int] = []
    felt_again = felt_nothing = False
    arrives_in_air = [False, *motion.plan.in_air]
    for node, in_air in zip(motion.plan.nodes, arrives_in_air, strict=True):
        if visited and node == visited[-1]:
            continue  # the same sensation on a slide or a detour
        if in_air and visited[-1] >= 0:
            words.append("| lifts off |")
        if node < 0:
            felt_nothing = True
            words.append("off")
        elif node in visited:
            felt_again = True
            words.append(f"{node}*")
        else:
            words.append(str(node))
        visited.append(node)
    lines = [" ".join(words)]
    if felt_nothing:
        lines.append("off: nothing is felt there")
    if felt_again:
        lines.append("*: felt again, in another posture")
    return "\n       ".join(lines)


def doubts_in_words(motion: "Motion") -> list[str]:
    """A line for each thing that may go wrong, as the agent imagines."""
    return [f"doubt: {doubt}; nobody has followed this plan" for doubt in motion.plan.doubts]


def tracking_in_words(execution: "Execution", world: "World | None") -> str:
    """How far the joints were from the plan, as a root of the mean square for each unit."""
    off = execution.q_measured - execution.motion.q
    if world is None:  # the body has units of its own
        return f"{_root_mean_square(off):.2g}"
    # Joints that have slipped do not read it.
    off = off - world.slip
    turns = world.robot.turns
    words = []
    for joints, unit in ((turns, "mrad"), (~turns, "mm")):
        if joints.any():
            words.append(f"{1e3 * _root_mean_square(off[:, joints]):.1f} {unit}")
    return ", ".join(words)


def _root_mean_square(values: "np.ndarray") -> float:
    import numpy as np

    return float(np.sqrt(np.square(values).mean()))


def _target_of(directory: "RunDirectory", receptor: str) -> int:
    """The target sensation in which a receptor, by number or name, counts most.

    Raises:
        click.UsageError: There is no such receptor, or no target sensation has it.
    """
    from selftouch_drake.agent.representation.touches import kernel_of_receptor
    from selftouch_drake.run.artifacts import load_representation
    from selftouch_drake.run.receptor_map import receptor_names

    representation = load_representation(directory)
    names = receptor_names(directory, representation.target_sensations.shape[1])
    if receptor not in names and not receptor.isdecimal():
        raise click.UsageError(
            f"--to-receptor is {receptor}; give 0 to {len(names) - 1}, or a name from {names[0]} "
            f"to {names[-1]}"
        )
    number = names.index(receptor) if receptor in names else int(receptor)
    try:
        target = kernel_of_receptor(representation, number)
    except ValueError as error:
        raise click.UsageError(f"--to-receptor: {error}") from error
    click.echo(f"receptor {names[number]}: target sensation {target}")
    return target


def _target_at(directory: "RunDirectory", given: list[float]) -> int:
    """The target sensation whose place on a part of the body model is nearest to a place.

    Raises:
        click.UsageError: These are not four numbers, or the model does not know the part.
    """
    from selftouch_drake.run.artifacts import load_body_model

    if len(given) != 4 or not given[0].is_integer():
        text = ",".join(f"{number:g}" for number in given)
        raise click.UsageError(f"--to-place is {text}; give the number of a part and x, y, z")
    try:
        target = load_body_model(directory).target_at(int(given[0]), given[1:])
    except ValueError as error:
        raise click.UsageError(f"--to-place: {error}") from error
    click.echo(f"nearest place that it knows: target sensation {target}")
    return target


def _target_like(directory: "RunDirectory", file: Path) -> int:
    """The target sensation that is most like the readings in a file.

    Raises:
        click.UsageError: The file does not hold one number for each receptor, or nothing is felt.
    """
    import numpy as np

    from selftouch_drake.agent.representation.touches import felt_kernels
    from selftouch_drake.run.artifacts import load_representation

    representation = load_representation(directory)
    num = representation.target_sensations.shape[1]
    try:
        sensation = np.loadtxt(file, delimiter=",", ndmin=2)
    except ValueError as error:
        raise click.UsageError(f"--to-pattern: {file}: {error}") from error
    if sensation.shape != (1, num):
        rows, columns = sensation.shape
        raise click.UsageError(
            f"--to-pattern: {file} has {rows} rows of {columns} numbers; give one row of {num}, "
            "the reading of each receptor"
        )
    if not np.isfinite(sensation).all():
        raise click.UsageError(f"--to-pattern: {file} has a number that is not finite")
    kernels = felt_kernels(representation, sensation[0])
    if not len(kernels):
        raise click.UsageError(f"--to-pattern: nothing is felt in {file}; give readings of a touch")
    click.echo(f"most alike: target sensation {kernels[0]}")
    return int(kernels[0])


def _targets(
    start: int | None, q_start: list[float] | None, goal: int | None, through: list[int] | None
) -> list:
    """The targets that name a plan: what it starts from, what it passes, what it reaches.

    Raises:
        click.UsageError: Start or goal is missing, or given in two ways.
    """
    from selftouch_drake.run.naming import free_start

    num_starts = sum(given is not None for given in (start, q_start, through))
    if num_starts != 1 or (goal is None) != (through is not None):
        raise click.UsageError(
            "start or goal is missing, or given twice; give --from and --to, or --from-q and "
            "--to, or --through alone"
        )
    if through is not None:
        if len(through) < 2:
            raise click.UsageError(
                f"--through is {through[0]}; give at least two target sensations"
            )
        return through
    return [start if q_start is None else free_start(q_start), goal]


def _plan_blind(directory: "RunDirectory", targets: list, q_start: list[float] | None) -> "Motion":
    """Plans from a recording alone, and prints how little is known about the way."""
    from selftouch_drake.run import stages

    if q_start is not None:
        raise click.UsageError(
            f"--from-q needs a body, and {directory.path} was imported: give --body, or "
            "--from, the target sensation felt at the start"
        )
    motion, novelty = stages.plan_imported(directory, *targets)
    click.echo(
        f"novelty: {novelty:.1f} (1 is the usual distance between recorded touches; the "
        "higher, the less is known about the way)"
    )
    return motion


def _plan_in_a_body(
    directory: "RunDirectory", targets: list, q_start: list[float] | None
) -> "Motion":
    """Plans in the run's own body, from a target sensation or from joint positions."""
    import numpy as np

    from selftouch_drake.run import stages

    if q_start is None:
        return stages.plan(directory, *targets)
    return stages.plan(directory, targets[-1], q_start=np.array(q_start))
