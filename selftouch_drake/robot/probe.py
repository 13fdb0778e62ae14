"""What the skin feels at many configurations, without time: the paper's S = phi(f(M))."""

from __future__ import annotations

import numpy as np
import trimesh
from pydrake.geometry import HydroelasticContactRepresentation
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from selftouch_drake.experiment import Experiment
from selftouch_drake.geometry import FINGERTIP_RADIUS, HollowSkin, ReceptiveFields
from selftouch_drake.robot.contact import pressed_points
from selftouch_drake.robot.kinematics import FingertipKinematics
from selftouch_drake.robot.readings import Readings
from selftouch_drake.robot.station import MakeKinematicStation


class TouchScreen:
    """Says which fingertip positions cannot touch the skin, so that Drake need not be asked.

    Exact in one direction: what it rejects is out of reach. The wall is stood for by points on its
    outer, middle and inner layer. A ball that touches the wall from outside is within its radius of
    a layer, and a point inside the wall within half the longest step from layer to layer; a
    triangle whose edges are no longer than e is nowhere farther than e / sqrt(3) from its corners.
    Space is cut into cells, each as far from these points as its centre, give or take half its
    diagonal.
    """

    def __init__(self, skin: HollowSkin, *, cell: float = 0.005):
        num_vertices = len(skin.vertices)
        layers = np.concatenate([skin.faces + layer * num_vertices for layer in range(3)])
        points, _ = trimesh.remesh.subdivide_to_size(skin.tet_vertices, layers, max_edge=cell)
        layer_step = np.linalg.norm(skin.vertices - skin.inner_vertices, axis=1).max() / 2
        reach = max(FINGERTIP_RADIUS, layer_step / 2) + cell / np.sqrt(3) + cell * np.sqrt(3) / 2
        self._cell = cell
        self._origin = points.min(axis=0) - reach
        shape = np.ceil((points.max(axis=0) + reach - self._origin) / cell).astype(int)
        centres = self._origin + cell * (np.indices(shape).reshape(3, -1).T + 0.5)
        distance, _ = cKDTree(points).query(centres, distance_upper_bound=reach)
        # A rim of rejected cells catches whatever lies outside the grid.
        self._near = np.pad(np.isfinite(distance).reshape(shape), 1)

    def may_touch(self, p_BF: np.ndarray) -> np.ndarray:
        """`(N,)` whether any of the fingertips `(N, fingers, 3)` m might touch the skin."""
        cell = np.floor((p_BF - self._origin) / self._cell).astype(int) + 1
        i, j, k = np.moveaxis(np.clip(cell, 0, np.array(self._near.shape) - 1), -1, 0)
        return self._near[i, j, k].any(axis=1)


class ContactProbe:
    """Evaluates Drake's hydroelastic contact at given configurations, as the skin reads it.

    Args:
        experiment: the experiment whose agent is probed.
        skin: its hollow skin.
        fields: its receptive fields.
    """

    def __init__(self, experiment: Experiment, skin: HollowSkin, fields: ReceptiveFields):
        station = MakeKinematicStation(experiment, skin, fields)
        self._station, self._fields = station, fields
        self._context = station.diagram.CreateDefaultContext()
        self._q = station.diagram.GetInputPort("q").FixValue(
            self._context, np.zeros(station.agent.plant.num_positions())
        )
        self._query = station.diagram.GetOutputPort("query_object")
        self._screen = TouchScreen(skin)
        self._readings = Readings.of(experiment, fields)
        self.agent = station.agent
        self.kinematics = FingertipKinematics.of(station.agent)

    def sensations(self, q: np.ndarray) -> np.ndarray:
        """`(N, S)` N, the sensations at `q` `(N, J)` rad; zero rows where nothing is touched.

        The skin does not move here: the body frame is the world frame.
        """
        candidates = np.flatnonzero(self._screen.may_touch(self.kinematics.positions(q)))
        points: list[np.ndarray] = []
        forces: list[float] = []
        touched, num_faces = [], []
        for row in candidates:
            # Asking for the data again is what tells the context that it changed.
            self._q.GetMutableData().get_mutable_value().SetFromVector(q[row])
            query = self._query.Eval(self._context)
            surfaces = query.ComputeContactSurfaces(HydroelasticContactRepresentation.kPolygon)
            for surface in surfaces:
                p_WQ, force = pressed_points(surface)
                points += p_WQ
                forces += force
                touched.append(row)
                num_faces.append(len(force))
        sensation = np.zeros((len(q), self._fields.num_receptors))
        if points:
            interpolation = self._fields.interpolation_at(np.concatenate(points).reshape(-1, 3))
            ends = np.concatenate([[0], np.cumsum(num_faces)])
            gather = csr_array(
                (forces, np.arange(len(forces)), ends), shape=(len(touched), len(forces))
            )
            felt = ((gather @ interpolation) @ self._fields.vertex_weights).toarray()
            np.add.at(sensation, touched, felt)
        return sensation if self._readings is None else self._readings(sensation, q)
