"""Files that mean the same robot give the same robot; those that mean another one do not.

One small arm is written in many ways. What must not matter leaves poses, limits, efforts and pairs
as they are; what must matter changes them, or is refused in one line.
"""

import itertools

import numpy as np
import pytest
import trimesh
from arms import ARM, Arm, Link, Mjcf, sdf, urdf
from beside_mujoco import Loaded
from pydrake.geometry import Role

from selftouch_drake.experiment import ExperimentError
from selftouch_drake.robot.pairs import own_geometries

LINKS = ("l1", "l2", "l3", "hand", "side")
BASE = ("base", np.zeros(3), [1, 0, 0, 0])
EXTRAS = (
    "<light/><camera name='c'/><site name='s' size='.01'/>"
    "<!-- a comment --><geom type='sphere' size='.2' contype='0' conaffinity='0' mass='0'/>"
)
SECTIONS = (
    "<option timestep='0.001'/><visual/><statistic extent='1'/><size nuserdata='3'/>"
    "<asset><texture name='t' type='skybox' builtin='flat' width='8' height='8'/></asset>"
    "<custom><numeric name='n' data='1'/></custom>"
    "<sensor><jointpos joint='j1'/></sensor><keyframe><key qpos='0 0 0 0 0'/></keyframe>"
)


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


def read(content, folder, suffix, *, base="base", joints=None):
    file = folder / f"arm{suffix}"
    file.write_text(content)
    welds = [] if suffix == ".xml" else [(base, *BASE[1:])]
    return Loaded(file, folder, joints=joints, welds=welds)


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    """The arm as its URDF says."""
    return read(urdf(), tmp_path_factory.mktemp("usual"), ".urdf")


def differences(one, other, rename=str):
    """What differs between two robots, whose names may differ too, in words."""
    found = []
    names = [rename(joint) for joint in one.joints]
    if sorted(names) != sorted(other.joints):
        return [f"joints {other.joints}"]
    order = [names.index(joint) for joint in other.joints]
    for what in ("lower", "upper"):
        if not np.allclose(getattr(one, what)[order], getattr(other, what), atol=1e-9):
            found.append(what)
    if {rename(j): round(e, 9) for j, e in one.efforts.items()} != {
        joint: round(effort, 9) for joint, effort in other.efforts.items()
    }:
        found.append("efforts")
    q = one.somewhere(5)
    X, Y = one.poses(q), other.poses(q[:, order])
    for number, link in enumerate(one.links):
        there = other.links.index(rename(link))
        if not np.allclose(X[:, number], Y[:, there], atol=1e-7):
            found.append(f"pose of {link}")
            break
    renamed = {frozenset(map(rename, pair)) for pair in one.pairs()[0]}
    if renamed != other.pairs()[0]:
        found.append("pairs")
    theirs = boxes(other)
    for link, shapes in boxes(one).items():
        there = theirs.get(rename(link), np.empty((0, 15)))
        if shapes.shape != there.shape or not np.allclose(shapes, there, atol=1e-7):
            found.append(f"geometry of {link}")
    return found


def boxes(robot):
    """The boxes of each link: rows of size and pose, sorted."""
    own = own_geometries(robot.plant, robot.scene_graph)
    inspector = robot.scene_graph.model_inspector()
    return {
        robot.plant.get_body(index).name(): np.array(
            sorted(
                [
                    *inspector.GetShape(geometry).size(),
                    *inspector.GetPoseInFrame(geometry).GetAsMatrix34().ravel().round(9),
                ]
                for geometry in geometries
            )
        )
        for index, geometries in own.items()
    }


