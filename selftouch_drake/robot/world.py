"""The world of an experiment; each part is built at its first use."""

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from pydrake.geometry import HydroelasticContactRepresentation, QueryObject, SceneGraph

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.broadphase import BroadPhase
from selftouch_drake.robot.collisions import CollisionCheck
from selftouch_drake.robot.contact import SensorModel, Touches
from selftouch_drake.robot.faces import Faces
from selftouch_drake.robot.hydroelastic import RigidTouchers
from selftouch_drake.robot.imperfections import ImperfectSkins, slip
from selftouch_drake.robot.robot import JointLimits, MakeRobot, Robot
from selftouch_drake.robot.skins import SkinModel, make_skins


class Postures:
    """Drake's view of a robot at one configuration after another; arguments as in `MakeRobot`."""

    def __init__(self, experiment: Experiment, skins: Sequence[SkinModel]):
        scene_graph = SceneGraph()
        self.robot = MakeRobot(experiment, skins, scene_graph, soft=True)
        self._plant, self._scene_graph = self.robot.plant, scene_graph
        self._plant_context = self._plant.CreateDefaultContext()
        self._context = scene_graph.CreateDefaultContext()
        source_id = self._plant.get_source_id()
        assert source_id is not None  # MakeRobot registers the plant
        self._poses = scene_graph.get_source_pose_port(source_id)

    def query(self, q: np.ndarray) -> QueryObject:
        """Drake's query object at `(J,)` q; good until the next call."""
        self._plant.SetPositions(self._plant_context, q)
        poses = self._plant.get_geometry_pose_output_port().Eval(self._plant_context)
        self._poses.FixValue(self._context, poses)
        return self._scene_graph.get_query_output_port().Eval(self._context)


class ContactProbe:
    """Evaluates hydroelastic contact at given configurations: the paper's S = phi(f(M)).

    `hydroelastic` computes contact with rigid touchers, in a tenth of Drake's time. Drake computes
    contact between skins.
    """

    def __init__(self, experiment: Experiment, skins: Sequence[SkinModel]):
        self.robot = MakeRobot(experiment, skins, SceneGraph(), soft=False)
        self._described = experiment, skins
        self.impossible = CollisionCheck(self.robot).impossible
        self._imperfections = ImperfectSkins.of(experiment, skins)

    def sensations(self, q: np.ndarray) -> np.ndarray:
        """`(N, S)` N, the sensations at `q` `(N, J)`; zero rows without a touch."""
        return self.touches(q).sensation

    def touches(self, q: np.ndarray) -> Touches:
        """The sensations at `q` `(N, J)`, and the contacts that cause them."""
        rows, touches = self._of_perfect_skins(q)
        sensation = np.zeros((len(q), touches.sensation.shape[1]))
        sensation[rows] = touches.sensation
        if self._imperfections is not None:
            sensation = self._imperfections(sensation, q)
        return dataclasses.replace(touches, sensation=sensation, row=rows[touches.row])

    def felt_rows(self, q: np.ndarray) -> tuple[np.ndarray, Touches]:
        """The rows of `q` `(N, J)` with a touch, and their touches.

        Where touches are rare this takes a fraction of the time of `touches`, which has a row of
        readings for each configuration.
        """
        if self._imperfections is None:
            rows, touches = self._of_perfect_skins(q)
        else:
            rows, touches = np.arange(len(q)), self.touches(q)
        felt = np.flatnonzero(touches.sensation.any(axis=1))
        return rows[felt], touches.of_rows(felt)

    def touching(self, q: np.ndarray) -> tuple[np.ndarray, Touches | None]:
        """As `felt_rows`; without touches where it costs less to ask later for those that matter.

        So it does if a touching posture may be impossible, and if no skin has to be read for
        seeing whether it is touched.
        """
        rigid = self._imperfections is None and self._rigid_touchers.is_rigid.all()
        if not rigid or not self.robot.rigid_pairs:
            return self.felt_rows(q)
        rows, touches = self._of_perfect_skins(q, once=True)
        return rows[touches.sensation.any(axis=1)], None

    def _of_perfect_skins(self, q: np.ndarray, *, once: bool = False) -> tuple[np.ndarray, Touches]:
        """The rows of `q` with something near a skin, and the touches of perfect skins there.

        `once` is as in `RigidTouchers.touches`.
        """
        near = self._screen.near(q)
        rows = np.flatnonzero(near.any(axis=1))
        near, q = near[rows], q[rows]
        X_WL = self.robot.kinematics.poses(q)
        touches = self._rigid_touchers.touches(X_WL, near, once=once)
        if not self._rigid_touchers.is_rigid.all():
            touches = touches.and_also(self._of_soft_touchers(q, X_WL, near))
        return rows, touches

    def _of_soft_touchers(self, q: np.ndarray, X_WL: np.ndarray, near: np.ndarray) -> Touches:
        """Touches of skins by skins, computed by Drake for near pairs."""
        postures, sensor = self._soft_postures
        skins = frozenset(s.geometry_id for s in postures.robot.skins)
        surfaces = [
            (int(row), Faces.of(surface))
            for row in np.flatnonzero(near[:, ~self._rigid_touchers.is_rigid].any(axis=1))
            for surface in postures.query(q[row]).ComputeContactSurfaces(
                HydroelasticContactRepresentation.kPolygon
            )
            if surface.id_M() in skins and surface.id_N() in skins
        ]
        return sensor.touches(surfaces, X_WL[:, : len(self.robot.skins)])

    @cached_property
    def _screen(self) -> BroadPhase:
        return BroadPhase(self.robot)

    @cached_property
    def _rigid_touchers(self) -> RigidTouchers:
        return RigidTouchers(self.robot)

    @cached_property
    def _soft_postures(self) -> tuple[Postures, SensorModel]:
        postures = Postures(*self._described)
        return postures, SensorModel(postures.robot.skins, postures.robot.touchers)


class World:
    """Skins, contact without dynamics, and the limits of one experiment."""

    def __init__(self, experiment: Experiment):
        self.experiment = experiment

    @cached_property
    def skins(self) -> tuple[SkinModel, ...]:
        """The skins, each in the frame of its link; may be set to those that are known."""
        return make_skins(self.experiment)

    @property
    def receptor_skin(self) -> np.ndarray:
        """`(S,)` int8, the number of the skin that each reading comes from."""
        sizes = [skin.fields.num_receptors for skin in self.skins]
        return np.repeat(np.arange(len(sizes), dtype=np.int8), sizes)

    @cached_property
    def probe(self) -> ContactProbe:
        """Sensations at given configurations, without dynamics."""
        return ContactProbe(self.experiment, self.skins)

    @property
    def robot(self) -> Robot:
        """The robot, as the probe has it."""
        return self.probe.robot

    @cached_property
    def limits(self) -> JointLimits:
        """Limits of the robot and of its motions."""
        return JointLimits.of(self.robot, self.experiment.execution)

    @cached_property
    def slip(self) -> np.ndarray:
        """`(J,)` rad or m, by how much joints read more than their true position when they act."""
        return slip(self.experiment, self.robot.num_joints)
