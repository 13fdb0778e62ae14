"""Whether a robot has the masses that a simulation of its motion needs."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RevoluteJoint

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot.kinematics import joint_tree

# rad or m; at the default position, axes of massless links may coincide by chance.
_ASIDE = 0.37
# The least share of a joint's own inertia that must be left when all others move freely.
_SINGULAR = 1e-12


def require_masses(plant: MultibodyPlant) -> None:
    """Refuses a joint that moves no mass, as MuJoCo does; the plant is finalized.

    Raises:
        ExperimentError: there is one; the text names the joint and the links that it moves.
    """
    context = plant.CreateDefaultContext()
    q = plant.GetPositions(context) + _ASIDE
    plant.SetPositions(
        context, np.clip(q, plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits())
    )
    inertia = plant.CalcMassMatrix(context)
    for number in reversed(range(len(inertia))):
        own = inertia[number, number]
        left = own
        if number + 1 < len(inertia) and own > 0:
            coupling, rest = inertia[number, number + 1 :], inertia[number + 1 :, number + 1 :]
            left = own - coupling @ np.linalg.solve(rest, coupling)
        if left <= _SINGULAR * max(own, 1e-12):
            _refuse(plant, number)


def _refuse(plant: MultibodyPlant, number: int) -> None:
    each = joint_tree(plant)[number]
    is_turning = isinstance(each.joint, RevoluteJoint)
    names = [plant.get_body(BodyIndex(body)).name() for body in sorted(each.moved)]
    raise ExperimentError(
        f"joint {each.joint.name()!r} {'turns' if is_turning else 'slides'} {' and '.join(names)} "
        f"without mass{' or inertia' if is_turning else ''}, which no simulation can move; give "
        "the link an <inertial> in its model, or leave the joint out of robot.joints"
    )
