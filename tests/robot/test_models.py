import json
import logging
import sys

import numpy as np
import pytest
import trimesh
from pydrake.geometry import Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot.models import load_model, parse

URDF = """<robot name="box">
  <link name="box">
    <inertial>
      <mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <drake:undeclared/>
    <visual><geometry><mesh filename="{mesh}" scale="2 2 2"/></geometry></visual>
    <collision><geometry><mesh filename="{mesh}"/></geometry></collision>
  </link>
</robot>"""
INNER = """<sdf version="1.9"><model name="inner"><link name="box">
  <collision name="c"><geometry><mesh><uri>meshes/box.stl</uri></mesh></geometry></collision>
</link></model></sdf>"""
OUTER = """<sdf version="1.9"><model name="outer">
  <include><name>inner</name><uri>inner.sdf</uri></include>
  <link name="plate">
    <collision name="c"><geometry><mesh><uri>meshes/plate.obj</uri></mesh></geometry></collision>
  </link>
  <joint name="j" type="fixed"><parent>plate</parent><child>inner::box</child></joint>
</model></sdf>"""
MJCF = """<mujoco model="ball"><compiler meshdir="{meshdir}"/>
  <asset><include file="assets.xml"/></asset>
  <worldbody><body name="ball">
    <joint name="j" type="hinge" axis="0 0 1" solreffriction="0 0"/>
    <geom type="mesh" mesh="box"/>
  </body></worldbody></mujoco>"""
ADD_BOX = "directives:\n- add_model: {name: box, file: 'package://mine/box.urdf'}\n"


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "selftouch_drake"


@pytest.fixture
def mine(tmp_path):
    """A user's package: a URDF with an STL mesh beside it."""
    folder = tmp_path / "my robots"
    (folder / "meshes").mkdir(parents=True)
    trimesh.creation.box((0.1, 0.2, 0.3)).export(folder / "meshes" / "box.stl")
    (folder / "box.urdf").write_text(URDF.format(mesh="meshes/box.stl"))
    (folder / "robot.dmd.yaml").write_text(ADD_BOX)
    return folder


def load(folder, announce=None):
    return load_model(str(folder / "robot.dmd.yaml"), {"mine": str(folder)}, announce)


def plant_and_geometry(model):
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), time_step=0.01)
    parse(plant, model)
    plant.Finalize()
    return plant, scene_graph.model_inspector()


def extents(inspector, role):
    """File names of the meshes with a role, sorted."""
    shapes = [inspector.GetShape(g) for g in inspector.GetAllGeometryIds(role)]
    found = [trimesh.load_mesh(shape.source().path()).extents * shape.scale3() for shape in shapes]
    return np.array(sorted(found, key=tuple))


@pytest.mark.parametrize(
    ("name", "tips"), [("one_finger", 1), ("two_fingers", 2), ("two_wide_fingers", 2)]
)
def test_paper_s_robots_are_complete(name, tips):
    model = load_model(f"package://selftouch_drake/{name}.dmd.yaml", {})
    plant, inspector = plant_and_geometry(model)
    assert plant.num_positions() == plant.num_actuators() == 6
    assert all(plant.HasFrameNamed(f"fingertip_{tip}") for tip in range(tips))
    assert not inspector.GetAllGeometryIds(Role.kProximity)
    assert [file.name for file in model.files] == [
        f"{name}.dmd.yaml",
        "arm_on_body.dmd.yaml",
        "body.sdf",
        "arm.sdf",
        f"{name}.sdf",
    ]


def test_meshes_that_drake_refuses_are_converted_once(mine, cache):
    lines = []
    model = load(mine, lines.append)
    assert lines == [f"converted 1 mesh to OBJ into {cache / 'meshes'}"]
    _, inspector = plant_and_geometry(model)
    np.testing.assert_allclose(extents(inspector, Role.kProximity), [[0.1, 0.2, 0.3]], atol=1e-7)
    np.testing.assert_allclose(extents(inspector, Role.kIllustration), [[0.2, 0.4, 0.6]], atol=1e-7)
    assert [file.relative_to(mine).as_posix() for file in model.files] == [
        "robot.dmd.yaml",
        "box.urdf",
        "meshes/box.stl",
    ]
    before = sorted(cache.rglob("*"))
    load(mine, lines.append)
    assert len(lines) == 1
    assert sorted(cache.rglob("*")) == before


