"""How true an exported body is, in metres, and whether what is learned on it holds on the original.

    python benchmarks/accuracy/take_home.py torus --seeds 31 32
    python benchmarks/accuracy/take_home.py infant --seeds 3 --touches 60000
    python benchmarks/accuracy/take_home.py runs/mine
    python benchmarks/accuracy/take_home.py cube --seeds 31 --touches 15000 --again --pairs 20

A name of an experiment is babbled and learned for each seed (or taken from --runs, if it is there);
a folder is a run that has learned. The body is exported with one known length, the distance of the
two joints whose axes are farthest apart, and with the touchers' mean depth, as the experimenter
knows them. Printed are the error of the scale and its standard error in %, and, after a rigid
motion alone, root mean squares in mm: of the touchers' centres over all touches, as the joints
carry them; of the centres of balls that touch where the touchers do; of the surface's vertices
from the true surface; and of receptors on it; of several skins the worst. A fist's centre and
radius are those of the smooth shape nearest to it (see `Form`). Parts that were rejected are not
exported, as for a user, unless all were.

With --again the export becomes an experiment, on which the agent babbles and learns anew. Printed
are its errors relative to those of the first run, and the contact of plans that `selftouch
plan` makes there: on the export, and on the original.
"""

import argparse
import csv
import itertools
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from pydrake.geometry import Sphere
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.support import SHAPE_BASIS, bulge
from selftouch_drake.agent.practice import NoWayError
from selftouch_drake.bodies.embodiment import pilot_in
from selftouch_drake.evaluation.body_model import Similarity, true_axes
from selftouch_drake.evaluation.motion import random_pairs
from selftouch_drake.evaluation.shape import kernel_truth
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experiment import load_experiment
from selftouch_drake.export.unit import axes_apart
from selftouch_drake.geometry.triangles import sample_triangles
from selftouch_drake.robot.robot import Robot
from selftouch_drake.robot.skins import MovedReceptorsWarning
from selftouch_drake.robot.touchers import triangles_in_frame
from selftouch_drake.robot.world import World
from selftouch_drake.run.artifacts import (
    load_agent,
    load_body,
    load_body_model,
    load_representation,
)
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.exported import Exported, Known, export_model, exported_model
from selftouch_drake.run.scores import score_body, score_model
from selftouch_drake.run.worlds import make_world, run_bodies

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.babbled import learned

#: Of the errors that `selftouch evaluate` prints, those of which the export keeps a share.
SHAPE = ("body_model_place_error_percent", "surface_rms_fraction", "shape_rms_fraction")
#: Of the errors of a part, those that are printed.
COLUMNS = ("centre", "ball", "surface", "receptors")
#: Samples about a point whose triangles are searched for the nearest place.
_NEAR = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Form:
    """A toucher's smooth shape: that whose support function is nearest to its own.

    Attributes:
        centre: `(3,)` m, in the toucher's frame.
        radius: m, its mean.
        shape: `(5,)` m, as in `BodyModel`; zeros for a ball.
    """

    centre: np.ndarray
    radius: float
    shape: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Touched:
    """Touches of a run whose places are known: n rows, each of one contact.

    Attributes:
        row: `(n,)` of `kernel_q`.
        part: `(n,)` part of the skin, as the agent counts.
        skin: `(n,)` skin of the robot.
        centre: `(n, 3)` m, the toucher's centre in the frame of the skin's link.
        ball: `(n, 3)` m, that of a ball, of its mean radius, that touches where the toucher does.
    """

    row: np.ndarray
    part: np.ndarray
    skin: np.ndarray
    centre: np.ndarray
    ball: np.ndarray


def form_of(robot: Robot, number: int) -> Form:
    """The form of a toucher; a ball's is exact."""
    toucher, inspector = robot.touchers[number], robot.scene_graph.model_inspector()
    shapes = [inspector.GetShape(geometry) for geometry in toucher.geometry_ids]
    if len(shapes) == 1 and isinstance(shapes[0], Sphere):
        return Form(centre=np.zeros(3), radius=shapes[0].radius(), shape=np.zeros(5))
    vertices, _ = triangles_in_frame(toucher, inspector)
    direction = np.array(trimesh.creation.icosphere(subdivisions=3).vertices)
    height = np.einsum("na,kab,nb->nk", direction, SHAPE_BASIS, direction)
    terms = np.concatenate([np.ones((len(direction), 1)), direction, height], axis=1)
    found = np.linalg.lstsq(terms, (direction @ vertices.T).max(axis=1), rcond=None)[0]
    return Form(centre=found[1:4], radius=float(found[0]), shape=found[4:])


