"""The body model of a run: what it is found from, and what is said about it."""

import time
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial

import numpy as np

from selftouch_drake.agent.body_model.asking import ask_for_model
from selftouch_drake.agent.body_model.model import BodyModel, rejected
from selftouch_drake.agent.representation.quotient import QuotientRepresentation
from selftouch_drake.quotient.threads import mapped
from selftouch_drake.run.artifacts import save_body_model, stored_sensations
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import SHARDS_AHEAD, map_ahead
from selftouch_drake.run.worlds import make_world


def find_model(
    run: RunDirectory,
    representation: QuotientRepresentation,
    *,
    progress: Callable[[float, str], None],
    executor: Executor | None = None,
) -> BodyModel:
    """Asks whether the joints turn or slide something rigid, and keeps the answer in the run.

    The representation is only read. The starts of the fit go to the executor, and to all
    cores of this machine if there is none: the bytes are the same.
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
    began = time.perf_counter()
    progress(0.0, "body model")
    model = ask_for_model(
        representation,
        stored_sensations(run, representation),
        joint_names=names,
        seed=run.experiment.seed,
        progress=progress,
        each=partial(map_ahead, executor, SHARDS_AHEAD) if executor else mapped,
    )
    save_body_model(run, model)
    run.add_metrics(
        {
            "body_model_accepted": float(np.mean(model.accepted_by_part)),
            "body_model_wall_s": time.perf_counter() - began,
        }
    )
    return model


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
