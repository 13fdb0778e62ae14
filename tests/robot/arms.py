"""One small arm in words of its own, and the files that describe it in many ways.

A base, then four links in a row on joints that turn, turn, slide and turn, and a fifth beside the
second one. Each link carries a box, and the hand a cylinder as well.
"""

import dataclasses
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Link:
    """A link on a joint; lengths in m, angles in rad."""

    name: str
    parent: str
    place: tuple = (0.0, 0.0, 0.3)
    rpy: tuple = (0.0, 0.0, 0.0)
    joint: str = ""
    kind: str = "revolute"
    axis: tuple = (0.0, 0.0, 1.0)
    limits: tuple = (-1.0, 1.5)
    effort: float = 7.0
    box: tuple = (0.05, 0.05, 0.2)
    box_place: tuple = (0.0, 0.0, 0.15)
    box_rpy: tuple = (0.0, 0.0, 0.0)
    mass: float = 0.5


@dataclass(frozen=True)
class Arm:
    links: tuple = field(
        default_factory=lambda: (
            Link("l1", "base", joint="j1", rpy=(0.2, 0.0, 0.3), axis=(0.0, 0.0, 1.0)),
            Link("l2", "l1", joint="j2", axis=(0.3, 1.0, 0.2), box_rpy=(0.1, 0.2, 0.0)),
            Link(
                "l3", "l2", joint="j3", kind="prismatic", axis=(1.0, 0.0, 0.0), limits=(-0.1, 0.2)
            ),
            Link("hand", "l3", joint="j4", rpy=(0.0, 0.5, 0.0), axis=(0.0, 1.0, 0.0)),
            Link("side", "l1", joint="j5", place=(0.0, 0.2, 0.1), axis=(1.0, 0.0, 0.0)),
        )
    )

    def but(self, name, **changes):
        """The same arm with one link changed."""
        return Arm(
            tuple(
                dataclasses.replace(link, **changes) if link.name == name else link
                for link in self.links
            )
        )


ARM = Arm()


def text(values):
    return " ".join(f"{value:.17g}" for value in np.ravel(values))


#: What stands still, and carries the arm.
BASE = Link("base", "", place=(0.0, 0.0, 0.0), box_place=(0.0, 0.0, 0.1), mass=1.0)


def _elements(arm, of_link, of_joint, *, kinds, backwards):
    """Texts of the base, then of each link and its joint; the last one first if `backwards`."""
    elements = [of_link(BASE)]
    for link in arm.links:
        kind = (kinds or {}).get(link.joint, link.kind)
        elements += [of_link(link), of_joint(link, kind)]
    return "".join(reversed(elements) if backwards else elements)


def urdf(arm=ARM, *, rename=str, backwards=False, more="", in_links="", in_joints=None, kinds=None):
    """The arm as URDF; `in_joints` adds text to joints by name, `kinds` changes theirs."""

    def of_link(link):
        inertia = "ixx='0.01' iyy='0.01' izz='0.01' ixy='0' ixz='0' iyz='0'"
        inertial = f"<inertial><mass value='{link.mass}'/><inertia {inertia}/></inertial>"
        return (
            f"<link name='{rename(link.name)}'>{inertial if link.mass else ''}<collision>"
            f"<origin xyz='{text(link.box_place)}' rpy='{text(link.box_rpy)}'/>"
            f"<geometry><box size='{text(link.box)}'/></geometry></collision>{in_links}</link>"
        )

    def of_joint(link, kind):
        low, high = link.limits
        return (
            f"<joint name='{rename(link.joint)}' type='{kind}'>"
            f"<parent link='{rename(link.parent)}'/><child link='{rename(link.name)}'/>"
            f"<origin xyz='{text(link.place)}' rpy='{text(link.rpy)}'/>"
            f"<axis xyz='{text(link.axis)}'/>"
            f"<limit lower='{low}' upper='{high}' effort='{link.effort}' velocity='2'/>"
            f"{(in_joints or {}).get(link.joint, '')}</joint>"
        )

    body = _elements(arm, of_link, of_joint, kinds=kinds, backwards=backwards)
    return f"<robot name='arm'>{more}{body}</robot>"


def sdf(arm=ARM, *, backwards=False, more="", in_axis=None, kinds=None, head=""):
    """The arm as SDFormat; `in_axis` adds text to the axes of joints by name."""

    def of_link(link):
        moments = "<ixx>0.01</ixx><iyy>0.01</iyy><izz>0.01</izz>"
        pose = f"<pose relative_to='{link.parent}'>{text(link.place)} {text(link.rpy)}</pose>"
        return (
            f"<link name='{link.name}'>{pose if link.parent else ''}"
            f"<inertial><mass>{link.mass}</mass><inertia>{moments}</inertia></inertial>"
            f"<collision name='c'><pose>{text(link.box_place)} {text(link.box_rpy)}</pose>"
            f"<geometry><box><size>{text(link.box)}</size></box></geometry></collision></link>"
        )

    def of_joint(link, kind):
        low, high = link.limits
        return (
            f"<joint name='{link.joint}' type='{kind}'><parent>{link.parent}</parent>"
            f"<child>{link.name}</child><axis><xyz>{text(link.axis)}</xyz><limit><lower>{low}</lower>"
            f"<upper>{high}</upper><effort>{link.effort}</effort></limit>"
            f"{(in_axis or {}).get(link.joint, '')}</axis></joint>"
        )

    body = _elements(arm, of_link, of_joint, kinds=kinds, backwards=backwards)
    return f"<sdf version='1.11'>{head}<model name='arm'>{body}{more}</model></sdf>"


