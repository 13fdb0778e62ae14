"""What other people's models leave out or do in their own way, and what becomes of it."""

import dataclasses
import logging
import re
import warnings

import numpy as np
import pytest
import trimesh
from arms import ARM, Mjcf, sdf, urdf
from beside_mujoco import Loaded
from pydrake.geometry import Mesh

from selftouch_drake.experiment import ExperimentError, experiment_from_fields
from selftouch_drake.robot import World
from selftouch_drake.robot.describe import description
from selftouch_drake.robot.faces import FaceReader
from selftouch_drake.robot.facts import JointFacts, Parsed, check_facts
from selftouch_drake.robot.links import as_mesh
from selftouch_drake.robot.model_warnings import ModelWarning, _warn_once

DIRECTIVES = """directives:
- add_model: {{name: arm, file: {file}}}
- add_frame: {{name: tip, X_PF: {{base_frame: 'arm::hand', translation: [0, 0, 0.3]}}}}
{weld}"""
HAND_L2 = {"hand", "l2"}
WELD = "- add_weld: {parent: world, child: 'arm::base'}\n"


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


def world(folder, content, suffix, skins=("l1",), **robot):
    """The world of an arm whose tip touches skins on its own links."""
    (folder / f"arm{suffix}").write_text(content)
    weld = "" if suffix == ".xml" else WELD
    (folder / "r.dmd.yaml").write_text(DIRECTIVES.format(file=f"arm{suffix}", weld=weld))
    shape = {"shape": "sphere", "radius": 0.1, "resolution": 0.1}
    skin = {"surface": shape, "num_receptors": 20}
    return World(
        experiment_from_fields(
            {
                "name": "test",
                "robot": {"directives": str(folder / "r.dmd.yaml"), **robot},
                "skins": {name: {"link": name, **skin} for name in skins},
                "touching": {"tip": {"frame": "tip", "radius": 0.01}},
            }
        )
    )


def test_a_joint_that_moves_no_mass_is_refused(tmp_path):
    refusal = (
        "joint 'j4' turns hand without mass or inertia, which no simulation can move; give the "
        "link an <inertial> in its model, or leave the joint out of robot.joints"
    )
    light = urdf(ARM.but("hand", mass=0.0))
    with pytest.raises(ExperimentError) as error:
        _ = world(tmp_path, light, ".urdf").robot
    assert str(error.value) == refusal
    named = world(tmp_path, light, ".urdf", joints=["j1", "j2", "j3"]).robot
    assert named.num_joints == 3


def test_a_link_without_mass_but_with_geometry_is_a_link(tmp_path):
    """It counts as between its neighbours: they are not next to each other."""
    heavy = world(tmp_path, urdf(), ".urdf").robot
    light = world(tmp_path, urdf(ARM.but("l3", mass=0.0)), ".urdf").robot
    names = [{frozenset(k.name() for k in p.links) for p in r.rigid_pairs} for r in (heavy, light)]
    assert names[0] == names[1]
    assert frozenset(("l2", "hand")) in names[1]


def test_a_skin_beyond_a_link_without_mass_is_touched(tmp_path):
    robot = world(tmp_path, urdf(ARM.but("l3", mass=0.0)), ".urdf", skins=("l2",)).robot
    assert robot.touching_pairs == ((0, 0),)


def test_geometries_that_never_meet_do_not_keep_skins_from_being_touched(tmp_path):
    bits = dict.fromkeys(("l1", "l2", "l3", "hand", "side"), "contype='2' conaffinity='4'")
    robot = world(tmp_path, Mjcf(in_geoms=bits).of(), ".xml").robot
    assert robot.touching_pairs == ((0, 0),)
    assert {frozenset(k.name() for k in pair.links) for pair in robot.rigid_pairs} == set()


