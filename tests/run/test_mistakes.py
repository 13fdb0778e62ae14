"""Mistakes in a robot, as a user meets them: one line with field, value and remedy, and no run."""

import pytest
import yaml

from selftouch_drake.cli import cli, exit_status
from selftouch_drake.experiment.loading import merged

# A base, a body above it, and an arm of two links with a finger.
MODEL = """<?xml version="1.0"?>
<sdf version="1.7">
  <model name="small">
    <link name="base"/>
    <link name="torso">
      <pose>0 0 0.5 0 0 0</pose>
      <collision name="trunk"><geometry><sphere><radius>0.1</radius></sphere></geometry></collision>
    </link>
    <link name="upper_arm"><pose>0.3 0 0.5 0 0 0</pose></link>
    <link name="forearm"><pose>0.3 0.1 0.5 0 0 0</pose></link>
    <frame name="fingertip" attached_to="forearm"><pose>-0.22 -0.1 0 0 0 0</pose></frame>
    <joint name="trunk" type="fixed"><parent>base</parent><child>torso</child></joint>
    <joint name="shoulder" type="revolute">
      <parent>base</parent><child>upper_arm</child>
      <axis><xyz>0 0 1</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis>
    </joint>
    <joint name="elbow" type="revolute">
      <parent>upper_arm</parent><child>forearm</child>
      <axis><xyz>0 0 1</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis>
    </joint>
  </model>
</sdf>
"""
DIRECTIVES = """directives:
- add_model: {name: small, file: package://mine/small.sdf}
- add_weld: {parent: world, child: small::base}
"""
EXPERIMENT = {
    "robot": {"directives": "package://mine/small.dmd.yaml", "packages": {"mine": "."}},
    "skins": {
        "torso": {"link": "torso", "surface": {"shape": "sphere", "radius": 0.1}, "thickness": 0.02}
    },
    "touching": {"tip": {"frame": "fingertip", "radius": 0.01}},
    "babbling": {"num_samples": 60, "walk_size": 30},
    "representation": {"num_targets": 50},
}


@pytest.fixture
def babble(tmp_path, capfd):
    """Babbles with an experiment in a new folder; returns stderr."""

    def babble(overrides="{}", model=MODEL, directives=DIRECTIVES, *, status=2):
        (tmp_path / "small.sdf").write_text(model)
        (tmp_path / "small.dmd.yaml").write_text(directives)
        fields = merged(EXPERIMENT, yaml.safe_load(overrides))
        (tmp_path / "mine.yaml").write_text(yaml.safe_dump(fields))
        line = ["babble", str(tmp_path / "mine.yaml"), "--out", str(tmp_path / "run")]
        line += ["--workers", "1"]
        found = exit_status(lambda: cli.main(line, prog_name="selftouch", standalone_mode=False))
        said = capfd.readouterr().err
        assert found == status, said
        assert "Traceback" not in said
        return said

    return babble


def test_the_small_robot_is_right(babble, tmp_path):
    babble(status=0)
    assert (tmp_path / "run" / "experience" / "part-00001.parquet").exists()


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            "{skins: {torso: {link: tosro}}}",
            "skins.torso.link is 'tosro'; the robot has no such link: did you mean torso?",
        ),
        (
            "{skins: {torso: {link: elephant}}}",
            "skins.torso.link is 'elephant'; the robot has no such link: it has base, forearm, "
            "torso, upper_arm, world",
        ),
        (
            "{touching: {tip: {frame: finger_tip}}}",
            "touching.tip.frame is 'finger_tip'; the robot has no such frame: did you mean "
            "fingertip?",
        ),
        (
            "{touching: {tip: {frame: null, radius: null, link: forarm}}}",
            "touching.tip.link is 'forarm'; the robot has no such link: did you mean forearm?",
        ),
        (
            "{touching: {tip: {frame: null, radius: null, link: forearm}}}",
            "touching.tip.link is 'forearm', a link without collision geometry; add some in its "
            "model, or give a ball by frame and radius",
        ),
        (
            "{robot: {joints: [sholder]}}",
            "robot.joints[0] is 'sholder'; the robot has no such joint: did you mean shoulder?",
        ),
        (
            "{robot: {joints: [shoulder, trunk]}}",
            "robot.joints[1] is 'trunk', a weld joint; name joints that turn about one axis or "
            "slide along one",
        ),
        (
            "{robot: {joints: [elbow, elbow]}}",
            "robot.joints is ['elbow', 'elbow']; name joints, each once, or null",
        ),
        (
            "{robot: {joints: [elbow, 'small::elbow']}}",
            "robot.joints is ['elbow', 'small::elbow']; name each joint once",
        ),
        (
            "{robot: {directives: package://mein/small.dmd.yaml}}",
            "robot.directives is 'package://mein/small.dmd.yaml'; there is no package 'mein' in "
            "robot.packages: did you mean mine?",
        ),
        (
            "{robot: {directives: package://mine/smal.dmd.yaml}}",
            "robot.directives is 'package://mine/smal.dmd.yaml', and HERE/smal.dmd.yaml does not "
            "exist; correct the path",
        ),
        (
            "{robot: {packages: {mine: nowhere}}}",
            "robot.packages.mine is 'HERE/nowhere', and HERE/nowhere is not a folder; give the "
            "folder of the package, or install the package",
        ),
        (
            "{robot: {packages: {selftouch_drake: .}}}",
            "robot.packages.selftouch_drake is a package that always exists; give it another name",
        ),
        (
            "{skins: {torso: {link: forearm, surface: collision}}}",
            "skins.torso.surface is 'collision', but link 'forearm' has no such geometry; add "
            "some in its model, or give a shape or a mesh",
        ),
        (
            "{skins: {torso: {surface: visual}}}",
            "skins.torso.surface is 'visual', but link 'torso' has no such geometry; take "
            "'collision', or give a shape or a mesh",
        ),
        (
            "{skins: {torso: {surface: {mesh: open.obj}}}}",
            "skins.torso.surface.mesh HERE/open.obj is open; close its holes so that it is "
            "watertight",
        ),
        (
            "{skins: {torso: {surface: {mesh: nothing.obj}}}}",
            "skins.torso.surface.mesh is 'HERE/nothing.obj'; there is no such file: correct the "
            "path",
        ),
        (
            "{skins: {torso: {thickness: 0.2}}}",
            "skins.torso.thickness is 0.2 m, thicker than the surface allows near",
        ),
        (
            "{skins: {torso: {link: forearm}}}",
            "skins.torso can never be touched: all touchers are on its own link or next to it; "
            "add another one to touching",
        ),
        (
            "{touching: {knob: {frame: torso, radius: 0.02}}}",
            "touching.knob can never touch: all skins are on its own link or next to it; "
            "leave it out, or add a skin",
        ),
    ],
)
def test_a_mistake_in_the_experiment(babble, tmp_path, overrides, message):
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (line,) = babble(overrides).splitlines()
    expected = f"selftouch: {message}".replace("HERE", str(tmp_path))
    assert line == expected or ("thicker" in message and line.startswith(expected))
    assert not (tmp_path / "run").exists()