@dataclass(frozen=True)
class Mjcf:
    """How the arm is written as MJCF.

    `defaults` says where what all joints and geometries share is written: at each of them, in the
    main class, in a class that they name, in one of their parents' `childclass`, or in one that
    inherits it. `turned` is the attribute of orientations.
    """

    unit: str = "radian"
    turned: str = "quat"
    order: str = "xyz"
    defaults: str = "written"
    frames: bool = False
    ends: bool = False
    names: bool = True
    backwards: bool = False
    compiler: str = ""
    head: str = ""
    foot: str = ""
    in_bodies: str = ""
    in_joints: dict = field(default_factory=dict)
    in_geoms: dict = field(default_factory=dict)
    motors: str = "<motor joint='{joint}' ctrlrange='-{effort} {effort}'/>"

    def of(self, arm=ARM):
        """The text of the file."""
        motors = "".join(
            self.motors.format(joint=link.joint, effort=link.effort) for link in arm.links
        )
        order = f"eulerseq='{self.order}'"
        return (
            f"<mujoco model='arm'><compiler angle='{self.unit}' {order} {self.compiler}/>"
            f"{self.head}{self._default_section()}<worldbody>{self._base(arm)}</worldbody>"
            f"<actuator>{motors}</actuator>{self.foot}</mujoco>"
        )

    def _default_section(self):
        joint = f"<joint range='{self._angles((-1.0, 1.5))}' axis='0 1 0'/>"
        geom = "<geom type='box' size='.025 .025 .1' pos='0 0 .15' mass='0.5'/>"
        shared = joint + geom
        return {
            "written": "",
            "main": f"<default>{shared}</default>",
            "named": f"<default><default class='arm'>{shared}</default></default>",
            "childclass": f"<default><default class='arm'>{shared}</default></default>",
            "inherited": f"<default>{shared}<default class='arm'><site size='.01'/></default>"
            "</default>",
            "nested": f"<default><default class='all'>{joint}<default class='arm'>{geom}</default>"
            "</default></default>",
            "overridden": "<default><joint axis='1 0 0' range='0 1'/><geom type='sphere' size='1'/>"
            f"<default class='arm'>{shared}</default></default>",
        }[self.defaults]

    def _class(self):
        return " class='arm'" if self.defaults in ("named", "overridden") else ""

    def _base(self, arm):
        below = (
            " childclass='arm'" if self.defaults in ("childclass", "inherited", "nested") else ""
        )
        geom = "<geom type='box' size='.025 .025 .1' pos='0 0 .1' mass='1'/>"
        return f"<body name='base'{below}>{geom}{self._children(arm, 'base')}</body>"

    def _children(self, arm, parent):
        bodies = [self._body(arm, link) for link in arm.links if link.parent == parent]
        return "".join(reversed(bodies) if self.backwards else bodies)

    def _body(self, arm, link):
        pose = f"pos='{text(link.place)}' {self._turn(link.rpy)}"
        inside = (
            self._joint(link) + self._geom(link) + self.in_bodies + self._children(arm, link.name)
        )
        if self.frames:
            return f"<frame {pose}><body name='{link.name}'>{inside}</body></frame>"
        return f"<body name='{link.name}' {pose}>{inside}</body>"

    def _joint(self, link):
        more = self.in_joints.get(link.joint, "")
        kind = " type='slide'" if link.kind == "prismatic" else ""
        given = ""
        if self.defaults == "written" or link.axis != (0.0, 1.0, 0.0):
            given += f" axis='{text(link.axis)}'"
        if self.defaults == "written" or link.limits != (-1.0, 1.5):
            limits = text(link.limits) if kind else self._angles(link.limits)
            given += f" range='{limits}'"
        return f"<joint name='{link.joint}'{kind}{given}{self._class()} {more}/>"

    def _geom(self, link):
        more = self.in_geoms.get(link.name, "")
        name = f"name='{link.name}_box'" if self.names else ""
        size = np.array(link.box) / 2
        turned = self._turn(link.box_rpy) if any(link.box_rpy) else ""
        is_usual = (link.box, link.box_place, link.mass) == (Link.box, Link.box_place, Link.mass)
        if self.ends and not any(link.box_rpy):
            x, y, z = link.box_place
            ends = ((x, y, z + half) for half in (size[2], -size[2]))
            given = f"type='box' size='{size[0]}' fromto='{text(list(ends))}' mass='{link.mass}'"
        elif self.defaults == "written" or not is_usual:
            given = (
                f"type='box' size='{text(size)}' pos='{text(link.box_place)}' mass='{link.mass}'"
            )
        else:
            given = ""
        return f"<geom {name} {given} {turned}{self._class()} {more}/>"

    def _angles(self, radians):
        return text(np.degrees(radians) if self.unit == "degree" else radians)

    def _turn(self, rpy):
        """URDF's roll, pitch and yaw: turns about fixed axes."""
        turn = Rotation.from_euler("xyz", rpy)
        matrix = turn.as_matrix()
        rotvec = turn.as_rotvec()
        angle = np.linalg.norm(rotvec)
        axis = rotvec / angle if angle else np.array([1.0, 0, 0])
        intrinsic = self.order.islower()
        euler = turn.as_euler(self.order.upper() if intrinsic else self.order.lower())
        value = {
            "quat": lambda: text(turn.as_quat(scalar_first=True)),
            "axisangle": lambda: f"{text(2 * axis)} {self._angles([angle])}",
            "xyaxes": lambda: text([matrix[:, 0], matrix[:, 1] + 0.3 * matrix[:, 0]]),
            "euler": lambda: self._angles(euler),
        }[self.turned]()
        return f"{self.turned}='{value}'"
