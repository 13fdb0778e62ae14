"""The page of the first seconds of babbling: a walk as it is simulated, or stored touches."""

import base64
import dataclasses
import re

import numpy as np
import pytest
from laid_out import world_of

from selftouch_drake.experience.store import ExperienceReader, StoreError
from selftouch_drake.show.meshcat import babbling
from selftouch_drake.show.meshcat.babbling import SHOWN_S, babbling_page
from selftouch_drake.show.meshcat.stage import FRAMES_PER_S, FeelingRobot
from selftouch_drake.systems.simulation import Babbling


def commands(page: str) -> bytes:
    encoded = re.findall(r"base64,([A-Za-z0-9+/=]{40,})", page)
    return b"".join(base64.b64decode(text) for text in encoded)


def active(run):
    """The run as of an active explorer."""
    babbling = dataclasses.replace(run.experiment.babbling, strategy="active")
    return dataclasses.replace(
        run, experiment=dataclasses.replace(run.experiment, babbling=babbling)
    )


def test_the_report_links_the_page_of_a_walk(reported):
    page = reported.babbling.read_text(encoding="utf-8")
    assert "joint controllers follow its random walk" in page
    assert "the first 10 seconds of babbling" in page
    assert "active explorer" not in page
    found = commands(page)
    for wanted in (b"set_animation", b"/skins/body/receptors/0", b"/drake"):
        assert wanted in found
    assert 'href="babbling.html"' in reported.report.read_text(encoding="utf-8")


def test_a_walk_is_simulated_for_its_first_seconds(make_run, monkeypatch):
    began, until = [], []

    class Watched(Babbling):
        def begin(self, walk):
            super().begin(walk)
            began.append((walk, self.q.copy(), self.babbler.nodes(1)[0]))

        def advance_to(self, time_s):
            super().advance_to(time_s)
            until.append((time_s, self.self_touch.HasSubsystemNamed("skin_visualizer")))

    monkeypatch.setattr(babbling, "Babbling", Watched)
    babbling_page(make_run("babbled"), world_of("ball"))
    ((walk, q, node),) = began
    assert walk == 0
    np.testing.assert_allclose(q, node)
    assert until == [(SHOWN_S, True)]


def test_an_active_explorer_shows_postures_and_says_so(make_run, monkeypatch):
    shown, record = [], FeelingRobot.record

    def watched(self, recording, q, felt):
        shown.append((q, felt))
        record(self, recording, q, felt)

    monkeypatch.setattr(FeelingRobot, "record", watched)
    run = active(make_run("babbled"))
    page = babbling_page(run, world_of("ball"))
    assert "An active explorer has no random walk: these are the postures" in page
    assert "joint controllers follow" not in page
    assert b"set_animation" in commands(page)
    ((q, felt),) = shown
    assert len(q) == len(felt) == SHOWN_S * FRAMES_PER_S
    sensation, stored = next(ExperienceReader(run.experience).touches())
    np.testing.assert_array_equal(q[0], stored[0])
    np.testing.assert_array_equal(felt[0], sensation[0])
    assert (q[:, None] == stored).all(axis=2).any(axis=1).all(), "every frame is a stored touch"


def test_who_has_not_babbled_has_no_page(make_run):
    with pytest.raises(StoreError, match="holds no shard; run `selftouch babble` first"):
        babbling_page(make_run("nothing"), world_of("ball"))