SAME_MJCF = {
    **{
        f"{turned}, {unit}": Mjcf(turned=turned, unit=unit)
        for turned, unit in itertools.product(
            ("quat", "axisangle", "xyaxes", "euler"), ("radian", "degree")
        )
    },
    **{
        f"euler {order}": Mjcf(turned="euler", unit="degree", order=order)
        for order in ("zyx", "XYZ", "ZXZ", "yxz")
    },
    **{
        f"defaults {where}, {unit}": Mjcf(defaults=where, unit=unit)
        for where, unit in itertools.product(
            ("main", "named", "childclass", "inherited", "nested", "overridden"),
            ("radian", "degree"),
        )
    },
    "frames": Mjcf(frames=True, turned="euler"),
    "frames and childclass": Mjcf(frames=True, defaults="childclass"),
    "geometries by their ends": Mjcf(ends=True),
    "no names of geometries": Mjcf(names=False),
    "bodies in another order": Mjcf(backwards=True),
    "lights, cameras, sites": Mjcf(in_bodies=EXTRAS),
    "sections without effect": Mjcf(head=SECTIONS),
    "a second compiler": Mjcf(head="<compiler boundmass='0'/>"),
    "the unit in a later compiler": Mjcf(unit="radian", compiler="", foot="<compiler/>"),
    "limits said to be limits": Mjcf(in_joints={"j1": "limited='true'"}),
    "no automatic limits": Mjcf(
        compiler="autolimits='false'",
        in_joints={f"j{k}": "limited='true'" for k in range(1, 6)},
    ),
    "gear": Mjcf(motors="<motor joint='{joint}' gear='10' ctrlrange='-.7 .7'/>"),
    "force range": Mjcf(motors="<position joint='{joint}' forcerange='-{effort} 3'/>"),
    "two actuators": Mjcf(motors=2 * "<motor joint='{joint}' ctrlrange='-3.5 3.5'/>"),
    "general": Mjcf(motors="<general joint='{joint}' gainprm='7' ctrlrange='-1 1'/>"),
    "a force range of zero": Mjcf(
        motors="<motor joint='{joint}' forcerange='0 0' ctrlrange='-{effort} {effort}'/>"
    ),
    "limits of joints' forces": Mjcf(
        motors="", in_joints={f"j{k}": "actuatorfrcrange='-7 7'" for k in range(1, 6)}
    ),
    "an equality that is off": Mjcf(
        foot="<equality><joint joint1='j1' joint2='j2' active='false'/></equality>"
    ),
    "the main class by a name of its own": Mjcf(
        head="<default class='own'><site size='.01'/></default>",
        in_joints={"j1": "class='own'"},
    ),
    "bits that all share": Mjcf(
        in_geoms=dict.fromkeys(("l1", "l2", "hand"), "contype='3' conaffinity='1'")
    ),
}


@pytest.mark.parametrize("how", SAME_MJCF)
def test_mjcf_of_the_same_arm(how, usual, tmp_path):
    assert differences(usual, read(SAME_MJCF[how].of(), tmp_path, ".xml")) == []


def renamed(name):
    return f"my_{name}"


SAME_OTHERS = {
    "links in another order": (urdf(backwards=True), ".urdf", str),
    "names": (urdf(rename=renamed), ".urdf", renamed),
    "extras of URDF": (
        urdf(
            more="<!-- c --><material name='m'><color rgba='1 0 0 1'/></material>"
            "<gazebo reference='l1'><selfCollide>true</selfCollide></gazebo>",
            in_links="<visual><geometry><sphere radius='.1'/></geometry></visual>",
        ),
        ".urdf",
        str,
    ),
    "transmissions": (
        urdf(
            more="".join(
                f"<transmission name='t{k}'><type>transmission_interface/SimpleTransmission</type>"
                f"<joint name='j{k}'/><actuator name='motor'/></transmission>"
                for k in range(1, 6)
            )
        ),
        ".urdf",
        str,
    ),
    "SDFormat": (sdf(), ".sdf", str),
    "SDFormat in another order": (sdf(backwards=True), ".sdf", str),
    "extras of SDFormat": (sdf(more="<frame name='f' attached_to='l1'/>"), ".sdf", str),
}


@pytest.mark.parametrize("how", SAME_OTHERS)
def test_urdf_and_sdformat_of_the_same_arm(how, usual, tmp_path):
    content, suffix, rename = SAME_OTHERS[how]
    loaded = read(content, tmp_path, suffix, base=rename("base"))
    assert differences(usual, loaded, rename) == []


