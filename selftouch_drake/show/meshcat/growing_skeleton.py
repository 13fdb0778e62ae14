"""The skeleton that an agent knows so far, in Meshcat: pale ones show how unsure it is."""

from dataclasses import replace

import numpy as np
from matplotlib.colors import to_rgb
from pydrake.geometry import Meshcat
from pydrake.perception import BaseField, Fields, PointCloud

from selftouch_drake.agent.body_model.model import UNUSED, BodyModel
from selftouch_drake.agent.body_model.twists import transformed
from selftouch_drake.evaluation.body_model import Similarity
from selftouch_drake.experience.store import Contacts
from selftouch_drake.robot import World
from selftouch_drake.show.skeleton import Skeleton, found_skeleton
from selftouch_drake.show.style import BLUE, ORANGE, PALE, RECOVERED
from selftouch_drake.systems.skin_drawing import linear_light, rgba

# Touches by which a skeleton is laid on its robot, and skeletons that show how unsure it is.
_LAID_BY, _UNSURE = 300, 12
# Length of a bar along an axis, and width of the points of receptors, as shares of the size.
_AXIS, _POINT = 0.2, 0.03
# A receptor is as pale as can be where its standard error is this share of the skin's radius.
_PALE_FROM = 0.1


def onto_home(
    model: BodyModel, world: World, home: np.ndarray, q: np.ndarray, target: np.ndarray
) -> Similarity | None:
    """The similarity that lays a model on its robot, accepted or not, by where touches truly were.

    Args:
        model: what was found.
        world: with the robot.
        home: `(J,)` the posture in which both are drawn.
        q: `(n, J)` touches.
        target: `(n,)` target sensation of each.

    Returns:
        From the frame of the model's base to the world; None if the model places too few touches.
    """
    some = np.linspace(0, len(q) - 1, min(len(q), _LAID_BY)).astype(int)
    q, target = q[some], target[some]
    link = model.part_link[model.kernel_part[target]]
    if not len(model.toucher_link) or (link == UNUSED).any():
        return None
    contacts = Contacts.of_rows(world.probe.touches(q), np.arange(len(q)))
    touching = np.diff(contacts.offsets) > 0
    first = contacts.offsets[:-1][touching]
    imagined = transformed(model.link_poses(home[None])[0][link], model.place(q, target))[touching]
    X_WL = world.robot.skin_positions(home[None])[0]
    true = transformed(X_WL[contacts.skin[first]], contacts.p_LC[first].astype(float))
    known = np.isfinite(imagined).all(axis=1)
    return Similarity.fitted(imagined[known], true[known]) if known.sum() > 3 else None


def unsure_models(model: BodyModel, number: int) -> list[BodyModel]:
    """Models drawn from the standard errors of one; the same each time."""
    mean = np.concatenate([model.twists.ravel(), model.toucher_place.ravel()])
    values, vectors = np.linalg.eigh(np.nan_to_num(model.covariance))
    root = vectors * np.sqrt(np.maximum(values, 0))
    drawn = mean + np.random.default_rng(0).standard_normal((number, len(mean))) @ root.T
    end = model.twists.size
    return [
        replace(
            model,
            twists=one[:end].reshape(model.twists.shape),
            toucher_place=one[end:].reshape(model.toucher_place.shape),
        )
        for one in drawn
    ]


def draw_growing(
    meshcat: Meshcat, root: str, model: BodyModel, onto: Similarity, home: np.ndarray, size: float
) -> None:
    """Draws a skeleton, its axes, pale ones from its standard errors, and where receptors are.

    Args:
        meshcat: where to draw.
        root: path below which.
        model: what was found.
        onto: from the frame of the model's base to the world.
        home: `(J,)` the posture in which it is drawn.
        size: m, of the robot.
    """
    skeleton = found_skeleton(model, home).moved(onto)
    _draw_lines(meshcat, f"{root}/links", skeleton.bones, BLUE, 4.0)
    _draw_lines(meshcat, f"{root}/axes", _bars(skeleton, _AXIS * size), ORANGE, 4.0)
    unsure = [found_skeleton(one, home).moved(onto) for one in unsure_models(model, _UNSURE)]
    bones = np.concatenate([one.bones for one in unsure])
    bars = np.concatenate([_bars(one, _AXIS * size) for one in unsure])
    _draw_lines(meshcat, f"{root}/unsure_links", bones, BLUE, 1.0, 0.3)
    _draw_lines(meshcat, f"{root}/unsure_axes", bars, ORANGE, 1.0, 0.3)
    found = model.receptors()
    known = np.flatnonzero(np.isfinite(found.place).all(axis=1) & (found.part >= 0))
    known = known[model.part_link[found.part[known]] != UNUSED]
    if not len(known):
        meshcat.Delete(f"{root}/receptors")
        return
    poses = model.link_poses(home[None])[0][model.part_link[found.part[known]]]
    places = onto(transformed(poses, found.place[known]))
    sigma = onto.scale * np.nan_to_num(found.sigma[known], nan=np.inf)
    radius = np.sqrt(places.var(axis=0).sum())
    pale = np.clip(sigma / max(_PALE_FROM * radius, 1e-12), 0, 1)[:, None]
    color = (1 - pale) * np.array(to_rgb(RECOVERED)) + pale * np.array(to_rgb(PALE))
    cloud = PointCloud(len(places), Fields(BaseField.kXYZs | BaseField.kRGBs))
    cloud.mutable_xyzs()[:] = places.T
    cloud.mutable_rgbs()[:] = 255 * linear_light(color).T
    meshcat.SetObject(f"{root}/receptors", cloud, point_size=_POINT * size)


def _bars(skeleton: Skeleton, length: float) -> np.ndarray:
    """`(n, 2, 3)` bars along the axes that are known."""
    known = np.isfinite(skeleton.direction).all(axis=1)
    half = 0.5 * length * skeleton.direction[known]
    return np.stack([skeleton.place[known] - half, skeleton.place[known] + half], axis=1)


def _draw_lines(
    meshcat: Meshcat, path: str, lines: np.ndarray, color: str, width: float, alpha: float = 1.0
) -> None:
    """Draws `(n, 2, 3)` lines."""
    start, end = (np.asfortranarray(lines[:, which].T) for which in (0, 1))
    meshcat.SetLineSegments(path, start, end, width, rgba(color, alpha))