def touched(run: RunDirectory, world: World) -> Touched:
    """Where touchers truly were."""
    representation = load_representation(run)
    contacts = ExperienceReader(run.truth).take_contacts(representation.kernel_row)
    truth = kernel_truth(representation, contacts, world.receptor_skin)
    kernel = np.repeat(
        np.arange(representation.num_targets), np.diff(representation.kernel_offsets)
    )
    single = np.flatnonzero(np.diff(contacts.offsets) == 1)
    skin, toucher = (each[contacts.offsets[single]] for each in (contacts.skin, contacts.toucher))
    num_skins = len(world.skins)
    kept = (toucher < len(world.robot.touchers)) & (skin == truth.skin[kernel[single]])
    row, skin, toucher = single[kept], skin[kept].astype(int), toucher[kept].astype(int)
    X_WF = world.robot.kinematics.poses(representation.kernel_q[row].astype(float))
    each = np.arange(len(row))
    X_WS, X_WT = X_WF[each, skin], X_WF[each, num_skins + toucher]
    R_ST = np.einsum("nji,njk->nik", X_WS[:, :, :3], X_WT[:, :, :3])
    p_S = np.einsum("nji,nj->ni", X_WS[:, :, :3], X_WT[:, :, 3] - X_WS[:, :, 3])
    centre, ball = np.empty((2, len(row), 3))
    for number, own in grouped(toucher):
        form = form_of(world.robot, number)
        centre[own] = ball[own] = p_S[own] + R_ST[own] @ form.centre
        # Where it touches depends on its shape, and the other way round.
        for _ in range(2 if form.shape.any() else 0):
            inward = np.empty((len(own), 3))
            for worn, here in grouped(skin[own]):
                inward[here] = -above(skin_surface(world, worn), ball[own[here]])[1]
            in_hand = bulge(form.shape, np.einsum("nji,nj->ni", R_ST[own], inward))
            ball[own] = centre[own] + np.einsum("nij,nj->ni", R_ST[own], in_hand)
    part = representation.part[kernel[row]]
    return Touched(row=row, part=part, skin=skin, centre=centre, ball=ball)