def test_mjcf_in_parts_in_folders(usual, tmp_path):
    content = Mjcf(defaults="childclass").of()
    head, rest = content.split("<worldbody>")
    world, foot = rest.split("</worldbody>")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "body.xml").write_text(f"<mujocoinclude>{world}</mujocoinclude>")
    (tmp_path / "parts" / "defaults.xml").write_text(
        "<mujoco>" + head[head.index("<default>") :] + "</mujoco>"
    )
    main = (
        "<mujoco model='arm'><compiler angle='radian'/><include file='parts/defaults.xml'/>"
        f"<worldbody><include file='parts/body.xml'/></worldbody>{foot}"
    )
    assert differences(usual, read(main, tmp_path, ".xml")) == []


def with_meshes(folder, *, scale, compiler, file):
    """The arm with meshes instead of boxes."""
    size = np.array(Link.box) / scale
    path = folder / file
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box(size).export(path)
    mesh = f"<mesh name='m' file='{path.name}' scale='{scale} {scale} {scale}'/>"
    head = f"{compiler}<asset>{mesh}</asset>"
    content = Mjcf(head=head).of()
    return content.replace("type='box'", "type='mesh' mesh='m'")


@pytest.mark.parametrize(
    ("scale", "compiler", "file"),
    [
        (1.0, "", "box.stl"),
        (0.001, "<compiler meshdir='meshes'/>", "meshes/box.stl"),
        (0.01, "<compiler assetdir='meshes'/><compiler meshdir='meshes'/>", "meshes/box.obj"),
        (1.0, "<compiler meshdir='meshes'/><compiler meshdir='other'/>", "other/box.stl"),
    ],
)
def test_scale_and_folders_of_meshes(scale, compiler, file, tmp_path):
    content = with_meshes(tmp_path, scale=scale, compiler=compiler, file=file)
    loaded = read(content, tmp_path, ".xml")
    inspector = loaded.scene_graph.model_inspector()
    meshes = [inspector.GetConvexHull(g) for g in inspector.GetAllGeometryIds(Role.kProximity)]
    for hull in filter(None, meshes):
        points = np.array([hull.vertex(k) for k in range(hull.num_vertices())])
        np.testing.assert_allclose(np.ptp(points, axis=0), Link.box, atol=1e-7)
    assert sum(hull is not None for hull in meshes) >= 6


OTHER_ARMS = {
    "an axis": (ARM.but("l2", axis=(0.0, 1.0, 0.0)), "pose"),
    "the sign of an axis": (ARM.but("hand", axis=(0.0, -1.0, 0.0)), "pose"),
    "the place of a link": (ARM.but("l3", place=(0.0, 0.01, 0.3)), "pose"),
    "how a link is turned": (ARM.but("l1", rpy=(0.2, 0.3, 0.0)), "pose"),
    "a limit": (ARM.but("l3", limits=(-0.1, 0.21)), "upper"),
    "an effort": (ARM.but("side", effort=6.0), "efforts"),
    "a size": (ARM.but("side", box=(0.05, 0.05, 0.3)), "geometry"),
    "a link's parent": (ARM.but("side", parent="l2"), "pose"),
    "one joint less": (Arm(ARM.links[:-1]), "joints"),
}


@pytest.mark.parametrize(
    ("how", "suffix"),
    [
        *itertools.product(OTHER_ARMS, [".urdf", ".xml"]),
        # Drake takes four times as long to read SDFormat.
        ("an axis", ".sdf"),
        ("how a link is turned", ".sdf"),
        ("a limit", ".sdf"),
        ("an effort", ".sdf"),
    ],
)
def test_another_arm_is_another_arm(how, suffix, usual, tmp_path):
    arm, what = OTHER_ARMS[how]
    content = {".urdf": urdf, ".sdf": sdf, ".xml": Mjcf(defaults="nested", unit="degree").of}
    loaded = read(content[suffix](arm), tmp_path, suffix)
    assert any(what in difference for difference in differences(usual, loaded))