def test_models_that_drake_takes_are_read_where_they_are(mine, cache):
    trimesh.creation.box((0.1, 0.2, 0.3)).export(mine / "meshes" / "box.obj")
    (mine / "box.urdf").write_text(URDF.format(mesh="package://mine/meshes/box.obj"))
    model = load(mine)
    plant_and_geometry(model)
    assert not cache.exists()


def test_copies_name_every_other_file_where_it_is(mine):
    trimesh.creation.box((0.5, 0.5, 0.5)).export(mine / "meshes" / "plate.obj")
    (mine / "inner.sdf").write_text(INNER)
    (mine / "outer.sdf").write_text(OUTER)
    (mine / "inner.dmd.yaml").write_text(
        "directives:\n- add_model: {name: outer, file: outer.sdf}\n"
        "- add_weld:\n    parent: world\n    child: outer::plate\n"
        "    X_PC: {rotation: !Rpy {deg: [0, 0, 9]}}\n"
    )
    (mine / "robot.dmd.yaml").write_text(
        "directives:\n- add_model_instance: {name: left}\n"
        "- add_directives: {file: 'package://mine/inner.dmd.yaml', model_namespace: left}\n"
    )
    model = load(mine)
    plant, inspector = plant_and_geometry(model)
    assert plant.HasModelInstanceNamed("left::outer::inner")
    assert plant.num_positions() == 0
    np.testing.assert_allclose(
        extents(inspector, Role.kProximity), [[0.1, 0.2, 0.3], [0.5, 0.5, 0.5]], atol=1e-7
    )
    assert [file.name for file in model.files] == [
        "robot.dmd.yaml",
        "inner.dmd.yaml",
        "outer.sdf",
        "plate.obj",
        "inner.sdf",
        "box.stl",
    ]


def test_mjcf_includes_and_mesh_folder(mine, capfd):
    (mine / "assets.xml").write_text('<mujocoinclude><mesh file="box.stl"/></mujocoinclude>')
    (mine / "box.xml").write_text(MJCF.format(meshdir="meshes"))
    (mine / "robot.dmd.yaml").write_text(ADD_BOX.replace("urdf", "xml"))
    model = load(mine)
    plant, inspector = plant_and_geometry(model)
    assert plant.num_positions() == 1
    np.testing.assert_allclose(extents(inspector, Role.kProximity), [[0.1, 0.2, 0.3]], atol=1e-7)
    assert {"assets.xml", "box.stl"} <= {file.name for file in model.files}
    # What Drake does not use of MJCF is none of the user's business.
    assert capfd.readouterr() == ("", "")
    assert logging.getLogger("drake").propagate


def test_buffers_of_gltf_count(mine):
    for name, content in trimesh.exchange.gltf.export_gltf(
        trimesh.Scene(trimesh.creation.box((0.1, 0.2, 0.3)))
    ).items():
        (mine / "meshes" / name).write_bytes(content)
    (mine / "meshes" / "model.gltf").rename(mine / "meshes" / "box.gltf")
    (mine / "box.urdf").write_text(URDF.format(mesh="meshes/box.gltf"))
    (buffer, *_) = json.loads((mine / "meshes" / "box.gltf").read_text())["buffers"]
    model = load(mine)
    assert (mine / "meshes" / buffer["uri"]).resolve() in model.files
    plant_and_geometry(model)


def test_collada_without_pycollada(mine, monkeypatch):
    monkeypatch.setitem(sys.modules, "collada", None)
    (mine / "meshes" / "box.dae").write_text("<COLLADA/>")
    (mine / "box.urdf").write_text(URDF.format(mesh="meshes/box.dae"))
    with pytest.raises(ExperimentError, match=r"pip install 'selftouch-drake\[collada\]'"):
        load(mine)


def test_collada_is_scaled_to_metres(mine):
    pytest.importorskip("collada")
    box = trimesh.creation.box((10, 20, 30)).export(file_type="dae").decode()
    stated = box.replace("<up_axis>", '<unit name="centimeter" meter="0.01"/><up_axis>')
    (mine / "meshes" / "box.dae").write_text(stated)
    (mine / "box.urdf").write_text(URDF.format(mesh="meshes/box.dae"))
    _, inspector = plant_and_geometry(load(mine))
    np.testing.assert_allclose(extents(inspector, Role.kProximity), [[0.1, 0.2, 0.3]], atol=1e-6)


