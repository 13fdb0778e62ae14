"""Two arms that touch a body and each other: three parts."""

import pytest
from acceptance_runs import made, metrics_of


@pytest.mark.slow
def test_three_parts_are_found(tmp_path):
    sizes = {"touches": 16_000, "targets": 200, "pairs": 0}
    metrics = metrics_of(made(tmp_path / "run", "two_arms", metric="sensorimotor", **sizes))
    assert metrics["parts_found"] == metrics["parts_true"] == 3
    # 2.7 and 2.3 % with two seeds.
    assert metrics["surface_rms_fraction"] < 0.04
