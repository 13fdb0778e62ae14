from types import SimpleNamespace

import numpy as np
from by_hand import laid_by_hand
from modelled import found_by

from selftouch_drake.agent.agent import Agent
from selftouch_drake.agent.body_model.asking import ask_for_model, kernel_of_rows, pressing_two

KNOWN = laid_by_hand([[0.0, 0.1], [1.0], [2.0, 2.1, 2.2]], [[0, 1], [1, 2]])


def test_every_row_belongs_to_its_kernel():
    assert kernel_of_rows(KNOWN).tolist() == [0, 0, 1, 2, 2, 2]


def test_a_touch_of_two_parts_has_two_rows():
    stored = SimpleNamespace(kernel_row=np.array([4, 7, 2, 4, 9, 2]))
    assert pressing_two(stored).tolist() == [True, False, True, True, False, True]


def test_joints_without_names_get_numbers(monkeypatch):
    asked = []
    found_by(monkeypatch, lambda **given: asked.append(given))
    ask_for_model(KNOWN, None)
    Agent.of(KNOWN).find_body_model(["knee"], seed=3)
    assert [given["joint_names"] for given in asked] == [["joint_0"], ["knee"]]
    assert [given["seed"] for given in asked] == [0, 3]
    assert asked[0]["sensation"] is None
    assert asked[0]["q"].tolist() == [[0.0], [0.1], [1.0], [2.0], [2.1], [2.2]]
