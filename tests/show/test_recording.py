import base64
import html
import logging
import re

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from selftouch_drake.show import MissingError, write_playback
from selftouch_drake.show.material import Material
from selftouch_drake.show.recording import FRAMES_PER_S, frame_rows, record
from selftouch_drake.show.scenery import firm_touch, key_frames


@pytest.fixture(scope="module")
def page(reported):
    return reported.playback.read_text(encoding="utf-8")


def test_the_recording_moves_the_arm_and_colours_the_receptors(page):
    encoded = re.findall(r"base64,([A-Za-z0-9+/=]{40,})", page)
    commands = b"".join(base64.b64decode(text) for text in encoded)
    for wanted in (
        b"set_animation",
        b"material.color",
        b"/body/receptors/0",
        b"/expected/receptors/0",
        b"/mind/here",
        b"/plan/0/path_0",
        b"/plan/0/trace_0",
    ):
        assert wanted in commands
    assert len(page) < 5e6


def test_a_malicious_name_is_text(page, reported):
    assert reported.experiment.name not in page
    assert html.escape(reported.experiment.name) in page


def test_only_executed_plans_are_recorded(make_run):
    run = make_run("planned")
    with pytest.raises(MissingError, match="plan 0-40 was not executed; run `selftouch execute`"):
        write_playback(run, 0, 40)
    with pytest.raises(MissingError, match="plan 1-2 is not there; run `selftouch plan`"):
        write_playback(run, 1, 2)
    assert not run.playback.exists()


def test_receptors_show_what_is_felt_when_it_is_felt(reported):
    material = Material(reported)
    meshcat = Meshcat()
    full = record(meshcat, material, [(0, 40), (0, 40)])
    felt = material.executed(0, 40)["felt"]
    assert full == firm_touch(material.representation)
    assert meshcat.HasPath("/plan/1/path_0")
    assert meshcat.HasPath(f"/body/receptors/{felt.shape[1] - 1}")


def test_recording_is_quiet_and_leaves_the_log_as_it_was(reported, caplog):
    logger = logging.getLogger("drake")
    level = logger.level
    write_playback(reported, 0, 40)
    assert logger.level == level
    assert "listening" not in caplog.text


def test_frames_follow_the_clock_and_hold_the_end():
    rows = frame_rows(5.0 + np.arange(201) / 100)
    assert rows[0] == 0
    assert rows[FRAMES_PER_S] == 100
    assert (rows[2 * FRAMES_PER_S :] == 200).all()
    assert len(rows) == 3 * FRAMES_PER_S


@pytest.mark.parametrize(
    ("values", "keys"),
    [
        ([0, 0, 0, 0], [0, 3]),
        ([0, 0, 5, 5, 5], [0, 1, 2, 4]),
        ([0, 1, 2], [0, 1, 2]),
        ([7], [0]),
    ],
)
def test_key_frames_hold_values_between_changes(values, keys):
    assert list(key_frames(np.array(values))) == keys
