"""A small run, laid out by hand on a ball: no babbling, no learning."""

import dataclasses
import socket

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from pydrake.geometry import Meshcat

from selftouch_drake.agent.representation import QuotientRepresentation
from selftouch_drake.agent.shape import topology
from selftouch_drake.experience import Shard, write_shard
from selftouch_drake.experiment import Babbling, Body, Experiment, Representation, Skin
from selftouch_drake.files import save_arrays
from selftouch_drake.geometry import build_body
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.show import write_report

NUM_KERNELS, PER_KERNEL, RADIUS = 60, 5, 0.25
MALICIOUS = '<script>alert("&")</script>'


def spread(count: int) -> np.ndarray:
    """Evenly spread directions (Fibonacci)."""
    i = np.arange(count) + 0.5
    z, angle = 1 - 2 * i / count, np.pi * (1 + np.sqrt(5)) * i
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def _make_run(path, *, stage: str, name: str = "ball") -> RunDirectory:
    """A run that has come as far as `stage`."""
    experiment = Experiment(
        name=name,
        body=Body(shape="sphere", radius=RADIUS, resolution=0.06),
        skin=Skin(num_receptors=20),
        babbling=Babbling(num_samples=NUM_KERNELS * PER_KERNEL),
        representation=Representation(num_targets=NUM_KERNELS),
    )
    run = RunDirectory.create(path, experiment)
    stages = ("nothing", "babbled", "learned", "planned", "executed")
    reached = stages.index(stage)
    random = np.random.default_rng(0)
    kernels = spread(NUM_KERNELS)
    _, fields = build_body(experiment)
    felt = np.exp(10 * (kernels @ fields.p_BS.T / RADIUS - 1))
    targets = felt / np.linalg.norm(felt, axis=1, keepdims=True)
    q = random.uniform(-1, 1, (NUM_KERNELS * PER_KERNEL, 6))
    if reached >= 1:
        _babble(run, fields, kernels, targets, q)
    if reached >= 2:
        _learn(run, kernels, targets, q)
    if reached >= 3:
        _plan(run, targets, q, executed=reached >= 4)
    return run


def _babble(run, fields, kernels, targets, q):
    save_arrays(run.skin, {"p_BS": fields.p_BS, "vertices": fields.vertices, "faces": fields.faces})
    shard = Shard(
        walk=0,
        num_steps=len(q),
        step=np.arange(len(q)),
        q=q,
        sensation=np.repeat(targets, PER_KERNEL, axis=0),
        p_WF=RADIUS * np.repeat(kernels, PER_KERNEL, axis=0),
    )
    write_shard(run.path, shard, fingerprint=run.fingerprint())
    run.add_metrics({"babbling_num_samples": len(q)})


def _learn(run, kernels, targets, q):
    distance = np.linalg.norm(kernels[:, None] - kernels, axis=2)
    edges = np.argwhere(np.triu(distance < 0.6, k=1))
    representation = QuotientRepresentation(
        target_sensations=targets,
        kernel_offsets=PER_KERNEL * np.arange(NUM_KERNELS + 1),
        kernel_q=q,
        kernel_row=np.arange(len(q)),
        kernel_strength=np.linspace(0.5, 2.0, len(q)),
        kernel_error=np.linspace(0.0, 0.1, len(q)),
        set_distance=distance,
        edges=edges,
        edge_cost=distance[edges[:, 0], edges[:, 1]],
        embedding=kernels * [1.0, 1.0, -1.0],
    )
    save_arrays(run.representation, dataclasses.asdict(representation) | run.stamp())
    found = topology(kernels)
    diagrams = {f"diagram_{k}": bars for k, bars in enumerate(found.diagram)}
    save_arrays(run.topology, diagrams | {"parts": kernels[:0]} | run.stamp())
    run.add_metrics({"topology_betti": list(found.betti), "shape_rms_fraction": 0.0123})


def _plan(run, targets, q, *, executed):
    time_s = np.linspace(0.0, 1.2, 121)
    path = q[0] + np.minimum(time_s / 1.2, 1.0)[:, None] * (q[200] - q[0])
    blend = np.linspace(1.0, 0.0, len(time_s))[:, None]
    felt = 3.0 * (blend * targets[0] + (1 - blend) * targets[40])
    felt[50:60] = 0.0
    arrays = {
        "nodes": np.array([0, 17, 40]),
        "links": np.array([-1, -1]),
        "waypoints_q": path[[0, 60, 120]],
        "waypoint_s": time_s[[0, 60, 120]],
        "time_s": time_s,
        "s": time_s,
        "q": path,
        "v": np.gradient(path, time_s, axis=0),
        "predicted": targets[0] * blend + targets[40] * (1 - blend),
        "predicted_spread": np.full(len(time_s), 0.01),
        **run.stamp(),
    }
    if executed:
        arrays |= {"felt": felt, "q_measured": path + 0.001}
    save_arrays(run.plan(0, 40), arrays)


@pytest.fixture
def make_run(tmp_path):
    """Makes a run that has come as far as a stage."""
    return lambda stage: _make_run(tmp_path / "run", stage=stage)


@pytest.fixture
def unrendered(monkeypatch):
    """Figures are made but not turned into pixels, where only their being there matters."""

    def savefig(figure, path, **options):
        path.write_bytes(b"pixels")

    monkeypatch.setattr(Figure, "savefig", savefig)


@pytest.fixture(scope="session")
def reported(tmp_path_factory) -> RunDirectory:
    """A run that was executed and reported, under a malicious name."""
    run = _make_run(tmp_path_factory.mktemp("runs") / "run", stage="executed", name=MALICIOUS)
    style, ports = dict(mpl.rcParams), []

    def opened(params):
        meshcat = Meshcat(params)
        ports.append(meshcat.port())
        return meshcat

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("selftouch_drake.show.server.Meshcat", opened)
        write_report(run)
    assert dict(mpl.rcParams) == style, "drawing changed matplotlib's own settings"
    assert not any(map(_served, ports)), "the Meshcat server was left open"
    assert len(ports) == 1
    return run


def _served(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("localhost", port)) == 0
