"""The same body model in another unit, or as its mirror image: touch cannot tell these apart."""

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from selftouch_drake.agent.body_model.chain import adjoint
from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.body_model.support import SHAPE_BASIS


def similar_model(model: BodyModel, *, metres: float = 1.0, mirrored: bool = False) -> BodyModel:
    """A model with all lengths multiplied, and mirrored in the plane x = 0 if asked.

    Readings of joints, numbers of sensations and the judgement stay as they are.
    """
    flip = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0])
    motion = np.eye(4)
    motion[:3, :3] = metres * flip
    of_twist, num_joints = adjoint(motion, np.eye(6)).T, len(model.twists)
    blocks = [of_twist] * num_joints + [motion[:3, :3]] * len(model.toucher_place)
    # A standard error has no sign: a mirror in a plane of coordinates leaves it as it is.
    sigma_unit = np.repeat([1.0, metres], 3)
    shape_sign = np.einsum("nij,nij->n", flip @ SHAPE_BASIS @ flip, SHAPE_BASIS) / np.einsum(
        "nij,nij->n", SHAPE_BASIS, SHAPE_BASIS
    )
    return replace(
        model,
        twists=adjoint(motion, model.twists),
        twist_sigma=model.twist_sigma * sigma_unit,
        covariance=_carried(model.covariance, block_diag(*blocks)),
        toucher_place=metres * model.toucher_place @ flip,
        toucher_shape=metres * model.toucher_shape * shape_sign,
        kernel_place=metres * model.kernel_place @ flip,
        kernel_normal=model.kernel_normal @ flip,
        receptor_place=metres * model.receptor_place @ flip,
        receptor_normal=model.receptor_normal @ flip,
        receptor_sigma=metres * model.receptor_sigma,
    )


def _carried(covariance: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """The covariance of what `slope` makes of values; NaN where it depends on an unknown one."""
    unknown = np.isnan(np.diag(covariance))
    found = slope @ np.where(np.isnan(covariance), 0.0, covariance) @ slope.T
    lost = (slope != 0) @ unknown
    found[lost], found[:, lost] = np.nan, np.nan
    return found
