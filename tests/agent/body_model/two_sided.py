"""A small body with two arms whose touches both skins feel: it costs nothing.

Its trunk is a shell; each arm has three joints and a patch of skin. Where an arm's patch passes
through the shell, both feel a contact of the diameter 1.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from selftouch_drake.agent.body_model.both_sides.recordings import Layout, Recording

RIGHT, LEFT = [0, 1, 2], [3, 4, 5]
LAYOUT = Layout(
    limbs={"right": RIGHT, "left": LEFT},
    holder={"trunk": "", "right_skin": "right", "left_skin": "left", "right_tip": "right"},
    mirrored=(("right", "left"),),
)
_RADII, _SHELL = np.array([2.2, 1.6, 3.2]), 0.05
_MIRROR = np.array([-1.0, 1.0, 1.0])
_RIGHT_AXES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.3]])
_RIGHT_CENTRES = np.array([[2.6, 0.0, 1.5], [2.8, 0.2, 1.5], [2.8, 1.8, 1.4]])


def axes() -> np.ndarray:
    """`(6, 3)` unit axes of both arms, at 0; a mirror image turns the other way round."""
    right = _RIGHT_AXES / np.linalg.norm(_RIGHT_AXES, axis=1, keepdims=True)
    return np.concatenate([right, -right * _MIRROR])


def centres() -> np.ndarray:
    return np.concatenate([_RIGHT_CENTRES, _RIGHT_CENTRES * _MIRROR])


def trunk_places() -> np.ndarray:
    """`(n, 3)` receptors spread evenly over the shell."""
    number = 400
    at = np.arange(number) + 0.5
    polar, around = np.arccos(1 - 2 * at / number), np.pi * (1 + 5**0.5) * at
    ring = np.sin(polar)
    return _RADII * np.column_stack([ring * np.cos(around), ring * np.sin(around), np.cos(polar)])


def arm_places() -> np.ndarray:
    """`(m, 3)` receptors of the right arm's patch, at 0."""
    u, v = (own.ravel() for own in np.meshgrid(np.linspace(-1, 1, 7), np.linspace(-0.8, 0.8, 6)))
    return np.column_stack([2.8 + 0.9 * np.sin(u), 3.4 + v, 0.8 + 0.9 * np.cos(u)])


def carried(q: np.ndarray, point: np.ndarray, joints: list[int]) -> np.ndarray:
    """`(t, 3)` points of an arm, carried by its joints."""
    for joint in reversed(joints):
        turn = Rotation.from_rotvec(q[:, joint, None] * axes()[joint]).as_matrix()
        centre = centres()[joint]
        point = np.einsum("nij,nj->ni", turn, point - centre) + centre
    return point


def recordings(touches: int = 300, seed: int = 0) -> list[Recording]:
    """The right skin on the trunk, the left skin on the trunk, and the right tip on the trunk."""
    random = np.random.default_rng(seed)
    right, tip = arm_places(), arm_places().mean(axis=0, keepdims=True)
    return [
        _on_trunk("right_skin", right, RIGHT, touches, random),
        _on_trunk("left_skin", right * _MIRROR, LEFT, touches, random),
        _on_trunk("right_tip", tip, RIGHT, touches, random),
    ]


def _on_trunk(
    end: str, own: np.ndarray, joints: list[int], touches: int, random: np.random.Generator
) -> Recording:
    q = random.uniform(-1.6, 1.6, size=(40 * touches, 6))
    touching = own[random.integers(len(own), size=len(q))]
    there = carried(q, touching, joints)
    near = np.abs(np.linalg.norm(there / _RADII, axis=1) - 1) < _SHELL
    kept = np.flatnonzero(near)[:touches]
    return Recording(
        name=f"{end}_on_trunk", above=end, below="trunk", q=q[kept],
        felt_above=_felt(own, touching[kept]) if len(own) > 1 else None,
        felt_below=_felt(trunk_places(), there[kept]),
    )  # fmt: skip


def _felt(receptors: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """`(t, n)` receptors within a contact, and always the nearest one."""
    apart = np.linalg.norm(receptors - contact[:, None], axis=2)
    felt = apart < 0.5
    felt[np.arange(len(contact)), apart.argmin(axis=1)] = True
    return felt
