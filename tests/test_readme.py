"""What the README shows works as it stands there."""

import re
import subprocess
import sys
from pathlib import Path

import yaml

from selftouch_drake.experiment import experiment_from_fields

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_a_head_feels_its_weight():
    (program,) = blocks("python")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    force = float(done.stdout.split(" N")[0])
    assert abs(force - 9.81) < 0.02 * 9.81


def test_the_experiment_of_an_own_body_is_valid():
    (text,) = blocks("yaml")
    assert experiment_from_fields(yaml.safe_load(text)).num_fingers == 2


def test_pictures_are_there():
    pictures = re.findall(r"!\[.*?\]\((.*?)\)", README)
    assert pictures
    for picture in pictures:
        assert (Path(__file__).parents[1] / picture).is_file()
