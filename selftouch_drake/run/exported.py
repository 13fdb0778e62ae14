"""The body model of a run as files for simulators and for the owner of the robot."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from selftouch_drake.agent.body_model.model import UNUSED, BodyModel
from selftouch_drake.export.experiment_text import (
    Worn,
    directives_text,
    experiment_text,
    fitting_thickness,
    toucher_radius,
)
from selftouch_drake.export.field_reach import field_reach
from selftouch_drake.export.link_tree import LinkTree, joint_limits, link_tree
from selftouch_drake.export.mjcf import mjcf_text
from selftouch_drake.export.pure_joints import with_pure_joints
from selftouch_drake.export.sdformat import sdformat_text
from selftouch_drake.export.similar import similar_model
from selftouch_drake.export.surface import (
    PartSurface,
    part_surface,
    toucher_surface,
    with_receptors_on,
)
from selftouch_drake.export.tables import (
    JOINT_COLUMNS,
    RECEPTOR_COLUMNS,
    joint_rows,
    receptor_rows,
)
from selftouch_drake.export.unit import (
    Unit,
    better_joints,
    extent,
    unit_from_joints,
    unit_from_receptors,
)
from selftouch_drake.export.urdf import urdf_text
from selftouch_drake.export.xml_text import MADE_UP
from selftouch_drake.files import write_csv, write_text_whole, written_whole
from selftouch_drake.run.artifacts import load_body_model, load_representation, stored_sensations
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.model_text import headline, is_off
from selftouch_drake.run.receptor_map import receptor_names

if TYPE_CHECKING:
    import trimesh

#: Writers of the formats, by the suffix of the file.
WRITERS: Mapping[str, Callable[[LinkTree], str]] = {
    ".urdf": urdf_text,
    ".sdf": sdformat_text,
    ".xml": mjcf_text,
}
#: Formats of meshes; files of robots name the first one.
MESHES = ("obj", "stl", "ply")

# A move of places by this share of the extent of the skin is rounding.
_UNSEEN = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """What the owner of the robot knows, and touch cannot tell.

    Attributes:
        length: two joints, and how far apart their axes are, m.
        distance: two receptors, and how far apart they are, m.
        depth: m, how deep under the surface of the skin the centre of a toucher passes; negative if
            it stays outside.
        mirror: whether the model is the mirror image of the body.
    """

    length: tuple[str, str, float] | None = None
    distance: tuple[str, str, float] | None = None
    depth: float | None = None
    mirror: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exported:
    """A body model as it goes into files.

    Attributes:
        model: in the files' unit, with pure joints: `link_poses` are the poses of the links there.
        slides: `(J,)` bool, whether a joint slides.
        experience: `(R, J)` readings, whose range becomes the limits.
        target: `(R,)` target sensation of each.
        parts: of the skin that are exported.
        surfaces: of parts that have one.
        receptor_names: `(S,)`.
        unit: of the files.
        depth: as in `Known`; None if nobody knows it.
        comments: what a reader of the files should know.
    """

    model: BodyModel
    slides: np.ndarray
    experience: np.ndarray
    target: np.ndarray
    parts: Sequence[int]
    surfaces: Mapping[int, PartSurface]
    receptor_names: Sequence[str]
    unit: Unit
    depth: float | None
    comments: Sequence[str]

    @property
    def surface_depth(self) -> float:
        """How far above the centres of touchers surfaces lie; 0 if nobody knows it."""
        return self.depth or 0.0

    def surface(self, part: int) -> "trimesh.Trimesh | None":
        """The surface of a part, in the frame of its link; None if it has none."""
        found = self.surfaces.get(part)
        return None if found is None else found.raised(self.surface_depth)

    def touches(self, part: int) -> tuple[np.ndarray, np.ndarray]:
        """Touches on a part; see `_touches`."""
        return _touches(self.model, self.experience, self.target, part)

    def receptors(self, part: int) -> np.ndarray:
        """`(S, 3)` places of the receptors of a part; NaN for all others."""
        own = self.model.receptor_part == part
        return np.where(own[:, None], self.model.receptor_place, np.nan)

    def tree(self, name: str, meshes: Mapping[str, tuple[str, np.ndarray]]) -> LinkTree:
        """Links and joints; arguments are as in `link_tree`."""
        return link_tree(
            self.model,
            self.slides,
            joint_limits(self.model, self.slides, self.experience),
            name=name,
            meshes=meshes,
            parts=self.parts,
            comments=self.comments,
        )


def exported_model(run: RunDirectory, known: Known, *, rejected: bool = False) -> Exported:
    """The body model of a run as it goes into files; nothing is written.

    Args:
        run: that has learned.
        known: what its owner knows.
        rejected: whether rejected parts are exported as well.

    Raises:
        RunError: there is no body model.
        ValueError: it is rejected, or what is known does not fit it.
    """
    model = load_body_model(run)
    parts = _exported_parts(run, model, rejected)
    names = receptor_names(run, len(model.receptor_part))
    # Before anything slow: what the user gave may not fit.
    _unit(model, names, known)
    representation = load_representation(run)
    target = np.repeat(np.arange(len(model.kernel_part)), np.diff(representation.kernel_offsets))
    seen = replace(model, part_link=_links_of(model, parts))
    pure = with_pure_joints(seen, representation.kernel_q, target)
    surfaces = {}
    for part in parts:
        _, touches = _touches(pure.model, representation.kernel_q, target, part)
        if (surface := part_surface(pure.model, part, touches)) is not None:
            surfaces[part] = surface
    found = with_receptors_on(pure.model, surfaces)
    unit = _unit(
        found, names, known, depth=known.depth or 0.0, touches=(representation.kernel_q, target)
    )
    comments = [
        f"made by selftouch from the body model of {run.path.name}: {headline(model)}",
        unit.text(),
        *([better] if (better := better_joints(found, unit)) else []),
        *_told(known),
        *_moved_by(pure.shift / extent(model)),
    ]
    similar: dict[str, Any] = {"metres": unit.metres, "mirrored": known.mirror}
    return Exported(
        model=similar_model(found, **similar),
        surfaces={part: surface.similar(**similar) for part, surface in surfaces.items()},
        slides=pure.slides,
        experience=representation.kernel_q,
        target=target,
        parts=parts,
        receptor_names=names,
        unit=unit,
        depth=known.depth,
        comments=comments,
    )


def _touches(
    model: BodyModel, q: np.ndarray, target: np.ndarray, part: int
) -> tuple[np.ndarray, np.ndarray]:
    """Touches on a part that a model explains.

    Args:
        model: with places of kernels.
        q: `(R, J)` readings.
        target: `(R,)` target sensation of each.
        part: of the skin.

    Returns:
        `(n,)` rows of `q`, and `(n, 3)` where the toucher's centre was in each.
    """
    rows = np.flatnonzero((model.kernel_part[target] == part) & (model.kernel_toucher >= 0))
    return rows, model.place(q[rows], target[rows])


def export_model(
    run: RunDirectory, files: Sequence[Path], known: Known, *, rejected: bool = False
) -> list[str]:
    """Writes the body model of a run to files, with meshes and tables beside each.

    Args:
        run: that has learned.
        files: each of a suffix of `WRITERS`.
        known: what the owner of the robot knows.
        rejected: whether rejected parts are exported as well.

    Returns:
        Lines that say what was written, and what a reader should know.

    Raises:
        RunError: there is no body model.
        ValueError: a suffix is unknown, or as in `exported_model`; then nothing is written.
    """
    for file in files:
        if file.suffix not in WRITERS:
            raise ValueError(
                f"--urdf is {file}, of an unknown format; end it in {', '.join(WRITERS)}"
            )
    found = exported_model(run, known, rejected=rejected)
    surfaces = _surfaces(found)
    lines = []
    for stem in dict.fromkeys(file.with_suffix("") for file in files):
        stem.parent.mkdir(parents=True, exist_ok=True)
        meshes = _write_meshes(stem, surfaces)
        for file in files:
            if file.with_suffix("") == stem:
                text = WRITERS[file.suffix](found.tree(stem.name, meshes))
                write_text_whole(file, text)
                lines.append(f"body: {file}")
        lines += _write_tables(stem, found)
        lines += _write_experiment(run, stem, found, surfaces, files)
        lines += [f"surface: {stem}_{name}.obj (.stl, .ply)" for name in surfaces]
    without = [f"part_{part}" for part in found.parts if f"part_{part}" not in surfaces]
    if without:
        lines.append(f"no surface was found through the places of {', '.join(without)}")
    said = [*found.comments[1:], MADE_UP]
    return lines + [f"{comment[0].upper()}{comment[1:]}." for comment in said]


def _exported_parts(run: RunDirectory, model: BodyModel, rejected: bool) -> list[int]:
    """Numbers of the parts that are exported."""
    placed = model.part_link != UNUSED
    accepted = placed & model.accepted_by_part
    if is_off(model):
        raise ValueError(
            f"{run.path} has no body model, because representation.body_model is off; learn it "
            "again in a run where it is auto"
        )
    if not model.used.any() or not placed.any():
        raise ValueError(
            f"{run.path} has no body model to export ({headline(model)}); babble longer, and learn "
            "again"
        )
    if not accepted.any() and not rejected:
        raise ValueError(
            f"{run.path} has a body model that was not accepted ({headline(model)}); babble "
            "longer, or give --rejected to export it all the same"
        )
    return np.flatnonzero(placed if rejected else accepted).tolist()


def _links_of(model: BodyModel, parts: Sequence[int]) -> np.ndarray:
    """`(P,)` links of the parts that are exported; the others have none."""
    links = np.full(len(model.part_link), UNUSED)
    links[parts] = model.part_link[parts]
    return links


def _unit(
    model: BodyModel,
    names: Sequence[str],
    known: Known,
    *,
    depth: float = 0.0,
    touches: tuple[np.ndarray, np.ndarray] | None = None,
) -> Unit:
    """The unit that a known length gives; `depth` and `touches` are as in `unit_from_receptors`."""
    if known.length is not None and known.distance is not None:
        raise ValueError("--length and --distance are both given; one known length is enough")
    if known.length is not None:
        return unit_from_joints(model, *known.length)
    if known.distance is not None:
        return unit_from_receptors(model, names, *known.distance, depth=depth, touches=touches)
    if known.depth is not None:
        raise ValueError(
            f"--depth is {known.depth:g} m, but no length of the body is known in metres; give "
            "--length or --distance as well"
        )
    return Unit()


def _told(known: Known) -> list[str]:
    found = ["it is the mirror image of what was found" if known.mirror else _MAY_BE_MIRRORED]
    if known.depth is None:
        return [*found, "surfaces are where the centres of touchers pass: their depth is not known"]
    side = "under" if known.depth >= 0 else "outside"
    return [*found, f"centres of touchers pass {abs(known.depth):g} m {side} the surfaces"]


def _moved_by(share: float) -> list[str]:
    """What it cost to make joints pure, as a share of the extent of the skin."""
    if share < _UNSEEN:
        return []
    return [
        f"joints purely turn or slide here; this moves places by {100 * share:.2g} % of the extent "
        "of the skin (root mean square)"
    ]


_MAY_BE_MIRRORED = "all of it may be the mirror image of the body, which feels the same"


def _surfaces(found: Exported) -> dict[str, "trimesh.Trimesh"]:
    """Meshes by the name of their link, in its frame; without parts that have none."""
    meshes = {}
    for part in found.parts:
        mesh = found.surface(part)
        if mesh is not None:
            meshes[f"part_{part}"] = mesh
    if found.surface_depth < 0:  # outside, a ball of that radius touches
        for toucher, shape in enumerate(found.model.toucher_shape):
            meshes[f"toucher_{toucher}"] = toucher_surface(shape, -found.surface_depth)
    return meshes


def _write_meshes(
    stem: Path, surfaces: Mapping[str, "trimesh.Trimesh"]
) -> dict[str, tuple[str, np.ndarray]]:
    """Writes meshes in all formats; returns the file and the middle of each."""
    found = {}
    for name, mesh in surfaces.items():
        for kind in MESHES:
            with written_whole(Path(f"{stem}_{name}.{kind}")) as aside:
                mesh.export(aside, file_type=kind)
        found[name] = f"{stem.name}_{name}.{MESHES[0]}", np.asarray(mesh.vertices).mean(axis=0)
    return found


def _write_tables(stem: Path, found: Exported) -> list[str]:
    limits = joint_limits(found.model, found.slides, found.experience)
    joints, receptors = Path(f"{stem}_joints.csv"), Path(f"{stem}_receptors.csv")
    write_csv(joints, JOINT_COLUMNS, joint_rows(found.model, found.slides, limits))
    rows = receptor_rows(found.model, found.receptor_names, found.parts, found.surface_depth)
    write_csv(receptors, RECEPTOR_COLUMNS, rows)
    return [f"joints: {joints}", f"receptors: {receptors}"]


def _write_experiment(
    run: RunDirectory,
    stem: Path,
    found: Exported,
    surfaces: Mapping[str, "trimesh.Trimesh"],
    files: Sequence[Path],
) -> list[str]:
    """Writes an experiment with the robot, if enough is known about it.

    That is metres, the depth of touchers, and closed surfaces.
    """
    if not (found.unit.known and found.depth is not None):
        return []
    worn = [f"part_{part}" for part in found.parts]
    for name in worn:
        if name not in surfaces or not surfaces[name].is_watertight:
            return [f"no experiment is written: the surface of {name} is not closed"]
    file = next(file.name for file in files if file.with_suffix("") == stem)
    touchers = [f"toucher_{number}" for number in range(len(found.model.toucher_link))]
    # Not the stem alone: the user may have an experiment of that name.
    directives, experiment = (Path(f"{stem}_experiment{end}") for end in (".dmd.yaml", ".yaml"))
    felt = stored_sensations(run, load_representation(run))
    skins = {}
    for part, name in zip(found.parts, worn, strict=True):
        rows, touches = found.touches(part)
        receptors = found.receptors(part)
        mesh, extents = f"{stem.name}_{name}.{MESHES[0]}", np.ptp(surfaces[name].vertices, axis=0)
        thickness = fitting_thickness(stem.parent / mesh, extents)
        if np.isnan(thickness):
            return [f"no experiment is written: no skin fits under the surface of {name}"]
        skins[name] = Worn(
            mesh=mesh,
            extents=extents,
            thickness=thickness,
            receptors=receptors[np.isfinite(receptors).all(axis=1)],
            reach=field_reach(receptors, touches, felt[rows]),
        )
    text = experiment_text(
        directives.name,
        f"{stem.name}_receptors.csv",
        skins,
        dict.fromkeys(touchers, toucher_radius(found.depth)),
    )
    write_text_whole(directives, directives_text(stem.name, file))
    write_text_whole(experiment, text)
    return [f"experiment: {experiment}"]
