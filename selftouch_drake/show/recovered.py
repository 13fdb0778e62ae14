"""The recovered body laid on its skins, to compare them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from selftouch_drake.agent.shape.alignment import align
from selftouch_drake.agent.shape.recovery import RecoveredBody, RecoveredPart
from selftouch_drake.agent.shape.surface import fitted_surface
from selftouch_drake.evaluation.shape import KernelTruth
from selftouch_drake.lazy import trimesh
from selftouch_drake.show.skins import SkinSurface, all_moved, as_one

# Radius of the tube that a line is drawn as, as a share of its extent, and its sides.
_TUBE, _SIDES = 0.008, 8

# From one part to the next where nobody knows how they stand, in largest extents.
_BESIDE = 1.2
# Smallest share of a part's kernels with which a skin belongs to the part.
_LEAST_SHARE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecoveredSkin:
    """A part of the recovered body, laid on its skins.

    Attributes:
        part: its number among the parts.
        skins: numbers of the skins that it is on, the one with the most kernels first.
        places: `(N, 3)` m, its kernels and then the pieces of wide ones, with the skins at home; of
            a line also the corners of the tube that it is drawn as.
        num_kernels: n of them.
        faces: `(F, 3)` indices into `places`, the fitted surface or tube, outward.
        closed: whether the surface has no rim.
        is_line: whether the skin is a line, and not a surface.
    """

    part: int
    skins: tuple[int, ...]
    places: np.ndarray
    num_kernels: int
    faces: np.ndarray
    closed: bool
    is_line: bool = False

    @property
    def positions(self) -> np.ndarray:
        """`(n, 3)` m, the kernels."""
        return self.places[: self.num_kernels]


def skins_of(kernels: np.ndarray, truth: KernelTruth) -> tuple[int, ...]:
    """Numbers of the true skins of some kernels, the most frequent first."""
    counts = np.bincount(truth.skin[kernels])
    order = np.argsort(-counts, kind="stable")
    return tuple(order[counts[order] > _LEAST_SHARE * len(kernels)].tolist())


def laid_on_skins(
    body: RecoveredBody, truth: KernelTruth, skins: Sequence[SkinSurface], home: np.ndarray
) -> tuple[RecoveredSkin, ...]:
    """The parts of a recovered body, each moved, turned, mirrored and scaled onto its skins.

    Only those that a surface or a line goes through. The skins are each in the frame of its link;
    `home` are `(skins, 3, 4)` poses of these links in the posture in which they are drawn.
    """
    parts = []
    at_home = as_one(all_moved(skins, home))
    poses = home[truth.skin]
    true = np.einsum("nij,nj->ni", poses[:, :, :3], truth.positions) + poses[:, :, 3]
    for number, part in enumerate(body.parts):
        places = align(part.positions, true[part.kernels], part.places)
        drawn = _drawn(number, part, places)
        if drawn is not None:
            faces = _outward(drawn.places, drawn.faces, None if drawn.closed else at_home)
            parts.append(replace(drawn, skins=skins_of(part.kernels, truth), faces=faces))
    return tuple(parts)


def laid_out(body: RecoveredBody) -> tuple[RecoveredSkin, ...]:
    """The parts of a recovered body whose truth nobody knows, one beside the other.

    Each has a largest extent of 1, on no skin, in the pose in which the agent laid it out.
    """
    parts: list[RecoveredSkin] = []
    for number, part in enumerate(body.parts):
        if part.space_dimension > 3:
            continue
        places = np.pad(part.places, ((0, 0), (0, 3 - part.places.shape[1])))
        low, high = places.min(axis=0), places.max(axis=0)
        places = (places - (low + high) / 2) / (high - low).max()
        places += [_BESIDE * len(parts), 0.0, 0.0]
        drawn = _drawn(number, part, places)
        if drawn is not None:
            if drawn.closed:
                drawn = replace(drawn, faces=_outward(drawn.places, drawn.faces, None))
            parts.append(drawn)
    return tuple(parts)


def _drawn(number: int, part: RecoveredPart, places: np.ndarray) -> RecoveredSkin | None:
    """A part with its kernels at `(n, 3)` places, on no skin; None if nothing goes through them."""
    if part.topology is None:
        return None
    is_line = part.skin_dimension == 1
    faces = fitted_surface(part.places, part.topology, part.skin_dimension)
    if not len(faces):
        return None
    if is_line:
        places, faces = _tube(places, faces)
    return RecoveredSkin(
        part=number,
        skins=(),
        places=places,
        num_kernels=len(part.kernels),
        faces=faces,
        closed=is_line or bool(part.topology.betti[2]),
        is_line=is_line,
    )


def _tube(places: np.ndarray, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`(N, 3)` places and `(F, 3)` triangles of a thin tube around `(E, 2)` steps between some."""
    start, end = places[steps].swapaxes(0, 1)
    radius = _TUBE * np.ptp(places, axis=0).max()
    tubes = trimesh.util.concatenate(
        [
            trimesh.creation.cylinder(radius, segment=segment, sections=_SIDES)
            for segment in np.stack([start, end], axis=1)
        ]
    )
    assert isinstance(tubes, trimesh.Trimesh)
    return np.concatenate([places, tubes.vertices]), tubes.faces + len(places)


def _outward(places: np.ndarray, faces: np.ndarray, skin: SkinSurface | None) -> np.ndarray:
    """Faces turned outward: of a closed surface all at once, else each as the skin is nearby."""
    a, b, c = places[faces].transpose(1, 0, 2)
    if skin is None:
        mirrored = np.einsum("fi,fi->", np.cross(a, b), c) < 0
        return faces[:, ::-1] if mirrored else faces
    mesh = trimesh.Trimesh(skin.vertices, skin.faces, process=False)
    _, nearest = mesh.kdtree.query(places[faces].mean(axis=1))
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), mesh.vertex_normals[nearest]) < 0
    return np.where(inward[:, None], faces[:, ::-1], faces)
