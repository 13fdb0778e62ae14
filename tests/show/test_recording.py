import base64
import html
import logging
import re

import numpy as np
import pytest
from laid_out import execution_of
from pydrake.geometry import Meshcat

from selftouch_drake.run.directory import MissingError
from selftouch_drake.show.meshcat.meshcat_scene import firm_touch
from selftouch_drake.show.meshcat.recording import frame_rows, record
from selftouch_drake.show.meshcat.stage import FRAMES_PER_S
from selftouch_drake.show.outputs import write_recording
from selftouch_drake.show.run_data import RunData
from selftouch_drake.systems.skin_drawing import SkinDrawing, key_frames


@pytest.fixture(scope="module")
def page(reported):
    return reported.playback.read_text(encoding="utf-8")


def commands(page: str) -> bytes:
    encoded = re.findall(r"base64,([A-Za-z0-9+/=]{40,})", page)
    return b"".join(base64.b64decode(text) for text in encoded)


def test_the_recording_moves_the_robot_and_colours_the_receptors(page):
    found = commands(page)
    for wanted in (
        b"set_animation",
        b"material.color",
        b"/skins/body/receptors/0",
        b"/expected/body/receptors/0",
        b"/recovered/here",
        b"/skins/body/plan/path_0/dots",
        b"/skins/body/plan/trace_0/dots",
    ):
        assert wanted in found
    assert len(page) < 5e6


class Recorder:
    """Keeps the recorded translation of each path, by frame."""

    def __init__(self):
        self.places = {}

    def SetTransform(self, frame, path, pose):
        self.places.setdefault(path, {})[frame] = pose.translation()

    def SetProperty(self, frame, path, name, value):
        pass


def test_skins_follow_their_links_and_what_stands_still_is_not_recorded(two_skins):
    data, recorder = RunData(two_skins), Recorder()
    q = execution_of("two_skins").q_measured[::10]
    poses = data.world.robot.skin_positions(q)
    drawing = SkinDrawing(Meshcat(), "/skins", data.skins)
    drawing.record(recorder, poses, np.zeros((len(q), 32)))
    assert set(recorder.places) == {"/skins/forearm"}
    places = recorder.places["/skins/forearm"]
    assert list(places) == list(range(len(q)))
    assert np.array(list(places.values())) == pytest.approx(poses[:, 1, :, 3])


def test_paths_move_with_their_skin(two_skins):
    data = RunData(two_skins)
    meshcat = Meshcat()
    record(meshcat, data, data.shown_pair)
    assert meshcat.HasPath("/skins/forearm/plan")
    assert meshcat.HasPath("/skins/body/plan")
    assert meshcat.HasPath("/recovered/part_1/surface")


def test_a_malicious_name_is_text(page, reported):
    assert reported.experiment.name not in page
    assert html.escape(reported.experiment.name) in page


def test_only_executed_plans_are_recorded(make_run):
    run = make_run("planned")
    with pytest.raises(MissingError, match="has not executed its plan from 0 to 40; run `self"):
        write_recording(run, 0, 40, path=run.playback)
    with pytest.raises(
        MissingError, match="has no plan from 1 to 2; make one with `selftouch plan"
    ):
        write_recording(run, 1, 2, path=run.playback)
    assert not run.playback.exists()


def test_receptors_show_what_is_felt_when_it_is_felt(reported):
    data = RunData(reported)
    meshcat = Meshcat()
    full = record(meshcat, data, (0, 40))
    felt = data.execution(0, 40).felt
    assert full == firm_touch(data.representation)
    assert meshcat.HasPath(f"/skins/body/receptors/{felt.shape[1] - 1}")


def test_recording_is_quiet_and_leaves_the_log_as_it_was(reported, tmp_path, caplog):
    logger = logging.getLogger("drake")
    level = logger.level
    write_recording(reported, 0, 40, path=tmp_path / "page.html")
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
