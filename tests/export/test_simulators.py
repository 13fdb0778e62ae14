"""Simulators read what is exported without a word, and put its links where the model does."""

import logging

import mujoco
import numpy as np
import pytest
from made_up import SLIDING, made_up_model, readings
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from selftouch_drake.export.link_tree import joint_limits, joint_scales, link_tree
from selftouch_drake.export.mjcf import mjcf_text
from selftouch_drake.export.sdformat import sdformat_text
from selftouch_drake.export.surface import part_surface, toucher_surface
from selftouch_drake.export.urdf import urdf_text

WRITERS = {"urdf": urdf_text, "sdf": sdformat_text, "xml": mjcf_text}
MODEL = made_up_model()
Q = readings(50)
#: Coordinates of the files, by the joint's name.
COORDINATES = dict(zip(MODEL.joint_names, (joint_scales(MODEL, SLIDING) * Q).T, strict=True))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The made-up body in all formats, with skins and touchers."""
    folder = tmp_path_factory.mktemp("export")
    meshes = {}
    for name, mesh in [
        ("part_0", part_surface(MODEL, 0).mesh),
        ("part_1", part_surface(MODEL, 1).mesh),
        ("toucher_0", toucher_surface(np.zeros(5), 0.1)),
        ("toucher_1", toucher_surface(MODEL.toucher_shape[1], 0.1)),
    ]:
        mesh.export(folder / f"{name}.obj")
        meshes[name] = f"{name}.obj", np.asarray(mesh.vertices).mean(axis=0)
    tree = link_tree(
        MODEL, SLIDING, joint_limits(MODEL, SLIDING, Q), name="body", meshes=meshes, parts=[0, 1],
        comments=["a comment -- with dashes --"],
    )  # fmt: skip
    for suffix, write in WRITERS.items():
        (folder / f"body.{suffix}").write_text(write(tree))
    return folder


def expected():
    """`(n, 4, 4)` poses of frames of the export in the world, by their names."""
    poses = MODEL.link_poses(Q)
    found = {f"part_{p}": poses[:, link] for p, link in enumerate(MODEL.part_link)}
    for toucher, link in enumerate(MODEL.toucher_link):
        shift = np.eye(4)
        shift[:3, 3] = MODEL.toucher_place[toucher]
        found[f"toucher_{toucher}"] = poses[:, link] @ shift
    return found


def drake_plant(file):
    """A plant, and the diagram that it is of: geometry is read with a scene graph only."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    Parser(plant).AddModels(str(file))
    plant.Finalize()
    return plant, builder.Build()


@pytest.mark.parametrize("suffix", WRITERS)
def test_drake_puts_links_where_the_model_does(folder, suffix, caplog):
    with caplog.at_level(logging.DEBUG):
        plant, diagram = drake_plant(folder / f"body.{suffix}")
    assert [r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING] == []
    names = {n: n.replace("::", "__") if suffix == "sdf" else n for n in MODEL.joint_names}
    joints = {name: plant.GetJointByName(there) for name, there in names.items()}
    assert plant.num_positions() == len(joints)
    assert plant.num_actuators() == len(joints)
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    poses = expected()
    for row in range(len(Q)):
        for name, joint in joints.items():
            (joint.set_translation if joint.type_name() == "prismatic" else joint.set_angle)(
                context, COORDINATES[name][row]
            )
        for name, pose in poses.items():
            X_WF = plant.GetFrameByName(name).CalcPoseInWorld(context).GetAsMatrix4()
            np.testing.assert_allclose(X_WF, pose[row], atol=1e-9)
    for index, (name, joint) in enumerate(joints.items()):
        limits = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        np.testing.assert_allclose(limits, (COORDINATES[name].min(), COORDINATES[name].max()))
        assert joint.type_name() == ("prismatic" if SLIDING[index] else "revolute")


def test_mujoco_puts_bodies_where_the_model_does(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings into a file there
    model = mujoco.MjModel.from_xml_path(str(folder / "body.xml"))
    data, poses = mujoco.MjData(model), expected()
    assert model.njnt == model.nu == len(MODEL.joint_names)
    for row in range(len(Q)):
        for name in MODEL.joint_names:
            data.joint(name).qpos[0] = COORDINATES[name][row]
        mujoco.mj_kinematics(model, data)
        for name, pose in poses.items():
            body = data.body(name)
            np.testing.assert_allclose(body.xmat.reshape(3, 3), pose[row, :3, :3], atol=1e-9)
            np.testing.assert_allclose(body.xpos, pose[row, :3, 3], atol=1e-9)
    assert list(tmp_path.iterdir()) == []


def test_mujoco_reads_the_urdf_and_simulates(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for file in ("body.urdf", "body.xml"):
        model = mujoco.MjModel.from_xml_path(str(folder / file))
        assert {model.joint(n).name for n in range(model.njnt)} == set(MODEL.joint_names)
        data = mujoco.MjData(model)
        for _ in range(20):
            mujoco.mj_step(model, data)
        assert np.isfinite(data.qpos).all()
    assert list(tmp_path.iterdir()) == []


def test_pybullet_puts_links_where_the_model_does(folder, capfd):
    bullet = pytest.importorskip("pybullet")
    client = bullet.connect(bullet.DIRECT)
    capfd.readouterr()
    body = bullet.loadURDF(str(folder / "body.urdf"), useFixedBase=True)
    said = capfd.readouterr()
    assert (said.out + said.err).strip() == ""
    infos = [bullet.getJointInfo(body, n) for n in range(bullet.getNumJoints(body))]
    joints = {info[1].decode(): info[0] for info in infos}
    links = {info[12].decode(): info[0] for info in infos}
    for row in range(len(Q)):
        for name in MODEL.joint_names:
            bullet.resetJointState(body, joints[name], COORDINATES[name][row])
        for name, pose in expected().items():
            # Something in PyBullet has single precision: 1e-7 is what it reaches.
            state = bullet.getLinkState(body, links[name], computeForwardKinematics=True)
            np.testing.assert_allclose(state[4], pose[row, :3, 3], atol=1e-6)
            turn = np.reshape(bullet.getMatrixFromQuaternion(state[5]), (3, 3))
            np.testing.assert_allclose(turn, pose[row, :3, :3], atol=1e-6)
    bullet.disconnect(client)


def test_yourdfpy_puts_links_where_the_model_does(folder, caplog):
    yourdfpy = pytest.importorskip("yourdfpy")
    with caplog.at_level(logging.WARNING):
        robot = yourdfpy.URDF.load(str(folder / "body.urdf"))
        assert robot.validate()
    assert caplog.records == []
    for row in range(len(Q)):
        robot.update_cfg({name: COORDINATES[name][row] for name in MODEL.joint_names})
        for name, pose in expected().items():
            np.testing.assert_allclose(robot.get_transform(name), pose[row], atol=1e-9)
