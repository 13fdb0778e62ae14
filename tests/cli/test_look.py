"""Commands that show what there is, as a user sees them."""

import subprocess
import sys

from commands import refused, selftouch

from selftouch_drake.resources import EXPERIMENTS, SWEEPS, shipped


def test_a_robot_in_words():
    # Given twice, both count; of one field the last.
    first = "{skins: {left_forearm: {num_receptors: 40}, right_forearm: {num_receptors: 39}}}"
    second = "{skins: {left_forearm: {num_receptors: 41}}}"
    done = selftouch("robot", "two_arms", "--set", first, "--set", second)
    assert done.status == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "12 joints move"
    assert "  left_arm::elbow_pitch      turns  -2.6 to 2.6 rad    60 N·m" in lines
    assert any("left_forearm" in line and "41 receptors" in line for line in lines)
    assert any("right_forearm" in line and "39 receptors" in line for line in lines)
    assert "What touches what" in lines


def test_a_shipped_experiment_is_shown():
    text = (EXPERIMENTS / "gantry.yaml").read_text(encoding="utf-8")
    assert selftouch("experiments", "--show", "gantry").stdout == text
    assert refused("experiments", "--show", "gantri") == (
        "--show is 'gantri'; this experiment is not shipped: did you mean gantry?"
    )


def test_a_list_of_experiments_needs_no_drake():
    code = (
        "import sys; from selftouch_drake.cli import cli; "
        "cli.main(['experiments'], standalone_mode=False); "
        "print(sorted({name.split('.')[0] for name in sys.modules} & set(sys.argv[1:])))"
    )
    heavy = ("pydrake", "sklearn", "scipy", "matplotlib", "trimesh", "numba", "pyarrow")
    done = subprocess.run([sys.executable, "-c", code, *heavy], capture_output=True, text=True)
    *lines, loaded = done.stdout.splitlines()
    listed = [line.split(maxsplit=1) for line in lines if line.startswith("  ")]
    assert [name for name, _ in listed] == [*shipped(EXPERIMENTS), *shipped(SWEEPS)]
    assert all(meaning.endswith((".", "?")) for _, meaning in listed)
    assert loaded == "[]"
