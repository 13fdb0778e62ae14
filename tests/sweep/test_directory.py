from concurrent.futures import ThreadPoolExecutor

import pytest

from selftouch_drake.run.directory import RunError
from selftouch_drake.sweep.directory import SweepDirectory


def test_another_folder_is_refused_and_kept(sweep, tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(RunError, match="is neither a sweep nor empty; choose another --out"):
        SweepDirectory.create(tmp_path, sweep)
    (tmp_path / "sweep.yaml").write_text("name: another\n")
    with pytest.raises(RunError, match="belongs to another sweep; choose another --out"):
        SweepDirectory.create(tmp_path, sweep)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_one_writer_at_a_time(sweep, tmp_path):
    directory = SweepDirectory.create(tmp_path / "sweep", sweep)
    with (
        directory.writing(),
        ThreadPoolExecutor(1) as other,
        pytest.raises(RunError, match="is being run by another process"),
    ):
        other.submit(directory.writing().__enter__).result()