def grouped(numbers: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Each number, and where it stands."""
    for number in np.unique(numbers).tolist():
        yield number, np.flatnonzero(numbers == number)


def farthest_joints(world: World) -> tuple[str, str, float]:
    """The two joints that turn whose axes are farthest apart where all read 0, and how far, m."""
    robot = world.robot
    axes = true_axes(robot.kinematics, np.zeros(robot.num_joints))
    twists = np.concatenate([axes.direction, np.cross(axes.place, axes.direction)], axis=1)
    turning = np.flatnonzero(robot.turns)
    apart = {pair: axes_apart(twists[list(pair)]) for pair in itertools.combinations(turning, 2)}
    first, second = max(apart, key=apart.__getitem__)
    return robot.joint_names[first], robot.joint_names[second], apart[first, second]


def skin_surface(world: World, number: int) -> trimesh.Trimesh:
    """The true surface of a skin, m, in the frame of its link."""
    fields = world.skins[number].fields
    return trimesh.Trimesh(fields.vertices, fields.faces, process=False)


def above(surface: trimesh.Trimesh, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(n,)` m, how far points are outside a closed surface, and `(n, 3)` its normals there.

    Inside it is negative.
    """
    triangles = np.array(surface.triangles)
    samples, face = sample_triangles(triangles, float(surface.extents.max()) / 200)
    near = face[cKDTree(samples).query(p, _NEAR)[1]]
    points = np.repeat(p, _NEAR, axis=0)
    off = points - trimesh.triangles.closest_point(triangles[near].reshape(-1, 3, 3), points)
    off = off.reshape(len(p), _NEAR, 3)
    each, best = np.arange(len(p)), np.linalg.norm(off, axis=2).argmin(axis=1)
    normal = surface.face_normals[near[each, best]]
    outside = np.einsum("ni,ni->n", off[each, best], normal)
    return np.copysign(np.linalg.norm(off[each, best], axis=1), outside), normal


def rms(off: np.ndarray) -> float:
    """Root mean square length of `(n, 3)`, or of `(n,)`."""
    return float(np.sqrt(np.square(off).reshape(len(off), -1).sum(axis=1).mean()))


def rigidly(source: np.ndarray, target: np.ndarray) -> Similarity:
    """The rigid motion, or mirror image, that takes places nearest to others."""
    found = Similarity.fitted(source, target)
    shift = target.mean(axis=0) - found.rotation @ source.mean(axis=0)
    return Similarity(scale=1.0, rotation=found.rotation, shift=shift)


@dataclass(frozen=True, slots=True, kw_only=True)
class PartError:
    """How true a part of an export is, after one rigid motion.

    Attributes:
        scale: by which the touchers' centres would have to be multiplied.
        centre: m, root mean square of the touchers' centres.
        ball: m, that of the centres of balls which touch where touchers do.
        surface: m, that of the surface's vertices from the true surface; NaN if there is none.
        receptors: m, that of the receptors on it that were met.
    """

    scale: float
    centre: float
    ball: float
    surface: float
    receptors: float


def part_errors(
    found: Exported, world: World, true: Touched, q: np.ndarray, target: np.ndarray
) -> Iterator[PartError]:
    """The errors of each part."""
    as_points = replace(found.model, toucher_shape=np.zeros_like(found.model.toucher_shape))
    for part in found.parts:
        here = np.flatnonzero(true.part == part)
        if len(here) < 100:
            continue
        row = true.row[here]
        ball, centre = (model.place(q[row], target[row]) for model in (found.model, as_points))
        known = np.isfinite(ball).all(axis=1)
        here, ball, centre = here[known], ball[known], centre[known]
        onto = rigidly(centre, true.centre[here])
        worn = np.bincount(true.skin[here]).argmax()
        surface, mesh = skin_surface(world, worn), found.surface(part)
        receptor = found.receptors(part) + found.surface_depth * found.model.receptor_normal
        met = np.flatnonzero(np.isfinite(receptor).all(axis=1) & (world.receptor_skin == worn))
        p_LS = np.concatenate([skin.fields.p_LS for skin in world.skins])[met]
        yield PartError(
            scale=Similarity.fitted(centre, true.centre[here]).scale,
            centre=rms(onto(centre) - true.centre[here]),
            ball=rms(onto(ball) - true.ball[here]),
            surface=np.nan if mesh is None else rms(above(surface, onto(mesh.vertices))[0]),
            receptors=rms(onto(receptor[met]) - p_LS),
        )


def depth_of(world: World, true: Touched) -> float:
    """m, how deep under the surfaces centres of balls are on average; of some touches."""
    found = []
    for number, own in grouped(true.skin):
        some = true.ball[own[:: max(1, len(own) // 1000)]]
        found.append(-above(skin_surface(world, number), some)[0])
    return float(np.concatenate(found).mean())


def print_export(run: RunDirectory, world: World, true: Touched, known: Known) -> None:
    """Prints how true the export of a run is."""
    representation = load_representation(run)
    q = representation.kernel_q.astype(float)
    target = np.repeat(
        np.arange(representation.num_targets), np.diff(representation.kernel_offsets)
    )
    accepted = load_body_model(run).accepted_by_part
    found = exported_model(run, known, rejected=not accepted.any())
    errors = list(part_errors(found, world, true, q, target))
    scale = np.mean([error.scale for error in errors])
    worst = [max(getattr(error, name) for error in errors) for name in COLUMNS]
    assert known.length is not None
    print(
        f"{run.path.name:>20} {100 * (1 / scale - 1):8.2f} "
        f"{100 * found.unit.sigma / found.unit.metres:8.2f} "
        + " ".join(f"{1e3 * error:10.1f}" for error in worst)
        + f"  {known.length[0]} to {known.length[1]}, {known.length[2]:.3g} m; depth "
        f"{1e3 * (known.depth or 0.0):.1f} mm; {accepted.sum()} of {len(accepted)} parts accepted",
        flush=True,
    )


def learned_again(run: RunDirectory, found: Path) -> RunDirectory:
    """The run of an exported experiment, of as many touches and targets as the first run."""
    first = run.experiment
    changes = {
        "seed": first.seed + 1000,
        "babbling": {"num_samples": first.babbling.num_samples},
        "representation": {"num_targets": first.representation.num_targets},
        "evaluation": {"shape_metrics": []},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MovedReceptorsWarning)
        return learned(found.with_suffix(""), load_experiment(found, changes))


def shape_scores(run: RunDirectory) -> dict[str, float]:
    """Errors as `selftouch evaluate` prints them."""
    representation, world = load_representation(run), make_world(run)
    scores = {
        **score_body(run, world, representation, load_body(run, representation)),
        **score_model(run, world, representation, load_body_model(run)),
    }
    return {name: scores.get(name, np.nan) for name in SHAPE}


def held(run: RunDirectory, original: World, scales: Path, pairs: int) -> np.ndarray:
    """`(pairs, 2)` contact of plans of `selftouch plan`: on the export, and on the original.

    Args:
        run: on the export.
        original: the world of the body that was exported.
        scales: the exported table of joints.
        pairs: of start and goal.
    """
    with scales.open() as opened:
        joints = {row["joint"]: row for row in csv.DictReader(opened)}
    bodies, agent = run_bodies(run), load_agent(run)
    assert bodies.world is not None
    names = [name.rpartition("::")[2] for name in bodies.world.robot.joint_names]
    columns = [names.index(name.rpartition("::")[2]) for name in original.robot.joint_names]
    scale, offset = (
        np.array([float(joints[names[column]][field]) for column in columns])
        for field in ("scale", "offset")
    )
    pilot, contact = pilot_in(bodies, agent, run.experiment), []
    pilot.prepare_queries()
    for start, goal in random_pairs(run.experiment, agent.representation, pairs):
        try:
            motion = pilot.plan(start, goal).motion
        except NoWayError:
            continue
        readings = (motion.q[:, columns] - offset) / scale
        felt = bodies.world.probe.sensations(motion.q), original.probe.sensations(readings)
        contact.append([motion.contact(each) for each in felt])
    return np.array(contact)


def print_again(run: RunDirectory, world: World, known: Known, folder: Path, pairs: int) -> None:
    """Exports a run, learns on the export, and prints what became of it."""
    file = folder / "again.urdf"
    export_model(run, [file], known, rejected=True)
    again = learned_again(run, folder / "again_experiment.yaml")
    before, after = shape_scores(run), shape_scores(again)
    ratios = " ".join(f"{after[name] / before[name]:5.2f}" for name in SHAPE)
    contact = 100 * held(again, world, folder / "again_joints.csv", pairs)
    print(
        f"{'':>20} again: errors over the first's {ratios}; contact, worst: on the export "
        f"{contact[:, 0].mean():.2f} / {contact[:, 0].min():.1f}, on the original "
        f"{contact[:, 1].mean():.2f} / {contact[:, 1].min():.1f}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="+", help="experiments, or folders of runs")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--touches", type=int, default=20_000)
    parser.add_argument("--targets", type=int, default=300)
    parser.add_argument("--runs", type=Path, default=Path("runs/take_home"))
    parser.add_argument("--again", action="store_true", help="learn on the export, and plan there")
    parser.add_argument("--pairs", type=int, default=20, help="plans that are made on the export")
    args = parser.parse_args()
    titles = " ".join(f"{title + ' mm':>10}" for title in COLUMNS)
    print(f"{'run':>20} {'scale %':>8} {'claimed':>8} {titles}  length")
    for name, seed in itertools.product(args.names, args.seeds):
        if Path(name).is_dir():
            path, run = Path(name), RunDirectory.open(Path(name))
        else:
            path = args.runs / f"{name}-{seed}"
            sizes = {
                "seed": seed,
                "babbling": {"num_samples": args.touches},
                "representation": {"num_targets": args.targets},
            }
            run = learned(path, load_experiment(name, sizes))
        world = make_world(run)
        true = touched(run, world)
        known = Known(length=farthest_joints(world), depth=depth_of(world, true))
        print_export(run, world, true, known)
        if args.again:
            print_again(run, world, known, args.runs / f"{path.name}-export", args.pairs)


if __name__ == "__main__":
    main()
