"""The check of the pictures' stamp: an old picture is not an error, but it is reported."""

import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture
def pictures():
    from benchmarks.make import pictures

    return pictures


def test_every_picture_has_a_stamp_and_a_program(pictures):
    images = {path.stem for path in (ROOT / "docs" / "images").iterdir()} - {"stamp"}
    assert images == set(pictures.ALL)
    assert set(json.loads(pictures.STAMP.read_text(encoding="utf-8"))) == images


def test_other_code_makes_a_picture_outdated_and_other_words_do_not(pictures, tmp_path):
    file = tmp_path / "drawing.py"
    file.write_text('"""Words."""\ncolor = "red"  # as blood\n')
    before = pictures.content(file)
    file.write_text('"""Other words."""\n\ncolor = "red"\n')
    assert pictures.content(file) == before
    file.write_text('color = "blue"\n')
    assert pictures.content(file) != before
    file.write_text('raise ValueError("no colour")\n')
    before = pictures.content(file)
    file.write_text('raise ValueError("the colour is missing")\n')
    assert pictures.content(file) == before


def test_the_check_names_outdated_pictures_and_passes(pictures, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(pictures, "STAMP", tmp_path / "stamp.json")
    monkeypatch.setattr(sys, "argv", ["pictures.py", "--check"])
    pictures.main()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(pictures.ALL)
    assert all(line.startswith("::warning::docs/images/") for line in lines)
