import os
import signal
from dataclasses import dataclass

import pytest
from hypothesis import settings

from selftouch_drake.experiment import Experiment, load_experiment
from selftouch_drake.geometry import HollowSkin, ReceptiveFields, build_body
from selftouch_drake.robot import ContactProbe

# The same examples every time; `make fuzz` looks for new ones.
settings.register_profile("steady", derandomize="SELFTOUCH_FUZZ" not in os.environ)
settings.load_profile("steady")

# A shell that runs the tests in its background lets them ignore Ctrl-C, and so do the programs
# that they start: those that are to be stopped would never hear of it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@dataclass(frozen=True)
class SmallWorld:
    """A shipped experiment, its body, and what its skin feels."""

    experiment: Experiment
    skin: HollowSkin
    fields: ReceptiveFields
    probe: ContactProbe


def _build(name: str) -> SmallWorld:
    experiment = load_experiment(name)
    skin, fields = build_body(experiment)
    return SmallWorld(experiment, skin, fields, ContactProbe(experiment, skin, fields))


@pytest.fixture(scope="session")
def cube_world():
    """One finger on a cube."""
    return _build("cube")


@pytest.fixture(scope="session")
def torus_world():
    """Two fingers on a torus."""
    return _build("torus_two_fingers")


@pytest.fixture(scope="session", params=["cube_world", "torus_world"])
def world(request):
    """Each of the worlds above."""
    return request.getfixturevalue(request.param)
