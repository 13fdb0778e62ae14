import numpy as np
import pytest
from laid_out import IN_AIR, ON_BALL, ON_FOREARM, motion_of, sliding_places, world_of

from selftouch_drake.show.skins import SkinPath, evenly_spaced, touch_paths


def test_on_a_skin_that_moves_a_path_is_in_the_frame_of_its_link():
    paths = touch_paths(world_of("two_skins"), motion_of("two_skins").q)
    by_skin = {path.skin: path for path in paths}
    assert set(by_skin) == {0, 1}
    forearm = by_skin[1]
    assert forearm.rows.tolist() == list(range(ON_FOREARM.start, ON_FOREARM.stop))
    assert forearm.points == pytest.approx(sliding_places(), abs=1e-4)
    radii = np.linalg.norm(by_skin[0].points, axis=1)
    assert radii[-1] == pytest.approx(0.155, abs=1e-4)
    assert by_skin[0].rows[-1] == ON_BALL.stop - 1
    assert not np.isin(by_skin[0].rows, range(IN_AIR.start, IN_AIR.stop - 1)).any()


def test_of_balls_on_one_skin_the_whole_path_is_shown():
    motion, world = motion_of("ball"), world_of("ball")
    assert not world.probe.sensations(motion.q).any(axis=1).all(), "it is not always in contact"
    (path,) = touch_paths(world, motion.q)
    tips = world.robot.toucher_positions(motion.q)[:, 0]
    assert path.points == pytest.approx(tips, abs=1e-12)


def test_a_path_has_stretches_and_ends():
    rows = np.array([3, 4, 5, 30, 31])
    path = SkinPath(skin=0, points=np.outer(rows, [1.0, 0, 0]), rows=rows)
    assert [len(stretch) for stretch in path.stretches()] == [3, 2]
    assert path.at(30) == pytest.approx([30.0, 0, 0])
    assert path.at(6) is None
    pose = np.hstack([np.eye(3), [[0.0], [0.0], [1.0]]])
    assert path.moved(pose).at(3) == pytest.approx([3.0, 0.0, 1.0])


def test_dots_are_evenly_spaced_whatever_the_samples():
    path = np.array([[0.0, 0, 0], [0.01, 0, 0], [1.0, 0, 0]])
    steps = np.linalg.norm(np.diff(evenly_spaced(path, 0.1), axis=0), axis=1)
    assert steps == pytest.approx(steps[0])
    assert steps[0] <= 0.1
