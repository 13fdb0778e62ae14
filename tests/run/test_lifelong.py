"""An agent lives through the experience of a run, watched or not, and its life is kept."""

import numpy as np
import pytest

from selftouch_drake.agent.lifelong import life as life_module
from selftouch_drake.agent.lifelong.life import Life
from selftouch_drake.evaluation.life import LifeCurves
from selftouch_drake.experience.exploration import Exploration
from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experiment import load_experiment
from selftouch_drake.files import load_arrays
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.executors import InTurn
from selftouch_drake.run.lifelong import live
from selftouch_drake.run.touches import ChangedBodyWarning
from selftouch_drake.show.meshcat import pages
from selftouch_drake.show.meshcat.pages import LifePage
from selftouch_drake.show.meshcat.stage import open_meshcat
from selftouch_drake.show.page import motion_figures
from selftouch_drake.show.run_data import RunData

pytestmark = [
    pytest.mark.filterwarnings("ignore:the quotient graph fell"),
    pytest.mark.usefixtures("frees_meshcat"),
]


def babbled(path, strategy):
    """A run whose body changes after 1000 of 1200 touches."""
    surface = {"shape": "sphere", "radius": 0.25, "resolution": 0.05}
    experiment = load_experiment(
        "sphere",
        {
            "skins": {"body": {"surface": surface, "num_receptors": 30}},
            "babbling": {"num_samples": 1200, "walk_size": 600, "strategy": strategy},
            "representation": {"num_targets": 60, "metric": "sensorimotor", "body_model": "off"},
            "evaluation": {"num_pairs": 1},
            "changes": [{"after": 1000, "skins": {"body": {"dead": [0]}}}],
        },
    )
    run = RunDirectory.create(path, experiment)
    with pytest.raises(RunError, match="half-finished"):
        live(run)
    stages.babble(run, InTurn())
    return run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return babbled(tmp_path_factory.mktemp("life") / "run", "random")


@pytest.fixture(autouse=True)
def _no_time_between_frames(monkeypatch):
    monkeypatch.setattr(pages, "FRAME_S", 0.0)


class Page(LifePage):
    """A page that records what it shows, and can be ended."""

    def __init__(self, ends_after=np.inf):
        super().__init__(open_meshcat())
        self.seen, self._ends_after = [], ends_after

    def enter(self, world):
        super().enter(world)
        self.seen.append(len(world.experiment.changes))

    def lived(self, q, sensation, life):
        super().lived(q, sensation, life)
        if life.num_touches > self._ends_after:
            raise KeyboardInterrupt


def test_a_life_is_shown_and_kept_as_curves(run):
    page = Page()
    curves = live(run, page)
    assert page.seen == [0, 1]
    assert page.robot.status == "1,200 touches: it is learning"
    assert curves.touches[-1] >= 750
    assert (np.diff(curves.coverage) >= 0).all()
    assert 0.9 < curves.coverage[-1] <= 1
    assert curves.error[-1] < 0.2
    assert curves.changed.tolist() == [1000]
    assert not len(curves.noticed)
    kept = RunData(run).life
    assert all(
        np.array_equal(array, kept.to_arrays()[name], equal_nan=True)
        for name, array in curves.to_arrays().items()
    )
    assert len(motion_figures.life(RunData(run)).axes) == 4


@pytest.mark.slow
def test_an_active_life_goes_on_in_a_changed_body(tmp_path, monkeypatch):
    monkeypatch.setattr(life_module, "_FIRST", 500)
    monkeypatch.setitem(Life.__init__.__kwdefaults__, "num_steps", 200)
    run = babbled(tmp_path / "run", "active")
    curves = live(run)
    assert curves.changed.tolist() == [1000]
    # Of a body that stayed as it was, no change was noticed.
    assert (curves.noticed > 1000).all()
    assert np.isfinite(curves.surprise[-1])
    # It is the life of the agent that explored.
    explorer = Exploration(run.experiment, stages.run_bodies(run).babbling)
    for sensation, q in ExperienceReader(run.experience).touches():
        explorer.remember(q, sensation)
    surprise = [block.mean() for block in explorer.mind.surprise]
    assert np.array_equal(surprise, curves.surprise, equal_nan=True)
    assert np.array_equal(live(run).surprise, curves.surprise, equal_nan=True)


def test_a_life_that_was_ended_is_kept_so_far(run):
    with pytest.raises(KeyboardInterrupt):
        live(run, Page(ends_after=500))
    assert LifeCurves.from_arrays(load_arrays(run.life)).block_touches[-1] <= 1000


def test_a_run_that_learns_two_bodies_as_one_says_so(run):
    def stop(fraction, doing):
        raise KeyboardInterrupt

    with (
        pytest.warns(ChangedBodyWarning, match=r"changes\[\].after is 1,000.*`selftouch live "),
        pytest.raises(KeyboardInterrupt),
    ):
        stages.learn(run, stop)
