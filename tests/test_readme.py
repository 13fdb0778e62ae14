"""The commands and files of the README and the tutorial work as printed."""

import itertools
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh
import yaml
from fenced import blocks

from selftouch_drake.cli import cli

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
# Enough that it comes to its end; the tutorial's own numbers take minutes.
SMALL = {
    "babbling": {"num_samples": 2000},
    "representation": {"num_targets": 60, "metric": "sensorimotor", "body_model": "off"},
    "execution": {"max_tries": 1},
    "evaluation": {"num_pairs": 1, "shape_metrics": []},
}
# Length and radius of each link, m, and the axis of the joint that carries the next one.
LINKS = {
    "base": (0.15, 0.06, "z"),
    "shoulder": (0.05, 0.05, "y"),
    "upper_arm": (0.4, 0.04, "z"),
    "elbow": (0.06, 0.035, "y"),
    "forearm": (0.2, 0.03, "z"),
    "wrist": (0.05, 0.025, "y"),
    "palm": (0.06, 0.02, "z"),
    "hand": (0.08, 0.02, ""),
}
LIMITS = {"z": 3.0, "y": 2.4}


def own_robot() -> str:
    """The steps in which a user's own robot is described."""
    return TUTORIAL.split("## 5. ")[1].split("\n## Where to go")[0]


def primitive(name: str, length: float, radius: float) -> str:
    return f'<cylinder length="{length:g}" radius="{radius}"/>'


def stl_in(folder: Path) -> Callable[[str, float, float], str]:
    """Writes the same cylinder as an STL file, in millimetres as CAD programs do."""

    def mesh(name: str, length: float, radius: float) -> str:
        file = folder / "meshes" / f"{name}.stl"
        file.parent.mkdir(exist_ok=True)
        trimesh.creation.cylinder(1e3 * radius, 1e3 * length, sections=24).export(file)
        return f'<mesh filename="meshes/{name}.stl" scale="0.001 0.001 0.001"/>'

    return mesh


def my_arm(geometry: Callable[[str, float, float], str]) -> str:
    """A URDF of an arm with seven revolute joints, each link a cylinder along its z axis."""
    parts, names = [], list(LINKS)
    for name, (length, radius, _) in LINKS.items():
        # A gap at either end, where the joints are.
        shape = geometry(name, length - 0.02, radius)
        place = f'<origin xyz="0 0 {length / 2}"/><geometry>{shape}</geometry>'
        parts.append(f"""
  <link name="{name}">
    <inertial><origin xyz="0 0 {length / 2}"/><mass value="0.5"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial>
    <visual>{place}</visual>
    <collision>{place}</collision>
  </link>""")
    for number, (parent, child) in enumerate(itertools.pairwise(names), 1):
        length, _, axis = LINKS[parent]
        xyz = {"z": "0 0 1", "y": "0 1 0"}[axis]
        limit = LIMITS[axis]
        parts.append(f"""
  <joint name="joint_{number}" type="revolute">
    <parent link="{parent}"/><child link="{child}"/>
    <origin xyz="0 0 {length}"/><axis xyz="{xyz}"/>
    <limit lower="{-limit}" upper="{limit}" effort="200" velocity="2"/>
  </joint>""")
    return f'<?xml version="1.0"?>\n<robot name="my_arm">{"".join(parts)}\n</robot>\n'


@pytest.fixture(params=["primitives", "stl"])
def folder(request, tmp_path, monkeypatch):
    """A folder with the tutorial's arm and files, in which commands run; no mesh is converted."""
    geometry = primitive if request.param == "primitives" else stl_in(tmp_path)
    (tmp_path / "my_arm.urdf").write_text(my_arm(geometry), encoding="utf-8")
    for text in blocks(own_robot(), "xml", "yaml"):
        name = re.match(r"(?:#|<!--) (\S+\.(?:yaml|sdf))", text)
        assert name is not None, "the first line of a file says its name"
        (tmp_path / name[1]).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path


def test_the_files_of_the_tutorial_describe_a_robot(folder, capfd):
    cli.main(["robot", "my_robot.yaml", "--set", yaml.safe_dump(SMALL)], standalone_mode=False)
    said = capfd.readouterr()
    assert "7 joints move" in said.out
    assert re.search(r"fingertip +on arm::hand +touches head, upper_arm", said.out)
    assert ("8 meshes to OBJ" in said.err) == (folder / "meshes").is_dir()


@pytest.mark.slow
def test_an_own_robot_goes_from_touches_to_motions(folder, capfd):
    for command in "".join(blocks(own_robot(), "")).splitlines():
        words = shlex.split(command, comments=True)[1:]
        if words[0] == "play":
            continue
        small = ["--set", yaml.safe_dump(SMALL)] if words[0] in ("robot", "run") else []
        if words[0] == "run":
            small += ["--out", "runs/my_robot"]
        capfd.readouterr()
        cli.main([*words, *small], standalone_mode=False)
        if words[0] == "plan":
            assert capfd.readouterr().out.startswith("route: 0 ")
    assert (folder / "runs" / "my_robot" / "report.html").is_file()


def test_the_arm_of_the_tutorial_is_there():
    shipped = (ROOT / "docs" / "examples" / "my_arm.urdf").read_text(encoding="utf-8")
    assert shipped == my_arm(primitive)


def test_the_readme_shows_the_experiment_of_the_tutorial():
    (experiment,) = blocks(README, "yaml")
    assert experiment in blocks(own_robot(), "yaml")
