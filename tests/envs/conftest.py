from functools import cache

import pytest

from selftouch_drake.envs import environment
from selftouch_drake.experiment import dump_experiment, experiment_from_fields
from selftouch_drake.robot import World


@pytest.fixture(scope="module", autouse=True)
def one_world_per_experiment():
    """Environments of one experiment share skins and probe, which take seconds to build."""
    yaml = pytest.importorskip("yaml")

    @cache
    def known(text: str) -> World:
        return World(experiment_from_fields(yaml.safe_load(text)))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(environment, "World", lambda experiment: known(dump_experiment(experiment)))
        yield


@pytest.fixture(scope="module", autouse=True)
def _no_meshcat_is_left(frees_meshcat):
    pass
