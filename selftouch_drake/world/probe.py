"""What the skin feels at many configurations, without time: the paper's S = phi(f(M))."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import HydroelasticContactRepresentation
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from selftouch_drake.body import FINGERTIP_RADIUS, HollowSkin, ReceptiveFields
from selftouch_drake.experiment import Experiment
from selftouch_drake.world.contact import pressed_points
from selftouch_drake.world.kinematics import FingertipKinematics
from selftouch_drake.world.station import MakeKinematicStation


class TouchScreen:
    """Says which fingertip positions cannot touch the skin, so that Drake need not be asked.

    Exact in one direction: what it rejects is out of reach of the skin. Space is cut into cells,
    and a cell is rejected if its centre is farther from every vertex of the skin's tetrahedra than
    a fingertip's radius, half a cell's diagonal and what the vertices may miss of a tetrahedron (by
    Jung's theorem, sqrt(3/8) of its longest edge) together.
    """

    def __init__(self, skin: HollowSkin, *, cell: float = 0.005):
        corners = skin.tet_vertices[skin.tetrahedra]
        edges = corners[:, :, None] - corners[:, None]
        missed = np.sqrt(3 / 8) * np.linalg.norm(edges, axis=-1).max()
        reach = FINGERTIP_RADIUS + missed + cell * np.sqrt(3) / 2
        self._cell = cell
        self._origin = skin.tet_vertices.min(axis=0) - reach
        shape = np.ceil((skin.tet_vertices.max(axis=0) + reach - self._origin) / cell).astype(int)
        centres = self._origin + cell * (np.indices(shape).reshape(3, -1).T + 0.5)
        distance, _ = cKDTree(skin.tet_vertices).query(centres, distance_upper_bound=reach)
        # A rim of rejected cells catches whatever lies outside the grid.
        self._near = np.pad(np.isfinite(distance).reshape(shape), 1)

    def may_touch(self, p_BF: np.ndarray) -> np.ndarray:
        """`(N,)` whether any of the fingertips `(N, fingers, 3)` m might touch the skin."""
        cell = np.floor((p_BF - self._origin) / self._cell).astype(int) + 1
        i, j, k = np.moveaxis(np.clip(cell, 0, np.array(self._near.shape) - 1), -1, 0)
        return self._near[i, j, k].any(axis=1)


class ContactProbe:
    """Evaluates Drake's hydroelastic contact at given configurations.

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
        self.agent = station.agent
        self.kinematics = FingertipKinematics.of(station.agent)

    def sensations(self, q: np.ndarray) -> np.ndarray:
        """`(N, S)` N, the sensations at `q` `(N, J)` rad; zero rows where nothing is touched.

        The skin does not move here: the body frame is the world frame.
        """
        candidates = np.flatnonzero(self._screen.may_touch(self.kinematics.positions(q)))
        points, forces, rows = [], [], []
        for row in candidates:
            # Asking for the data again is what tells the context that it changed.
            self._q.GetMutableData().get_mutable_value().SetFromVector(q[row])
            query = self._query.Eval(self._context)
            surfaces = query.ComputeContactSurfaces(HydroelasticContactRepresentation.kPolygon)
            for surface in surfaces:
                p_WQ, force = pressed_points(surface)
                points.append(p_WQ)
                forces.append(force)
                rows.append(np.full(len(force), row))
        sensation = np.zeros((len(q), self._fields.num_receptors))
        if points:
            weights = self._fields.weights_at(np.concatenate(points))
            rows = np.concatenate(rows)
            touched, row_of_point = np.unique(rows, return_inverse=True)
            gather = csr_array(
                (np.concatenate(forces), (row_of_point, np.arange(len(rows)))),
                shape=(len(touched), len(rows)),
            )
            sensation[touched] = (gather @ weights).toarray()
        return sensation
