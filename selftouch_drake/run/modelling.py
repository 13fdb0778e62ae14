"""The body model of a run: what it is found from, and what is said about it."""

import time
from collections.abc import Callable

import numpy as np
from threadpoolctl import threadpool_limits

from selftouch_drake.agent.body_model.model import BodyModel, rejected
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.run.artifacts import save_body_model, stored_sensations
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.worlds import make_world
from selftouch_drake.threads import mapped


def find_model(
    run: RunDirectory,
    representation: QuotientRepresentation,
    *,
    progress: Callable[[float, str], None],
) -> BodyModel:
    """Asks whether the joints turn or slide something rigid, and keeps the answer in the run.

    The representation is only read. The fit takes all cores of this machine.
    """
    num_rows, num_joints = representation.kernel_q.shape
    names = joint_names(run, num_joints)
    if run.experiment.representation.body_model == "off":
        model = rejected(
            "off",
            joint_names=names,
            kernel_part=representation.part,
            num_rows=num_rows,
            num_receptors=representation.target_sensations.shape[1],
            seed=run.experiment.seed,
        )
        save_body_model(run, model)
        return model
    # Most commands need no fit.
    from selftouch_drake.agent.body_model.find import find_body_model

    began = time.perf_counter()
    progress(0.0, "body model")
    # Sums in another order, by another number of threads, would give other bytes.
    with threadpool_limits(limits=1, user_api="blas"):
        model = find_body_model(
            representation.kernel_q.astype(float),
            stored_sensations(run, representation),
            kernel_of_rows(representation),
            representation.part,
            joint_names=names,
            double=pressing_two(representation),
            seed=run.experiment.seed,
            progress=progress,
            each=mapped,
        )
    save_body_model(run, model)
    run.add_metrics(
        {
            "body_model_accepted": float(np.mean(model.accepted_by_part)),
            "body_model_wall_s": time.perf_counter() - began,
        }
    )
    return model


def kernel_of_rows(representation: QuotientRepresentation) -> np.ndarray:
    """`(R,)` the target sensation of each stored motor configuration."""
    sizes = np.diff(representation.kernel_offsets)
    return np.repeat(np.arange(representation.num_targets), sizes)


def pressing_two(representation: QuotientRepresentation) -> np.ndarray:
    """`(R,)` bool, touches of two parts at once, each of which has a row."""
    _, number, count = np.unique(representation.kernel_row, return_inverse=True, return_counts=True)
    return count[number] > 1


def joint_names(run: RunDirectory, num_joints: int) -> list[str]:
    """Names of the joints of a run; numbers if nobody knows them.

    Older runs have no names: they are looked up in a robot of Drake's.
    """
    names = run.joint_names()
    if names is None and run.experiment.has_truth:
        try:
            names = make_world(run).robot.joint_names
        except (ValueError, OSError):  # its models are elsewhere, and learning needs none
            names = None
    if names is None or len(names) != num_joints:
        names = [f"joint_{number}" for number in range(num_joints)]
    return names