# What stands in the model, what instead, and how the line begins: where the reason is Drake's own,
# its words are Drake's.
BROKEN = [
    ("<sdf", "<sdg", "model HERE/small.sdf is not readable XML (mismatched tag: line "),
    ("</model>", "", "model HERE/small.sdf is not readable XML (mismatched tag: line "),
    (
        'type="revolute"',
        'type="fixed"',
        "robot.directives has no joint that moves; give a robot with joints that turn or slide",
    ),
    (
        'type="revolute"',
        'type="ball"',
        "robot.directives has no joint that moves; give a robot with joints that turn or slide",
    ),
    (
        "<lower>-1</lower><upper>1</upper>",
        "<lower>0.5</lower><upper>0.5</upper>",
        "joint 'shoulder' has the limits 0.5 and 0.5, so it cannot move; correct its model, or "
        "name the other joints in robot.joints",
    ),
    (
        "<parent>upper_arm</parent>",
        "<parent>uper_arm</parent>",
        "robot.directives cannot be loaded: error: parent frame with name[uper_arm] specified by "
        "joint with name[elbow] not found in model with name[small].",
    ),
]


@pytest.mark.parametrize(("there", "instead", "message"), BROKEN)
def test_a_mistake_in_a_model(babble, tmp_path, there, instead, message):
    assert there in MODEL
    (line,) = babble(model=MODEL.replace(there, instead)).splitlines()
    assert line.startswith(f"selftouch: {message}".replace("HERE", str(tmp_path)))
    assert not (tmp_path / "run").exists()


UNREADABLE = "directives HERE/small.dmd.yaml cannot be read: "


@pytest.mark.parametrize(
    ("directives", "message"),
    [
        ("directives: [", UNREADABLE + "yaml-cpp: error at line 1, column 1: end of sequence"),
        ("directives: {}", UNREADABLE + "HERE/small.dmd.yaml:1:1: YAML node of type Mapping"),
        ("direktives: []", UNREADABLE + "HERE/small.dmd.yaml:1:1: YAML node of type Mapping"),
        (
            "directives: []",
            "skins.torso.link is 'torso'; the robot has no such link: it has world",
        ),
        (
            "directives:\n- add_model: {name: small, file: package://mine/small.sdf}\n",
            "robot.directives leaves 'base' free to float; weld it to the world (add_weld)",
        ),
        (
            "directives:\n- add_model: {name: small, file: small.stp}\n",
            "file in HERE/small.dmd.yaml is 'small.stp', and HERE/small.stp does not exist; "
            "correct the path",
        ),
    ],
)
def test_a_mistake_in_the_directives(babble, tmp_path, directives, message):
    (line,) = babble(directives=directives).splitlines()
    assert line.startswith(f"selftouch: {message}".replace("HERE", str(tmp_path)))
    assert not (tmp_path / "run").exists()


def test_what_never_reaches_ends_after_a_bounded_number_of_steps(babble, tmp_path):
    # The elbow turns about the shoulder, 10 cm wide, and stays 10 cm away from the torso.
    *_, line = babble("{touching: {tip: {frame: forearm}}}").splitlines()
    assert line == (
        "selftouch: babbling touched nothing in 2002944 steps; see what can touch what with "
        "`selftouch robot EXPERIMENT --show`, or make babbling.step_size larger"
    )
    # What is left does not refuse the robot that was corrected.
    babble(model=MODEL.replace("-0.22 -0.1", "-0.23 -0.1"), status=0)
    assert list((tmp_path / "run").rglob("*.parquet"))


def test_what_drake_itself_refuses_is_one_line(monkeypatch, babble, tmp_path):
    def refuse(self):
        raise RuntimeError("MultibodyPlant::Finalize():\n the tree is upside down.")

    monkeypatch.setattr("selftouch_drake.robot.World.robot", property(refuse))
    assert babble() == (
        "selftouch: robot.directives holds a robot that Drake refuses: MultibodyPlant::Finalize(): "
        "the tree is upside down.\n"
    )
    assert not (tmp_path / "run").exists()
