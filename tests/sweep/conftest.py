import pytest

from selftouch_drake.sweep.design import load_sweep

SWEEP = """
experiments: [sphere]
set:
  skins: {body: {surface: {shape: sphere, radius: 0.25, resolution: 0.04}}}
  babbling: {num_samples: 600, walk_size: 300}
  evaluation: {num_pairs: 0, shape_metrics: []}
  representation: {body_model: off}
cases:
  - representation: {num_targets: 50, metric: motor}
  - representation: {num_targets: 60, metric: motor}
  - {representation: {num_targets: 60, metric: motor}, planning: {knot_spacing: 0.2}}
  - skins: {body: {thickness: 0.4}}
"""


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    """Three runs that share what they can, and one whose skin cannot be."""
    path = tmp_path_factory.mktemp("sweep") / "small.yaml"
    path.write_text(SWEEP)
    return load_sweep(path)


@pytest.fixture(scope="session")
def common_text():
    """The text of a sweep before its cases."""
    return SWEEP.partition("cases:")[0]
