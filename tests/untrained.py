"""Learning without the networks that take most of its time, where no test asks what they find."""

import numpy as np
import pytest

from selftouch_drake.agent.planning import touch_model
from selftouch_drake.agent.representation import relevance


def train_nothing(patch: pytest.MonkeyPatch) -> None:
    """All joints matter to every touch, and steps along links are straight."""
    patch.setattr(relevance, "_FEWEST", np.inf)
    patch.setattr(touch_model, "_LONG", np.inf)