OTHER_MJCF = {
    "radians taken for degrees": (Mjcf().of().replace("'radian'", "'degree'"), "lower"),
    "no unit": (Mjcf().of().replace("angle='radian'", ""), "lower"),
    "no limit": (Mjcf(in_joints={"j1": "limited='false'"}).of(), "lower"),
    "a range of no width": (Mjcf().of(ARM.but("l1", limits=(0.0, 0.0))), "lower"),
    "joints away from their bodies": (Mjcf(in_joints={"j2": "pos='0 .1 0'"}).of(), "pose"),
    "an angle at rest": (Mjcf(in_joints={"j2": "ref='.5'"}).of(), "pose"),
    "an exclusion": (
        Mjcf(foot="<contact><exclude body1='hand' body2='base'/></contact>").of(),
        "pairs",
    ),
    "bits that never meet": (Mjcf(in_geoms={"hand": "contype='2' conaffinity='4'"}).of(), "pairs"),
    "bits of all links": (
        Mjcf(in_geoms=dict.fromkeys(LINKS, "contype='1' conaffinity='0'")).of(),
        "pairs",
    ),
    "a geometry that is only seen": (
        Mjcf(in_geoms={"hand": "contype='0' conaffinity='0'"}).of(),
        "pairs",
    ),
    "a pair that is excluded by bits": (
        Mjcf(
            in_geoms=dict.fromkeys(LINKS, "contype='2' conaffinity='4'"),
            foot="<contact><pair geom1='hand_box' geom2='l1_box'/></contact>",
        ).of(),
        "pairs",
    ),
    "a pair of which one is only seen otherwise": (
        Mjcf(
            in_geoms={"hand": "contype='0' conaffinity='0'"},
            foot="<contact><pair geom1='hand_box' geom2='l1_box'/></contact>",
        ).of(),
        "pairs",
    ),
}


@pytest.mark.parametrize("how", OTHER_MJCF)
def test_mjcf_of_another_arm(how, usual, tmp_path):
    content, what = OTHER_MJCF[how]
    found = differences(usual, read(content, tmp_path, ".xml"))
    assert any(what in difference for difference in found), found


