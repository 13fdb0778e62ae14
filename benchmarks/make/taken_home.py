"""A body beside its export, in Meshcat and in MuJoCo: in one posture, seen from one side.

`benchmarks/make/pictures.py` draws it.
"""

from __future__ import annotations

import csv
import io
import os
import shutil
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from pydrake.math import RigidTransform, RotationMatrix

from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.run.artifacts import load_representation
from selftouch_drake.run.exported import Known, export_model, exported_model
from selftouch_drake.run.worlds import make_world
from selftouch_drake.show.meshcat.live_page import shown_page
from selftouch_drake.show.meshcat.stage import FeelingRobot
from selftouch_drake.show.style import VIEW, styled

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.accuracy.take_home import rigidly, touched
from benchmarks.shared.babbled import learned

SOFTWARE_GL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
SIZE = {
    "seed": 31,
    "babbling": {"num_samples": 12_000},
    "representation": {"num_targets": 200},
}
#: What the owner knows: a link, and how deep the finger sinks.
KNOWN = {"length": ("shoulder_pitch", "elbow_pitch", 0.4), "depth": 0.012}
# m from the middle of the skin, degrees that a camera sees, and pixels.
AWAY, SEEN_DEG, PIXELS = 0.95, 75.0, 560
# Rows of a picture without empty ones, and without Meshcat's controls.
CUT = slice(24, 440)
# m, radius of the rods that show where joints are in MuJoCo.
ROD = 0.012


@styled
def taken_home(runs: Path) -> Figure:
    """The torus, its export as an experiment, and its export as MJCF."""
    run = learned(runs / "taken_home", load_experiment("torus", SIZE))
    world, representation = make_world(run), load_representation(run)
    true = touched(run, world)
    q = representation.kernel_q.astype(float)
    target = np.repeat(
        np.arange(representation.num_targets), np.diff(representation.kernel_offsets)
    )
    for mirror in (False, True):
        known = Known(**KNOWN, mirror=mirror)
        found = exported_model(run, known)
        onto = rigidly(found.model.place(q[true.row], target[true.row]), true.centre)
        if not onto.mirrors:
            break
    folder = runs / "taken_home-export"
    files = [folder / "torus.urdf", folder / "torus.xml"]
    export_model(run, files, known)
    again = World(load_experiment(folder / "torus_experiment.yaml"))
    with (folder / "torus_joints.csv").open() as opened:
        scale = {row["joint"]: float(row["scale"]) for row in csv.DictReader(opened)}
    # The touch that is seen best.
    best = true.row[(true.centre @ VIEW.towards).argmax()]
    posture = dict(zip(map(last, world.robot.joint_names), q[best], strict=True))
    there = np.array([scale[last(n)] * posture[last(n)] for n in again.robot.joint_names])
    X_WL, X_EL = (
        rigid(one.robot.skin_positions(at[None])[0, 0])
        for one, at in ((world, q[best]), (again, there))
    )
    X_LE = RigidTransform(RotationMatrix.ProjectToRotationMatrix(onto.rotation), onto.shift)
    X_WE = X_WL @ X_LE @ X_EL.inverse()
    middle = X_WL @ world.skins[0].fields.vertices.mean(axis=0)
    pictures = {
        "The robot, in Meshcat": in_meshcat(world, q[best], RigidTransform(), middle),
        "Its export, in Meshcat": in_meshcat(again, there, X_WE, middle),
        "Its export, in MuJoCo": in_mujoco(files[1], scale, posture, X_WE, middle),
    }
    figure = Figure(figsize=(9.6, 3.4), layout="constrained", dpi=110)
    for ax, (title, picture) in zip(figure.subplots(1, 3), pictures.items(), strict=True):
        ax.imshow(picture[CUT])
        ax.set_title(title)
        ax.axis("off")
    return figure


def last(name: str) -> str:
    """A joint's name without that of its model."""
    return name.rpartition("::")[2]


def rigid(pose: np.ndarray) -> RigidTransform:
    """Of a `(3, 4)` pose."""
    return RigidTransform(RotationMatrix(pose[:, :3]), pose[:, 3])


def in_meshcat(world: World, q: np.ndarray, X_WE: RigidTransform, middle: np.ndarray) -> np.ndarray:
    """A robot in a browser, with its world moved by `X_WE`."""
    from playwright.sync_api import sync_playwright

    said = list[str]()
    with shown_page("robot", announce=said.append) as meshcat, sync_playwright() as driver:
        robot = FeelingRobot(meshcat, world)
        robot.show(q, world.probe.sensations(q[None])[0])
        for path in ("/drake", "/skins", "/touching"):
            meshcat.SetTransform(path, X_WE)
        for path in ("/titles", "/status"):
            meshcat.SetProperty(path, "visible", False)
        meshcat.SetCameraPose(middle + AWAY * VIEW.towards, middle)
        path = shutil.which("chromium") or shutil.which("google-chrome")
        browser = driver.chromium.launch(executable_path=path, args=SOFTWARE_GL)
        page = browser.new_page(viewport={"width": PIXELS, "height": PIXELS})
        page.goto(f"http://localhost:{meshcat.port()}")
        page.wait_for_timeout(5000)
        return np.asarray(Image.open(io.BytesIO(page.screenshot(timeout=120_000))).convert("RGB"))


def in_mujoco(
    file: Path,
    scale: dict[str, float],
    posture: dict[str, float],
    X_WE: RigidTransform,
    middle: np.ndarray,
) -> np.ndarray:
    """The body in MuJoCo, with rods between its links, which have no shape but the skin's."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    import mujoco

    spec = mujoco.MjSpec.from_file(str(file))
    for body in spec.bodies:
        for child in body.bodies:
            if body.name != "world" and np.linalg.norm(child.pos) > ROD:
                body.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0, 0, 0, *child.pos],
                    size=[ROD, 0, 0], contype=0, conaffinity=0, rgba=[0.5, 0.62, 0.75, 1],
                )  # fmt: skip
        if body.name.startswith("toucher_"):
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[2 * ROD, 0, 0], contype=0, conaffinity=0,
                rgba=[0.84, 0.37, 0.0, 1],
            )  # fmt: skip
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=64, height=384,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT, rgb1=[1, 1, 1], rgb2=[0.87, 0.89, 0.92],
    )  # fmt: skip
    turned = X_WE.inverse()
    facing = turned.rotation() @ RotationMatrix(VIEW.axes.T)
    spec.worldbody.add_camera(
        name="side",
        pos=turned @ (middle + AWAY * VIEW.towards),
        quat=facing.ToQuaternion().wxyz(),
        fovy=SEEN_DEG,
    )
    for geom in spec.geoms:
        if geom.meshname:
            geom.rgba = [0.92, 0.8, 0.67, 1.0]
    spec.visual.headlight.ambient = [0.5, 0.5, 0.5]
    spec.visual.global_.offwidth = spec.visual.global_.offheight = PIXELS
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, reading in posture.items():
        data.qpos[model.joint(name).qposadr[0]] = scale[name] * reading
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, PIXELS, PIXELS) as renderer:
        renderer.update_scene(data, camera="side")
        return renderer.render()
