"""All figures of a run: their list, their data, and their files."""

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.evaluation.paths import TruePaths
from selftouch_drake.files import written_whole
from selftouch_drake.run.artifacts import load_agent, load_motion
from selftouch_drake.run.directory import MissingError
from selftouch_drake.run.stages import Progress, silent
from selftouch_drake.show.page import motion_figures, robot_pictures
from selftouch_drake.show.page.found_figures import found_numbers, found_receptors
from selftouch_drake.show.page.motion_figures import felt_and_predicted, growth, life
from selftouch_drake.show.page.shape_figures import body_shape, persistence, quotient_graph
from selftouch_drake.show.page.skeleton_figures import skeleton
from selftouch_drake.show.page.skin_figures import coverage, sensation_map
from selftouch_drake.show.robot_shape import RobotShape
from selftouch_drake.show.run_data import RunData
from selftouch_drake.show.skins import all_moved, touch_paths
from selftouch_drake.show.style import DPI

# Candidate postures for the picture of the agent.
_NUM_POSTURES = 400
# Of these, the clearest, among which the touch is looked at from all sides.
_NUM_CLEAR = 3


def agent(data: RunData) -> Figure:
    """The robot touching itself, where the touch is seen, its joints well clear of its skins."""
    kernel_q, shape = data.representation.kernel_q, RobotShape(data.world)
    q = kernel_q[:: max(len(kernel_q) // _NUM_POSTURES, 1)].astype(float)
    poses = data.world.robot.skin_positions(q)
    middles = np.array([skin.vertices.mean(axis=0) for skin in data.skins])
    centres = np.einsum("nsij,sj->nsi", poses[..., :3], middles) + poses[..., 3]
    away = np.linalg.norm(shape.joints(q)[:, :, None] - centres[:, None], axis=3)
    clear = np.argsort(-away.mean(axis=(1, 2)), kind="stable")[:_NUM_CLEAR]
    felt = data.world.probe.sensations(q[clear])
    drawn = [
        robot_pictures.Touching(all_moved(data.skins, poses[row]), shape.at(q[row]), sensation)
        for row, sensation in zip(clear, felt, strict=True)
    ]
    return robot_pictures.agent(max(drawn, key=robot_pictures.how_well_seen))


def plan_path(data: RunData) -> Figure:
    """One plan over the skins (paper, figure 4)."""
    motion = load_motion(data.run, *data.shown_pair)
    paths, known = (
        [path.moved(data.home[path.skin]) for path in touch_paths(data.world, q)]
        for q in (motion.q, motion.plan.waypoints_q)
    )
    if not paths:
        raise MissingError("the plan of this figure touches nothing; evaluate again")
    return motion_figures.plan_path(data.skins_at_home, paths, known, len(motion.q))


def plan_ways(data: RunData) -> Figure:
    """The same plan before practice, practised and executed, and the shortest way on the skin."""
    start, goal = data.shown_pair
    execution = data.execution(start, goal)
    motion = execution.motion
    agent = load_agent(data.run)
    agent = agent.recalling(RehearsalMemory.blank(agent.representation))
    plan = agent.plan(start, goal, q_start=motion.q[0])
    before = plan.path(np.linspace(0.0, plan.waypoint_s[-1], len(motion.q)))
    of = "imagined, " if plan.is_imagined else ""
    ways = list[motion_figures.FollowedWay]()
    for title, q in (
        (f"{of}before practice", before),
        ("practised", motion.q),
        ("executed", execution.q_measured),
    ):
        paths = touch_paths(data.world, q)
        if not paths:
            raise MissingError("the plan of this figure touches nothing; evaluate again")
        longest = max(paths, key=lambda path: len(path.rows))
        felt = data.world.probe.sensations(q).any(axis=1)
        title = f"{title}: {felt.mean():.0%} in contact"
        ways.append(motion_figures.FollowedWay(title=title, path=longest, num_rows=len(q)))
    skin = ways[0].path.skin
    if any(way.path.skin != skin for way in ways):
        raise MissingError("the motions of this figure are on different skins")
    true = TruePaths([one.fields for one in data.world.skins])
    shortest = true.shortest(skin, ways[0].path.points[[0, -1]])
    return motion_figures.plan_ways(data.skins[skin], ways, shortest)


# In the order of the paper. The name is that of the file.
FIGURES: dict[str, Callable[[RunData], Figure]] = {
    draw.__name__: draw
    for draw in (
        *(agent, coverage, sensation_map, quotient_graph, body_shape, persistence, skeleton),
        *(plan_path, plan_ways, felt_and_predicted, life, growth),
    )
}

# Where nobody knows the robot: what was found, with the numbers and the names on it.
FOUND_FIGURES: dict[str, Callable[[RunData], Figure]] = {
    draw.__name__: draw
    for draw in (
        *(found_numbers, found_receptors, quotient_graph, persistence, skeleton),
        *(life, growth),
    )
}


def figures_of(data: RunData) -> dict[str, Callable[[RunData], Figure]]:
    """The figures of a run: `FIGURES`, or `FOUND_FIGURES` where there is no truth."""
    return FIGURES if data.run.experiment.has_truth else FOUND_FIGURES


def draw_figures(
    data: RunData, progress: Progress = silent, *, vector: bool = False
) -> dict[str, Path | str]:
    """Draws the figures of a run into its folder.

    Older pictures of what cannot be drawn are removed, because they show what is no longer true.

    Args:
        data: of a run with any of its stages done.
        progress: called with the fraction done and what is being drawn.
        vector: whether to write each as PDF as well, for papers: words, lines and marks as such,
            shaded bodies as pictures.

    Returns:
        The PNG file of each figure, or why it cannot be drawn.
    """
    drawn = dict[str, Path | str]()
    data.run.figures.mkdir(exist_ok=True)
    figures = figures_of(data)
    for name in {**FIGURES, **FOUND_FIGURES}.keys() - figures.keys():
        for kind in ("png", "pdf"):
            (data.run.figures / f"{name}.{kind}").unlink(missing_ok=True)
    for number, (name, draw) in enumerate(figures.items()):
        progress(number / len(figures), name.replace("_", " "))
        path, for_papers = (data.run.figures / f"{name}.{kind}" for kind in ("png", "pdf"))
        for_papers.unlink(missing_ok=True)
        try:
            figure = draw(data)
        except MissingError as reason:
            path.unlink(missing_ok=True)
            drawn[name] = str(reason)
            continue
        _write(figure, path, dpi=DPI, metadata={"Software": None})
        if vector:
            _write(figure, for_papers, dpi=2 * DPI, metadata={"CreationDate": None})
        drawn[name] = path
    return drawn


def _write(figure: Figure, path: Path, *, dpi: int, metadata: dict[str, None]) -> None:
    # Letters stay letters in a PDF, as journals ask.
    with written_whole(path) as aside, mpl.rc_context({"pdf.fonttype": 42}):
        figure.savefig(
            aside, format=path.suffix[1:], dpi=dpi, bbox_inches="tight", metadata=metadata
        )
