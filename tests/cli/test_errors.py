"""What goes wrong, in one line."""

import warnings

import numpy as np
import pytest
from commands import SMALL

from selftouch_drake.cli import exit_status
from selftouch_drake.experiment import load_experiment
from selftouch_drake.experiment.loading import parse_fields
from selftouch_drake.quotient.graph import connected_edges
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import InTurn


def test_what_was_never_touched_is_named_in_one_line(capfd, tmp_path):
    # A skin of a few square centimetres at the shoulder, where the fingertip hardly ever comes.
    surface = {"shape": "sphere", "radius": 0.02, "resolution": 0.01}
    spot = {"link": "shoulder", "surface": surface, "thickness": 0.008, "num_receptors": 4}
    overrides = parse_fields(SMALL) | {"skins": {"spot": spot}}
    experiment = load_experiment("cube", overrides)
    directory = RunDirectory.create(tmp_path / "run", experiment)
    status = exit_status(lambda: stages.babble(directory, InTurn(), stages.silent))
    assert status == 0
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert line == (
        "selftouch: warning: skins.spot was never touched in 2,000 touches; see what can touch "
        f"what with `selftouch robot {directory.path / 'experiment.yaml'} --show`"
    )


def test_a_graph_in_parts_is_named_in_one_line(capfd):
    def learn_two_parts():
        connected_edges(np.array([[0, 1]]), np.array([[0, 1, 5], [1, 0, 4], [5, 4, 0.0]]))
        warnings.warn("of another package", UserWarning, stacklevel=1)

    with pytest.warns(UserWarning, match="of another package"):
        assert exit_status(learn_two_parts) == 0
    assert capfd.readouterr().err == (
        "selftouch: warning: the quotient graph fell into 2 components, with 2, 1 kernels, and was "
        "joined by the bridges 1-2: babble longer, or give fewer targets\n"
    )
