"""Skins touched by points, without a world: experience of the agent, and true places of touch.

Motor configurations are the point in space and two joints without effect.
"""

import numpy as np


def fibonacci(num_points: int) -> np.ndarray:
    i = np.arange(num_points) + 0.5
    z = 1 - 2 * i / num_points
    turn = i * np.pi * (1 + np.sqrt(5))
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


def on_sphere(rng: np.random.Generator, num_points: int) -> np.ndarray:
    points = rng.normal(size=(num_points, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def on_cap(rng: np.random.Generator, num_points: int) -> np.ndarray:
    """A bowl, a third of a sphere: a patch with one rim."""
    points = on_sphere(rng, 8 * num_points)
    return points[points[:, 2] > 0.35][:num_points]


def on_tube(rng: np.random.Generator, num_points: int) -> np.ndarray:
    """A tube open at both ends, as wide as it is long."""
    turn, z = rng.uniform(-np.pi, np.pi, num_points), rng.uniform(-1.0, 1.0, num_points)
    return np.stack([np.cos(turn), np.sin(turn), z], axis=1)


def on_ring(rng: np.random.Generator, num_points: int) -> np.ndarray:
    """A line: a circle in a tilted plane."""
    turn = rng.uniform(-np.pi, np.pi, num_points)
    return np.stack([np.cos(turn), 0.8 * np.sin(turn), 0.6 * np.sin(turn)], axis=1)


def on_square(rng: np.random.Generator, num_points: int) -> np.ndarray:
    """A flat patch, tilted in space."""
    x, y = rng.uniform(-1.2, 1.2, (2, num_points))
    return np.stack([x, 0.8 * y, 0.6 * y], axis=1)


SHAPES = {
    "sphere": on_sphere,
    "cap": on_cap,
    "tube": on_tube,
    "ring": on_ring,
    "square": on_square,
}


def receptors(shape: str, num: int) -> np.ndarray:
    """Receptors spread evenly over the shape, by farthest points."""
    points = SHAPES[shape](np.random.default_rng(1), 40 * num)
    picked = [0]
    distance = np.linalg.norm(points - points[0], axis=1)
    while len(picked) < num:
        picked.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[picked[-1]], axis=1))
    return points[picked]


def readings(points: np.ndarray, sensors: np.ndarray, width: float) -> np.ndarray:
    """Readings of receptors whose fields fall linearly to 0 at `width`."""
    apart = np.linalg.norm(points[:, None] - sensors, axis=2)
    return np.clip(1.0 - apart / width, 0.0, None)


def touch(shapes, num_rows, *, num_receptors=60, double=0.0, hand=None, width=0.75, seed=0):
    """Touches of several skins, 6 apart along the first joint.

    Args:
        shapes: one of `SHAPES` for each skin.
        num_rows: touches, spread evenly over the skins.
        num_receptors: of each skin.
        double: share of the touches in which a second hand, with three more joints, touches too.
        hand: shape of the skin that the hand wears, if any; any place of it may touch. Its
            receptors come last, and three more joints say where it is pressed.
        width: of the receptive fields.
        seed: of all randomness.

    Returns:
        `(n, J)` q, `(n, S)` sensation, `(n,)` the skin and `(n, 3)` the place touched on it.
    """
    rng = np.random.default_rng(seed)

    def one():
        skin = rng.integers(len(shapes), size=num_rows)
        place = np.empty((num_rows, 3))
        for number, shape in enumerate(shapes):
            here = skin == number
            place[here] = SHAPES[shape](rng, here.sum())
        felt = np.concatenate(
            [
                readings(place, receptors(shape, num_receptors), width) * (skin == n)[:, None]
                for n, shape in enumerate(shapes)
            ],
            axis=1,
        )
        at = place + 6.0 * skin[:, None] * np.array([1.0, 0.0, 0.0])
        return skin, place, felt * rng.uniform(0.2, 1.0, (num_rows, 1)), at

    skin, place, sensation, at = one()
    q = [at, rng.uniform(-0.3, 0.3, (num_rows, 2))]
    if double:
        _, _, more, elsewhere = one()
        both = rng.random(num_rows) < double
        sensation = sensation + more * both[:, None]
        # A hand that does not touch may be anywhere.
        q.append(np.where(both[:, None], elsewhere, rng.uniform(-2.0, 8.0, (num_rows, 3))))
    if hand:
        pressed = SHAPES[hand](rng, num_rows)
        own = readings(pressed, receptors(hand, num_receptors), width)
        sensation = np.concatenate([sensation, own * sensation.max(axis=1, keepdims=True)], axis=1)
        q.append(pressed)
    kept = sensation.any(axis=1)
    columns = (np.concatenate(q, axis=1).astype(np.float32), sensation.astype(np.float32))
    return (*(c[kept] for c in columns), skin[kept], place[kept])
