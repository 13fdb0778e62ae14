"""One finger on a torus: shape, holes, and motions before practice, practised and executed."""

import pytest
from acceptance_runs import made, metrics_of
from made_once import made_once

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def metrics(tmp_path_factory):
    sizes = {"touches": 150_000, "targets": 500, "pairs": 8}
    return metrics_of(
        made_once(tmp_path_factory, "torus", lambda path: made(path, "torus", seed=2, **sizes))
    )


def test_the_torus_is_recovered(metrics):
    assert metrics["topology_betti"] == [1, 2, 1]
    # 1.0 to 1.1 % with three seeds; margins 3.9 to 5.0, and from 4 on the agent trusts them.
    assert metrics["surface_rms_fraction"] < 0.016
    assert metrics["topology_margin"] > 3.0
    assert metrics["shape_trusted"] is True


def test_plans_before_practice_touch(metrics):
    assert metrics["unpractised_contact_mean"] > 0.98
    assert metrics["unpractised_reach_rate"] > 0.85


def test_executions_touch_and_arrive(metrics):
    assert metrics["execution_contact_mean"] > 0.995
    assert metrics["execution_contact_worst"] > 0.95
    assert metrics["execution_reach_rate"] == 1.0