def test_a_folder_of_gazebo_s_is_read(tmp_path):
    folder = tmp_path / "myhand"
    (folder / "meshes").mkdir(parents=True)
    trimesh.creation.box((20, 40, 60)).export(folder / "meshes" / "h.stl")
    (folder / "model.config").write_text(
        "<?xml version='1.0'?><model><name>myhand</name><sdf version='1.5'>old.sdf</sdf>"
        "<sdf version='1.10'>model.sdf</sdf></model>"
    )
    (folder / "model.sdf").write_text(
        "<sdf version='1.7'><model name='myhand'><link name='tool'><collision name='c'><geometry>"
        "<mesh><uri>model://myhand/meshes/h.stl</uri><scale>.001 .001 .001</scale></mesh>"
        "</geometry></collision></link></model></sdf>"
    )
    include = (
        "<include><uri>model://myhand</uri><name>h</name></include>"
        "<joint name='mount' type='fixed'><parent>hand</parent><child>h::tool</child></joint>"
    )
    file = tmp_path / "arm.sdf"
    file.write_text(sdf(more=include))
    weld = ("base", np.zeros(3), [1, 0, 0, 0])
    loaded = Loaded(file, tmp_path, welds=[weld], packages={"myhand": str(folder)})
    assert "tool" in loaded.links
    (folder / "model.config").unlink()
    with pytest.raises(ExperimentError, match=r"myhand, which has no model\.config; name a file"):
        Loaded(file, tmp_path, welds=[weld], packages={"myhand": str(folder)})


def test_what_is_left_out_is_told_once(tmp_path):
    _warn_once.cache_clear()
    content = Mjcf(
        in_joints=dict.fromkeys(("j1", "j2"), "stiffness='3'"),
        foot="<tendon><fixed name='t'><joint joint='j1' coef='1'/></fixed></tendon>"
        "<actuator><motor name='pull' tendon='t'/></actuator>",
    ).of()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        _ = world(tmp_path, content, ".xml").robot
        _ = world(tmp_path, content, ".xml").robot
    lines = [str(one.message) for one in told if one.category is ModelWarning]
    assert lines == [
        "arm.xml: The attribute 'stiffness' found in a 'joint' tag is currently unsupported and "
        "will be ignored. (2 times)",
        "arm.xml: tendon 't' is left out",
        "arm.xml: actuator 'pull' acts on no single joint, and its effort is left out",
    ]


@pytest.mark.parametrize(
    ("tampered", "line"),
    [
        ({"poses": {"l2": ("l1", np.eye(3, 4))}}, "Drake puts body 'l2' 300 mm away from where"),
        (
            {"joints": {"j2": JointFacts(lower=-1, upper=1, placed=("l2", np.eye(2, 3)))}},
            "Drake moves joint 'j2' about another axis than the file",
        ),
        ({"joints": {"j9": JointFacts(lower=-1, upper=1)}}, "joint 'j9' was lost"),
    ],
)
def test_what_drake_reads_in_another_way_is_refused(tampered, line, tmp_path):
    (tmp_path / "arm.xml").write_text(Mjcf().of())
    loaded = Loaded(tmp_path / "arm.xml", tmp_path)
    ((model, facts),) = loaded.parsed.models
    check_facts(loaded.plant, loaded.parsed)
    wrong = Parsed(models=[(model, dataclasses.replace(facts, **tampered))], logged=[])
    with pytest.raises(ExperimentError, match=re.escape(line)):
        check_facts(loaded.plant, wrong)


def test_errors_name_the_author_s_file(tmp_path):
    with pytest.raises(ExperimentError) as error:
        _ = world(tmp_path, Mjcf(compiler="coordinate='global'").of(), ".xml").robot
    assert f"{tmp_path / 'arm.xml'}:" in str(error.value)
    assert "cache" not in str(error.value).replace(str(tmp_path), "")


def test_a_mirrored_mesh_is_not_inside_out(tmp_path):
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    box.export(tmp_path / "box.obj")
    mirrored = as_mesh(Mesh(str(tmp_path / "box.obj"), np.array([1.0, -1.0, 1.0])))
    assert mirrored.volume == pytest.approx(box.volume)


def test_nothing_is_said_of_links_with_several_geometries(tmp_path, caplog):
    several = {"hand": "/><geom type='sphere' size='.01'"}
    robot = world(tmp_path, Mjcf(in_geoms=several).of(), ".xml").robot
    with caplog.at_level(logging.WARNING, logger="drake"):
        FaceReader(robot.plant)
    assert caplog.records == []


def test_two_links_are_listed_once_though_geometries_meet_in_groups(tmp_path):
    """Of two links with a box and a ball each, boxes meet boxes, and balls meet balls."""
    ball = "contype='4' conaffinity='4' /><geom type='sphere' size='.01' pos='0 0 .3'"
    built = world(tmp_path, Mjcf(in_geoms={"hand": ball, "l2": ball}).of(), ".xml")
    pairs = [pair for pair in built.robot.rigid_pairs if {k.name() for k in pair.links} == HAND_L2]
    assert len(pairs) == 2
    listed = [row for row in description(built)[-1][1] if {row[0], row[1]} == HAND_L2]
    assert len(listed) == 1