MIMIC = "<mimic joint='j1' multiplier='2'/>"
REFUSED = {
    "mimic of URDF": (
        urdf(in_joints={"j4": MIMIC}),
        ".urdf",
        "'j4' follows 'j1' (<mimic>); name the joints that move on their own, as in joints: "
        "[j1, j2, j3, j5]",
    ),
    "mimic of SDFormat": (
        sdf(
            in_axis={
                "j4": "<mimic joint='j1'><multiplier>1</multiplier><offset>0</offset>"
                "<reference>0</reference></mimic>"
            }
        ),
        ".sdf",
        "'j4' follows 'j1'",
    ),
    "a joint that follows": (
        Mjcf(foot="<equality><joint joint1='j4' joint2='j1'/></equality>").of(),
        ".xml",
        "'j4' follows 'j1' (<equality>)",
    ),
    "a joint that is held": (
        Mjcf(foot="<equality><joint joint1='j4'/></equality>").of(),
        ".xml",
        "'j4' is held",
    ),
    "connect": (
        Mjcf(foot="<equality><connect body1='hand' body2='side' anchor='0 0 0'/></equality>").of(),
        ".xml",
        "<connect> of 'hand' and 'side' closes a loop between bodies",
    ),
    "weld": (
        Mjcf(foot="<equality><weld body1='hand' body2='side'/></equality>").of(),
        ".xml",
        "closes a loop",
    ),
    "a ball joint": (
        Mjcf()
        .of()
        .replace("<joint name='j5'", "<joint name='j5' type='ball'")
        .replace("type='ball' axis='1 0 0' range='-1 1.5'", "type='ball'"),
        ".xml",
        "joint 'j5' is a ball joint",
    ),
    "screw": (sdf(kinds={"j4": "screw"}), ".sdf", "joint 'j4' is a screw"),
    "universal": (
        sdf(kinds={"j4": "universal"}).replace(
            "</axis></joint><link name='side'", "</axis><axis2/></joint><link name='side'"
        ),
        ".sdf",
        "joint 'j4' is a universal joint",
    ),
    "gearbox": (sdf(kinds={"j4": "gearbox"}), ".sdf", "gearbox"),
    "planar": (urdf(kinds={"j4": "planar"}), ".urdf", "joint 'j4' is a planar joint"),
    "floating": (urdf(kinds={"j4": "floating"}), ".urdf", "'hand' free to float"),
    "limits upside down": (
        urdf(ARM.but("hand", limits=(1.0, -1.0))),
        ".urdf",
        "joint 'j4' has the lower limit 1 above the upper limit -1",
    ),
    "a limit that is no number": (
        urdf().replace("upper='1.5'", "upper='much'"),
        ".urdf",
        "joint 'j1' has the upper 'much' in <limit>",
    ),
    "no limits but a limit": (
        urdf().replace("lower='-1.0' upper='1.5'", ""),
        ".urdf",
        "has the limits 0 and 0, so it cannot move",
    ),
    "xacro": (urdf().replace("effort='7.0'", "effort='${most}'"), ".urdf", "is xacro"),
    "a joint limited to nothing": (
        Mjcf(in_joints={"j1": "limited='true'"}).of(ARM.but("l1", limits=(0.0, 0.0))),
        ".xml",
        "joint 'j1' is limited from 0 to 0, which MuJoCo refuses",
    ),
    "height fields": (
        Mjcf(in_bodies="<geom type='hfield' hfield='h'/>").of(),
        ".xml",
        "was lost when Drake read it",
    ),
    **{
        kind: (Mjcf(in_bodies=f"<{kind} name='x'/>").of(), ".xml", f"<{kind}> 'x'")
        for kind in ("replicate", "attach", "composite", "flexcomp")
    },
    "a mesh that is moved": (
        Mjcf(head="<asset><mesh name='m' file='m.obj' refpos='1 0 0'/></asset>").of(),
        ".xml",
        "mesh 'm' has refpos '1 0 0'",
    ),
    "a class that nobody describes": (
        Mjcf(in_joints={"j2": "class='elbow'"}).of(),
        ".xml",
        "<joint> 'j2' has the class 'elbow', which no <default> describes",
    ),
    "a number that is none": (
        Mjcf(in_joints={"j2": "ref='half'"}).of(),
        ".xml",
        "is not readable MJCF (could not convert string to float: 'half')",
    ),
    "too few numbers": (
        Mjcf(in_geoms={"hand": "euler='1 2'"}).of(),
        ".xml",
        "is not readable MJCF ('1 2' has 2 numbers, not 3)",
    ),
    "a place of one number": (
        Mjcf().of().replace("<body name='l1' pos='0 0 0.29999999999999999'", "<body pos='1'"),
        ".xml",
        "is not readable MJCF ('1' has 1 numbers, not 3)",
    ),
    "an actuator of nothing": (
        Mjcf(motors="<motor joint='{joint}_'/>").of(),
        ".xml",
        "names the joint 'j1_', which is not there",
    ),
    "a ball with two ends": (
        Mjcf(in_bodies="<geom size='.1' fromto='0 0 0 0 0 1'/>").of(),
        ".xml",
        "is a sphere, which has no two ends",
    ),
    "an exclusion of nobody": (
        Mjcf(foot="<contact><exclude body1='hand' body2='lid'/></contact>").of(),
        ".xml",
        "<exclude> names the body 'lid', which is not there",
    ),
    "a shape that is fitted": (
        Mjcf(
            head="<asset><mesh name='m' vertex='0 0 0 1 0 0 0 1 0 0 0 1'/></asset>",
            in_geoms={"hand": "mesh='m'"},
        ).of(),
        ".xml",
        "fits a box to a mesh",
    ),
}


@pytest.mark.parametrize("how", REFUSED)
def test_what_cannot_be_read_is_refused_in_one_line(how, tmp_path):
    content, suffix, line = REFUSED[how]
    with pytest.raises(ExperimentError) as refusal:
        read(content, tmp_path, suffix).pairs()
    assert line in str(refusal.value)
    assert "\n" not in str(refusal.value)
