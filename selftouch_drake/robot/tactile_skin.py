"""The tactile skin in Drake: the systems that feel."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import LeafSystem

from selftouch_drake.robot.contact import SensorModel
from selftouch_drake.robot.imperfections import ImperfectSkins
from selftouch_drake.robot.pairs import WornSkin


class UnfeltContactWarning(UserWarning):
    """Something presses a skin with a contact that the skin cannot feel."""


class TactileSkin(LeafSystem):
    """Feels the contact on the skinned bodies of a running `MultibodyPlant`.

    The sensation belongs to the same instant as the state if the plant was made with
    `use_sampled_output_ports=False`; otherwise contact results lag by one step.

    .. pydrake_system::

        name: TactileSkin
        input_ports:
        - contact_results
        - body_poses
        output_ports:
        - sensation
        - NAME_sensation (one per skin)

    - contact_results: `ContactResults` of the plant, hydroelastic.
    - body_poses: `list[RigidTransform]` of the plant, so that the skins may move.
    - sensation: `(S,)` N, one reading per receptor, skin after skin.
    - NAME_sensation: N, the readings of one skin.

    It has no state: two contexts of one diagram do not disturb each other. Like every Drake system
    that is written in Python it can neither be cloned nor converted to another scalar type.

    Args:
        skins: in the order of their readings; call `AddTactileSkin` for one that is connected.
    """

    def __init__(self, skins: Sequence[WornSkin]):
        super().__init__()
        self._sensor = SensorModel(skins)
        self._links = [int(skin.link.index()) for skin in skins]
        self._skin_ids = frozenset(skin.geometry_id for skin in skins)
        self._contact = self.DeclareAbstractInputPort("contact_results", Value(ContactResults()))
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self.DeclareVectorOutputPort("sensation", self._sensor.num_receptors, self._calc_sensation)
        for skin, readings in zip(skins, self._sensor.readings, strict=True):
            self._declare_part(f"{skin.model.name}_sensation", readings)

    def _declare_part(self, name: str, readings: slice) -> None:
        def calc(context, output):
            output.SetFromVector(self.GetOutputPort("sensation").Eval(context)[readings])

        self.DeclareVectorOutputPort(name, readings.stop - readings.start, calc)

    def _calc_sensation(self, context, output):
        contact = self._contact.Eval(context)
        self._warn_of_points(contact)
        surfaces = (
            (0, contact.hydroelastic_contact_info(i).contact_surface())
            for i in range(contact.num_hydroelastic_contacts())
        )
        poses = self._poses.Eval(context)
        X_WL = [poses[link].GetAsMatrix34() for link in self._links]
        output.SetFromVector(self._sensor.touches(surfaces, np.array([X_WL])).sensation[0])

    def _warn_of_points(self, contact: ContactResults) -> None:
        for i in range(contact.num_point_pair_contacts()):
            pair = contact.point_pair_contact_info(i).point_pair()
            if pair.id_A in self._skin_ids or pair.id_B in self._skin_ids:
                warnings.warn(
                    "a skin is pressed by a geometry without hydroelastic properties, which it "
                    "cannot feel; give that geometry AddRigidHydroelasticProperties",
                    UnfeltContactWarning,
                    stacklevel=2,
                )
                return


class SkinReadout(LeafSystem):
    """Turns sensations into readings of imperfect skins: noisy, partly dead, delayed.

    Goes behind a `TactileSkin`.

    .. pydrake_system::

        name: SkinReadout
        input_ports:
        - sensation
        - q
        output_ports:
        - reading

    - sensation: `(S,)` N, of perfect skins.
    - q: `(J,)` rad or m, the configuration in which it is felt; noise comes from it.
    - reading: `(S,)` N.

    Args:
        imperfections: what is read of a sensation.
        num_receptors: S.
        num_joints: J.
        period_s: of the world's discrete steps; delays are rounded to whole ones.
    """

    def __init__(
        self,
        imperfections: ImperfectSkins,
        *,
        num_receptors: int,
        num_joints: int,
        period_s: float,
    ):
        super().__init__()
        self._imperfections = imperfections
        self._sensation = self.DeclareVectorInputPort("sensation", num_receptors)
        self._q = self.DeclareVectorInputPort("q", num_joints)
        self._delay = np.zeros(num_receptors, dtype=int)
        for columns, skin in imperfections.skins:
            self._delay[columns] = round(skin.flaws.delay / period_s)
        self._num_late = int(self._delay.max())
        self.DeclareVectorOutputPort("reading", num_receptors, self._calc_reading)
        if self._num_late:
            # The readings of the last steps, oldest first.
            self.DeclareDiscreteState(self._num_late * num_receptors)
            self.DeclareInitializationDiscreteUpdateEvent(self._begin)
            self.DeclarePeriodicDiscreteUpdateEvent(period_s, 0.0, self._step)

    def _now(self, context) -> np.ndarray:
        sensation, q = self._sensation.Eval(context), self._q.Eval(context)
        return self._imperfections(sensation[None], q[None])[0]

    def _begin(self, context, discrete_state):
        # A touch at the start of the world counts as older than any delay.
        discrete_state.set_value(np.tile(self._now(context), self._num_late))

    def _step(self, context, discrete_state):
        late = context.get_discrete_state_vector().value()
        now = self._now(context)
        discrete_state.set_value(np.concatenate([late[len(now) :], now]))

    def _calc_reading(self, context, output):
        now = self._now(context)
        if self._num_late:
            past = context.get_discrete_state_vector().value().reshape(self._num_late, -1)
            late = self._delay > 0
            now[late] = past[self._num_late - self._delay[late], np.flatnonzero(late)]
        output.SetFromVector(now)