def test_prefix_in_a_root_is_python_s(mine, monkeypatch):
    monkeypatch.setattr(sys, "prefix", str(mine.parent))
    model = load_model("package://mine/robot.dmd.yaml", {"mine": "{prefix}/my robots"})
    assert model.packages["mine"] == mine


@pytest.mark.parametrize(
    ("file", "content", "error"),
    [
        (
            "robot.dmd.yaml",
            None,
            "is '{0}/robot.dmd.yaml', and {0}/robot.dmd.yaml does not exist; correct the path",
        ),
        ("robot.dmd.yaml", "directives: [", "yaml-cpp: error at line 1"),
        ("robot.dmd.yaml", "directives: [{add_weld: {}}]", "`parent` must be non-empty"),
        ("robot.dmd.yaml", "directives: [{add_modle: {}}]", "key 'add_modle' did not match"),
        (
            "robot.dmd.yaml",
            ADD_BOX.replace("mine", "min"),
            "there is no package 'min' in robot.packages: did you mean mine?",
        ),
        (
            "robot.dmd.yaml",
            ADD_BOX.replace("mine", "zzz"),
            "there is no package 'zzz' in robot.packages: known are selftouch_drake, mine, drake",
        ),
        (
            "robot.dmd.yaml",
            ADD_BOX.replace("mine", "zzz"),
            "; give its folder, as in packages: {{zzz: FOLDER}}",
        ),
        ("robot.dmd.yaml", ADD_BOX.replace("package", "http"), "give a path, or package://"),
        (
            "robot.dmd.yaml",
            "directives: [{add_directives: {file: robot.dmd.yaml}}]",
            "robot.dmd.yaml includes itself",
        ),
        (
            "robot.dmd.yaml",
            ADD_BOX + "- add_weld: {parent: world, child: 'box::lid'}\n",
            "robot.directives cannot be loaded: ",
        ),
        ("box.urdf", None, "is 'package://mine/box.urdf', and {}/box.urdf does not exist"),
        ("box.urdf", "<robot><link></robot>", "box.urdf is not readable XML (mismatched"),
        ("box.urdf", '<robot name="a"><link/></robot>', "link tag is missing name attribute"),
        ("meshes/box.stl", None, "is 'meshes/box.stl', and {}/meshes/box.stl does not exist"),
        ("meshes/box.stl", "solid", "meshes/box.stl"),
    ],
)
def test_mistakes_are_reported_in_one_line(mine, file, content, error):
    (mine / file).unlink()
    if content is not None:
        (mine / file).write_text(content)
    with pytest.raises(ValueError, match=r".") as caught:
        plant_and_geometry(load(mine))
    text = str(caught.value)
    assert error.format(mine) in text
    assert "\n" not in text
    assert len(text) < 700


@pytest.mark.parametrize(
    ("packages", "error"),
    [
        ({"mine": "/nowhere"}, "robot.packages.mine is '/nowhere', and /nowhere is not a folder"),
        (
            {"drake": "/"},
            "robot.packages.drake is a package that always exists; give it another name",
        ),
        (
            {"selftouch_drake": "/"},
            "robot.packages.selftouch_drake is a package that always exists",
        ),
    ],
)
def test_invalid_package_roots_are_refused(packages, error):
    with pytest.raises(ExperimentError) as caught:
        load_model("package://selftouch_drake/one_finger.dmd.yaml", packages)
    assert error in str(caught.value)


def test_a_model_is_no_directives(mine):
    (mine / "robot.dmd.yaml").unlink()
    with pytest.raises(ExperimentError) as caught:
        load_model(str(mine / "box.urdf"), {"mine": str(mine)})
    assert str(caught.value) == (
        f"directives {mine / 'box.urdf'} are the model of a robot; write directives (.dmd.yaml) "
        "that add it, as in directives: [{add_model: {name: robot, file: box.urdf}}], and weld "
        "what floats freely (add_weld)"
    )


def test_a_package_beside_the_model_is_named(mine):
    """As in PyBullet's Franka, whose meshes are in `package://meshes`."""
    (mine / "box.urdf").write_text(URDF.format(mesh="package://meshes/box.stl"))
    with pytest.raises(ExperimentError) as caught:
        load_model(str(mine / "robot.dmd.yaml"), {"mine": str(mine)})
    remedy = f"give its folder, as in packages: {{meshes: {mine / 'meshes'}}}"
    assert str(caught.value).endswith(remedy)
    load_model(str(mine / "robot.dmd.yaml"), {"mine": str(mine), "meshes": str(mine / "meshes")})
