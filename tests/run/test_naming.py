from pathlib import Path

from selftouch_drake.run.naming import default_path, free_start


def test_a_run_is_named_after_what_was_changed():
    assert default_path("cube", {}) == Path("runs/cube")
    assert default_path("mine", {"name": "mine"}) == Path("runs/mine")
    changes = {"seed": 1, "skins": {"body": {"surface": {"mesh": "../my head.stl"}}}}
    assert default_path("cube", changes) == Path("runs/cube-seed=1-mesh=.._my_head.stl")


def test_many_changes_are_named_by_a_digest():
    changes = {"representation": {f"field_{n}": n for n in range(20)}}
    name = default_path("cube", changes).name
    assert len(name) == len("cube-") + 12
    assert name != default_path("cube", changes | {"seed": 1}).name


def test_a_free_start_names_all_its_joints_while_they_are_few():
    assert free_start([0.1, -0.5, 3.0]) == "q=0.1,-0.5,3"
    assert len(free_start([0.123456] * 40)) == len("q=") + 12
