"""What the skins feel at many configurations, without time: the paper's S = phi(f(M))."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from pydrake.geometry import HydroelasticContactRepresentation, QueryObject

from selftouch_drake.experiment import Experiment
from selftouch_drake.robot.collisions import CollisionCheck
from selftouch_drake.robot.contact import PressedFaces, Touches
from selftouch_drake.robot.imperfections import ImperfectSkins
from selftouch_drake.robot.screen import TouchScreen
from selftouch_drake.robot.skins import SkinModel
from selftouch_drake.robot.station import MakeKinematicStation, sensor_model


class ContactProbe:
    """Evaluates Drake's hydroelastic contact at given configurations, as the skins read it.

    Args:
        experiment: the experiment whose robot is probed.
        skins: its skins.
    """

    def __init__(self, experiment: Experiment, skins: Sequence[SkinModel]):
        station = MakeKinematicStation(experiment, skins)
        self._station = station
        self._context = station.diagram.CreateDefaultContext()
        self.robot = station.robot
        self._q = station.diagram.GetInputPort("q").FixValue(
            self._context, np.zeros(self.robot.num_joints)
        )
        self._query_port = station.diagram.GetOutputPort("query_object")
        self._sensor = sensor_model(station.robot)
        self._screen = TouchScreen(self.robot)
        self._collisions = CollisionCheck(self.robot)
        self._imperfections = ImperfectSkins.of(experiment, skins)

    def sensations(self, q: np.ndarray) -> np.ndarray:
        """`(N, S)` N, the sensations at `q` `(N, J)`; zero rows where nothing is touched."""
        return self.touches(q).sensation

    def touches(self, q: np.ndarray) -> Touches:
        """What is felt at `q` `(N, J)`, and the contacts behind it."""
        candidates = np.flatnonzero(self._screen.may_touch(q))
        faces = PressedFaces()
        for number, row in enumerate(candidates):
            surfaces = self.query(q[row]).ComputeContactSurfaces(
                HydroelasticContactRepresentation.kPolygon
            )
            self._sensor.gather(faces, number, surfaces)
        touches = self._sensor.touches(faces, self.robot.skin_positions(q[candidates]))
        sensation = np.zeros((len(q), self._sensor.num_receptors))
        sensation[candidates] = touches.sensation
        if self._imperfections is not None:
            sensation = self._imperfections(sensation, q)
        return dataclasses.replace(touches, sensation=sensation, row=candidates[touches.row])

    def collision_depth(self, q: np.ndarray) -> np.ndarray:
        """`(N,)` m, by how much rigid parts are deeper in each other than allowed at `q` `(N, J)`.

        0 where the posture is possible.
        """
        return self._collisions.depth(q, self.query)

    def query(self, q: np.ndarray) -> QueryObject:
        """Drake's query object at `(J,)` q; good until the next call."""
        # Asking for the data again is what tells the context that it changed.
        self._q.GetMutableData().get_mutable_value().SetFromVector(q)
        return self._query_port.Eval(self._context)
