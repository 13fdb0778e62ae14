"""Bodies by hand: chains whose touches on a surface are found by trying configurations."""

import numpy as np
from scipy.sparse import csr_array

from selftouch_drake.agent.body_model.chain import places, turns
from selftouch_drake.agent.body_model.fit import random_twists
from selftouch_drake.agent.body_model.support import bulge


def an_arm(seed=1, joints=4, slides=()):
    """Twists and point of a chain that reaches about 2 units."""
    random = np.random.default_rng(seed)
    twists = random_twists(random, joints)
    for joint in slides:
        twists[joint, :3] = 0
    return twists, random.standard_normal(3)


def a_ball(random, twists, point):
    """Centre and radius of a ball in the middle of where the point comes."""
    cloud = places(random.uniform(-1.5, 1.5, (2000, len(twists))), twists, point)
    center = np.median(cloud, axis=0)
    return center, np.median(np.linalg.norm(cloud - center, axis=1))


def touches(twists, point, *, number=4000, kernels=150, seed=0, noise=0.0):
    """`(n, J)` configurations that touch a sphere, `(n,)` the nearest of K places on it."""
    random = np.random.default_rng(seed)
    center, radius = a_ball(random, twists, point)
    q, y = [], []
    while sum(map(len, q)) < number:
        tried = random.uniform(-1.5, 1.5, (200_000, len(twists)))
        there = places(tried, twists, point)
        on = np.abs(np.linalg.norm(there - center, axis=1) / radius - 1) < 0.01
        q.append(tried[on])
        y.append(there[on])
    q, y = np.concatenate(q)[:number], np.concatenate(y)[:number]
    target = nearest_of(y, kernels)
    return q + noise * random.standard_normal(q.shape), target, y


def nearest_of(y, kernels):
    """`(n,)` the nearest of so many evenly spaced places."""
    # As target sensations are: each is the farthest from those before.
    anchors, apart = [], np.full(len(y), np.inf)
    for _ in range(kernels):
        anchors.append(y[apart.argmax()])
        apart = np.minimum(apart, np.linalg.norm(y - anchors[-1], axis=1))
    anchors = np.array(anchors)
    return ((y[:, None] - anchors[None]) ** 2).sum(axis=2).argmin(axis=1)


def misfit(found, true):
    """Root mean square distance in % of the extent, after one similarity."""
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    U, s, V = np.linalg.svd(a.T @ b)
    apart = (s.sum() / (a**2).sum()) * a @ (U @ V) - b
    return 100 * np.sqrt((apart**2).sum(axis=1).mean()) / np.linalg.norm(np.ptp(true, axis=0))


def rolling(twists, point, shape, *, number=3000, kernels=150, seed=0):
    """As `touches`, of a toucher with a shape; places are those of a ball that touches there."""
    random = np.random.default_rng(seed)
    center, radius = a_ball(random, twists, point)
    q, y = [], []
    while sum(map(len, q)) < number:
        tried = random.uniform(-1.5, 1.5, (200_000, len(twists)))
        there = places(tried, twists, point)
        tried = tried[np.abs(np.linalg.norm(there - center, axis=1) / radius - 1) < 0.3]
        at = there = places(tried, twists, point)
        turn = turns(tried, twists)
        for _ in range(8):
            normal = at - center
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            in_hand = bulge(shape, -np.einsum("nba,nb->na", turn, normal))
            at = there + np.einsum("nab,nb->na", turn, in_hand)
        on = np.abs(np.linalg.norm(at - center, axis=1) / radius - 1) < 0.01
        q.append(tried[on])
        y.append(at[on])
    q, y = np.concatenate(q)[:number], np.concatenate(y)[:number]
    return q, nearest_of(y, kernels), y


def felt(y, *, receptors=60, seed=3):
    """`(n, S)` readings of receptors among the places, each of which a touch beside it presses."""
    random = np.random.default_rng(seed)
    at = y[random.permutation(len(y))[:receptors]]
    square = ((y[:, None] - at[None]) ** 2).sum(axis=2)
    width = np.median(np.sort(square, axis=1)[:, 3])
    readings = np.exp(-square / (2 * width))
    return csr_array(np.where(readings > 0.05, readings, 0) * random.uniform(0.5, 2, (len(y), 1)))


def sample(number, *, seed=0, **more):
    """Readings, sensations and places of as many touches of an arm, and all of its touches."""
    twists, point = an_arm(**more)
    q, _, y = touches(twists, point, number=4000, seed=seed)
    return q[:number], felt(y)[:number], y[:number], (q, y)


class ArmOnBall:
    """An arm that touches a ball with a skin; what is felt depends on the place alone."""

    def __init__(self, seed=1, receptors=60):
        self.twists, self.point = an_arm(seed)
        self.center, self.radius = a_ball(np.random.default_rng(0), self.twists, self.point)
        at = np.random.default_rng(2).standard_normal((4000, 3))
        at /= np.linalg.norm(at, axis=1, keepdims=True)
        kept = [0]
        for _ in range(receptors - 1):
            far = np.linalg.norm(at[:, None] - at[kept], axis=2).min(axis=1)
            kept.append(int(far.argmax()))
        self.receptors = at[kept]

    def places(self, q):
        """`(n, 3)` the toucher, as seen from the ball's middle, in its radii."""
        return (places(q, self.twists, self.point) - self.center) / self.radius

    def feel(self, q):
        """`(n, S)` readings: null farther than a twentieth of the radius from the skin."""
        at = self.places(q)
        height = np.linalg.norm(at, axis=1)
        beside = np.linalg.norm(at[:, None] / height[:, None, None] - self.receptors, axis=2)
        depth = np.clip(1 - np.abs(height - 1) / 0.05, 0, None)
        return depth[:, None] * np.clip(1 - beside / 0.7, 0, None)

    def touches(self, number, seed=0):
        """`(number, 4)` configurations that touch, and what is felt."""
        random, q = np.random.default_rng(seed), []
        while sum(map(len, q)) < number:
            tried = random.uniform(-1.5, 1.5, (20_000, len(self.twists)))
            near = np.abs(np.linalg.norm(self.places(tried), axis=1) - 1) < 0.05
            q.append(tried[near])
        found = np.concatenate(q)[:number]
        return found, self.feel(found)
