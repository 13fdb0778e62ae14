"""Evenly sampled bodies of known shape, and geodesic distances along them."""

import numpy as np
from scipy.spatial.distance import pdist, squareform


def sphere(num_points: int, radius: float = 1.0) -> np.ndarray:
    """A Fibonacci sphere."""
    i = np.arange(num_points) + 0.5
    z = 1 - 2 * i / num_points
    turn = i * np.pi * (1 + np.sqrt(5))
    flat = np.sqrt(1 - z**2)
    return radius * np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


def torus(num_points: int, ring: float = 0.22, tube: float = 0.09) -> np.ndarray:
    """Farthest points of random points on a torus."""
    rng = np.random.default_rng(0)
    u, v = rng.uniform(0, 2 * np.pi, (2, 40 * num_points))
    keep = rng.uniform(0, ring + tube, len(u)) < ring + tube * np.cos(v)
    u, v = u[keep], v[keep]
    flat = ring + tube * np.cos(v)
    points = np.stack([flat * np.cos(u), flat * np.sin(u), tube * np.sin(v)], axis=1)
    return farthest(points, num_points)


def cube(num_points: int, side: float = 0.44) -> np.ndarray:
    """Farthest points of random points on a cube."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (40 * num_points, 3))
    axis = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), axis] = rng.choice([-1, 1], len(points))
    return farthest(points * side / 2, num_points)


def patch(num_side: int) -> np.ndarray:
    """A bent square, with a rim and no holes."""
    x, y = np.meshgrid(*2 * [np.linspace(-1, 1, num_side)])
    return np.stack([x.ravel(), y.ravel(), 0.4 * x.ravel() ** 2], axis=1)


def ring(num_points: int) -> np.ndarray:
    """A circle in a tilted plane of space."""
    turn = 2 * np.pi * np.arange(num_points) / num_points
    x, y = np.cos(turn), np.sin(turn)
    return np.stack([x, 0.8 * y, 0.6 * y], axis=1)


def trefoil(num_points: int) -> np.ndarray:
    """A knotted ring."""
    t = 2 * np.pi * np.arange(4000) / 4000
    points = [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)]
    return farthest(np.stack(points, axis=1), num_points)


def square(num_points: int) -> np.ndarray:
    """A flat patch, tilted in space."""
    x, y = np.random.default_rng(0).uniform(-1, 1, (2, 40 * num_points))
    return farthest(np.stack([x, 0.8 * y, 0.6 * y], axis=1), num_points)


def bowl(num_points: int) -> np.ndarray:
    """A third of a sphere."""
    points = np.random.default_rng(0).normal(size=(200 * num_points, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return farthest(points[points[:, 2] > 0.35][: 40 * num_points], num_points)


def flat_torus(num_points: int) -> np.ndarray:
    """A torus in four dimensions, flat everywhere: it has no place in three."""
    u, v = np.random.default_rng(0).uniform(0, 2 * np.pi, (2, 40 * num_points))
    return farthest(np.stack([np.cos(u), np.sin(u), np.cos(v), np.sin(v)], axis=1), num_points)


def farthest(points: np.ndarray, num_points: int) -> np.ndarray:
    picked = [0]
    distance = np.linalg.norm(points - points[0], axis=1)
    while len(picked) < num_points:
        picked.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[picked[-1]], axis=1))
    return points[picked]


def along_sphere(points: np.ndarray) -> np.ndarray:
    """Great-circle distances."""
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    angle = np.arccos(np.clip(unit @ unit.T, -1, 1))
    np.fill_diagonal(angle, 0)
    return np.linalg.norm(points[0]) * angle


def shape_error(found: np.ndarray, true: np.ndarray) -> float:
    """RMS error after the best similarity transform, as a share of the largest distance."""
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, s, vt = np.linalg.svd(a.T @ b)
    misfit = s.sum() / np.sum(a**2) * a @ (u @ vt) - b
    return float(np.sqrt(np.sum(misfit**2) / len(b)) / pdist(true).max())


def neighbours(points: np.ndarray, num_neighbours: int) -> tuple[np.ndarray, np.ndarray]:
    """Edges between nearest neighbours, and their lengths."""
    distance = squareform(pdist(points))
    nearest = np.argsort(distance, axis=1)[:, 1 : num_neighbours + 1]
    pairs = np.stack([np.repeat(np.arange(len(points)), num_neighbours), nearest.ravel()], axis=1)
    edges = np.unique(np.sort(pairs, axis=1), axis=0)
    return edges, distance[edges[:, 0], edges[:, 1]]
