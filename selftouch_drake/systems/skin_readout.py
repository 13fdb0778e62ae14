"""The system that reads like a real skin."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from selftouch_drake.robot.imperfections import ImperfectSkins


class SkinReadout(LeafSystem):
    """Turns sensations into readings of real skins: noisy, partly dead, delayed, binary.

    Goes behind a `TactileSkin`.

    .. pydrake_system::

        name: SkinReadout
        input_ports:
        - sensation
        - q
        output_ports:
        - reading

    ============== ====== ==== ======== ============================================
    port           type   size unit     what
    ============== ====== ==== ======== ============================================
    sensation (in) vector S    N        of perfect skins, one number per receptor
    q (in)         vector J    rad or m where it is felt; noise comes from it
    reading (out)  vector S    N        what the imperfect skins report
    ============== ====== ==== ======== ============================================

    The readings of the last steps are discrete state, where a skin is late or has hysteresis.

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
        remembers = any(skin.reading.hysteresis for _, skin in imperfections.skins)
        self._num_late = max(int(self._delay.max()), int(remembers))
        self.DeclareVectorOutputPort("reading", num_receptors, self._calc_reading)
        if self._num_late:
            # The readings of the last steps, oldest first.
            self.DeclareDiscreteState(self._num_late * num_receptors)
            self.DeclareInitializationDiscreteUpdateEvent(self._begin)
            self.DeclarePeriodicDiscreteUpdateEvent(period_s, 0.0, self._step)

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder,
        imperfections: ImperfectSkins,
        sensation: OutputPort,
        q: OutputPort,
        *,
        period_s: float,
        name: str = "readout",
    ) -> "SkinReadout":
        """Adds a readout to a diagram and connects it to a sensation and a configuration."""
        readout = SkinReadout(
            imperfections,
            num_receptors=sensation.size(),
            num_joints=q.size(),
            period_s=period_s,
        )
        builder.AddNamedSystem(name, readout)
        builder.Connect(sensation, readout.GetInputPort("sensation"))
        builder.Connect(q, readout.GetInputPort("q"))
        return readout

    def _now(self, context, before: np.ndarray | None = None) -> np.ndarray:
        sensation, q = self._sensation.Eval(context), self._q.Eval(context)
        return self._imperfections(sensation[None], q[None], before)[0]

    def _past(self, context) -> np.ndarray:
        return context.get_discrete_state_vector().value().reshape(self._num_late, -1)

    def _begin(self, context, discrete_state):
        # A touch at the start of the world counts as older than any delay.
        discrete_state.set_value(np.tile(self._now(context), self._num_late))

    def _step(self, context, discrete_state):
        past = self._past(context)
        now = self._now(context, past[-1:])
        discrete_state.set_value(np.append(past[1:], now))

    def _calc_reading(self, context, output):
        past = self._past(context) if self._num_late else None
        now = self._now(context, None if past is None else past[-1:])
        if past is not None:
            late = self._delay > 0
            now[late] = past[self._num_late - self._delay[late], np.flatnonzero(late)]
        output.SetFromVector(now)
