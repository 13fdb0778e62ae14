"""What goes wrong outside: killed processes, full disks, second writers, lost shards."""

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock

from selftouch_drake import stages
from selftouch_drake.babbling import collect, require_complete
from selftouch_drake.cli import cli, exit_status
from selftouch_drake.executors import dask_executor, local_executor
from selftouch_drake.experience import ExperienceReader, StoreError
from selftouch_drake.experiment import load_experiment, parse_overrides
from selftouch_drake.run_directory import RunDirectory

SMALL = (
    "{babbling: {num_samples: 1200, walk_size: 300}, "
    "representation: {num_targets: 50, metric: motor}}"
)
NUM_SHARDS = 4


def command(verb, *arguments):
    return [sys.executable, "-m", "selftouch_drake.cli", verb, *map(str, arguments)]


def babble(run, *more, **options):
    arguments = ("cube", "--out", run, "--set", SMALL, "--workers", 1, *more)
    return subprocess.run(
        command("babble", *arguments), capture_output=True, text=True, timeout=200, **options
    )


def refused(done) -> str:
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    return done.stderr.strip().splitlines()[-1].removeprefix("selftouch: ")


def shards(run: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(run)): path.read_bytes()
        for folder in ("experience", "truth")
        for path in sorted((run / folder).iterdir())
    }


@pytest.fixture(scope="session")
def whole_run(tmp_path_factory):
    run = tmp_path_factory.mktemp("whole") / "run"
    done = babble(run)
    assert done.returncode == 0, done.stderr
    assert len(shards(run)) == 2 * NUM_SHARDS
    return run


@pytest.fixture
def run(whole_run, tmp_path):
    shutil.copytree(whole_run, tmp_path / "run")
    return tmp_path / "run"


@pytest.mark.parametrize("num_stored", [0, 2])
def test_killed_at_any_moment_and_started_again_gives_the_same_bytes(
    num_stored, whole_run, tmp_path
):
    run = tmp_path / "run"
    arguments = ("cube", "--out", run, "--set", SMALL, "--workers", 1)
    process = subprocess.Popen(
        command("babble", *arguments), start_new_session=True, stderr=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 120
    while len(list(run.glob("experience/part-*"))) < num_stored or not run.exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    kept = list(run.glob("experience/part-*"))
    assert num_stored <= len(kept) < NUM_SHARDS
    stamps = {path: path.stat().st_mtime_ns for path in kept}
    assert babble(run).returncode == 0
    assert shards(run) == shards(whole_run)
    assert {path: path.stat().st_mtime_ns for path in kept} == stamps


def test_a_second_writer_is_refused_and_readers_are_not(run):
    before = shards(run)
    with FileLock(run / ".lock"):
        line = refused(babble(run))
        held = subprocess.run(command("learn", run), capture_output=True, text=True)
    assert line == (
        f"{run} is being written by another process; wait for it, or choose another --out"
    )
    assert refused(held) == line
    assert shards(run) == before


def test_a_full_disk_is_told_and_leaves_no_half_shard(tmp_path):
    # The kernel refuses every file beyond this size, as it refuses all when the disk is full: the
    # skin's file fits, the only shard does not.
    run, limit = tmp_path / "run", 300_000
    large = ("--set", "{babbling: {num_samples: 6000, walk_size: 6000}}")

    def small_files():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    line = refused(babble(run, *large, preexec_fn=small_files))
    assert "File too large" in line
    assert list((run / "experience").iterdir()) == []
    assert babble(run, *large).returncode == 0
    (shard,) = (run / "experience").iterdir()
    assert shard.stat().st_size > limit


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    # Not even root may make a folder there.
    line = refused(babble(Path("/proc/selftouch")))
    assert "/proc/selftouch" in line


@pytest.mark.parametrize("verb", ["learn"])
def test_a_lost_shard_is_named_and_collected_again(verb, run, whole_run):
    lost = run / "experience" / "part-00002.parquet"
    lost.unlink()
    done = subprocess.run(command(verb, run), capture_output=True, text=True)
    assert refused(done) == (
        f"{lost} is missing; collect it again with "
        f"`selftouch babble {run / 'experiment.yaml'} --out {run}`"
    )
    again = command("babble", run / "experiment.yaml", "--out", run)
    assert subprocess.run(again, capture_output=True).returncode == 0
    assert shards(run) == shards(whole_run)


def test_a_lost_shard_of_the_truth_is_collected_again(run, whole_run):
    lost = run / "truth" / "part-00001.parquet"
    lost.unlink()
    with pytest.raises(StoreError, match=re.escape(f"{lost} is missing; collect it again with ")):
        require_complete(RunDirectory.open(run), truth=True)
    again = command("babble", run / "experiment.yaml", "--out", run)
    assert subprocess.run(again, capture_output=True).returncode == 0
    assert shards(run) == shards(whole_run)


@pytest.fixture(scope="session")
def learned_run(whole_run, tmp_path_factory):
    """A run that has learned, planned and rehearsed, as small as it gets."""
    path = tmp_path_factory.mktemp("learned") / "run"
    shutil.copytree(whole_run, path)
    run = RunDirectory.open(path)
    stages.learn(run)
    pilot = stages.Pilot(run)
    pilot.plan(0, 1)
    pilot.memory.save(run.rehearsal)
    return path


# Every file that a verb reads, and that verb.
READ = [
    ("experiment.yaml", ["learn"]),
    ("metrics.json", ["learn"]),
    ("experience/part-00001.parquet", ["learn"]),
    ("experience/part-00002.parquet", ["plan", "--from", "0", "--to", "1"]),
    ("truth/part-00003.parquet", ["evaluate"]),
    ("representation.npz", ["plan", "--from", "0", "--to", "1"]),
    ("representation.npz", ["evaluate"]),
    ("rehearsal.npz", ["plan", "--from", "0", "--to", "1"]),
    ("plans/0-1.npz", ["execute", "--from", "0", "--to", "1"]),
]


@pytest.mark.parametrize(("name", "command"), READ)
@pytest.mark.parametrize("damage", ["empty", "garbage", "half", "another"])
def test_a_damaged_or_foreign_file_is_named_and_left(
    name, command, damage, learned_run, tmp_path, capsys
):
    run = tmp_path / "run"
    shutil.copytree(learned_run, run)
    file, (verb, *options) = run / name, command
    whole = file.read_bytes()
    another = run / ("skin.npz" if file.suffix != ".npz" else "experience/part-00000.parquet")
    content = {
        "empty": b"",
        "garbage": bytes(range(256)) * 9,
        "half": whole[: len(whole) // 2],
        "another": another.read_bytes(),
    }[damage]
    file.write_bytes(content)
    before = {p: p.read_bytes() for p in run.rglob("*") if p.is_file()}
    arguments = [verb, str(run), *options]
    status = exit_status(lambda: cli.main(arguments, standalone_mode=False))
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert status == 2
    assert line.startswith("selftouch: ")
    # Half an experiment may still be YAML: then it is the field that is named.
    assert str(file) in line or name == "experiment.yaml"
    after = {p: p.read_bytes() for p in run.rglob("*") if p.is_file() and p.name != ".lock"}
    assert {p: before.get(p) for p in after} == after


def test_what_was_learned_for_another_experiment_is_refused(learned_run, tmp_path, capsys):
    run = tmp_path / "run"
    shutil.copytree(learned_run, run)
    file = run / "experiment.yaml"
    other = file.read_text().replace("max_kernel_size: 1000", "max_kernel_size: 999")
    file.write_text(other)
    for verb in (["plan", str(run), "--from", "0", "--to", "1"], ["evaluate", str(run)]):
        assert exit_status(lambda verb=verb: cli.main(verb, standalone_mode=False)) == 2
        assert capsys.readouterr().err.strip().splitlines()[-1] == (
            f"selftouch: {run / 'representation.npz'} is of another experiment or version; "
            f"run `selftouch learn {run}`"
        )


def test_learning_that_is_killed_and_done_again_gives_the_same_bytes(learned_run, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(learned_run, run)
    process = subprocess.Popen(command("learn", run), stderr=subprocess.DEVNULL)
    while not list(run.glob(".*.part")) and process.poll() is None:
        time.sleep(0.001)
    process.kill()
    process.wait()
    stages.learn(RunDirectory.open(run))
    for name in ("representation.npz", "topology.npz", "body_distances.npz"):
        assert (run / name).read_bytes() == (learned_run / name).read_bytes(), name


def test_a_worker_that_is_killed_is_told(tmp_path):
    experiment = load_experiment("cube", parse_overrides(SMALL))
    run = RunDirectory.create(tmp_path / "run", experiment)
    with local_executor(1) as executor:
        worker = executor.submit(os.getpid).result()
        executor.submit(os.kill, worker, signal.SIGKILL)
        with pytest.raises(ChildProcessError, match="go on from what is stored"):
            collect(run, executor=executor)


def test_an_altered_shard_is_named(run):
    shard = run / "experience" / "part-00001.parquet"
    altered = bytearray(shard.read_bytes())
    altered[len(altered) // 3] ^= 0xFF
    shard.write_bytes(altered)
    done = subprocess.run(command("learn", run), capture_output=True, text=True)
    assert refused(done).startswith(f"{shard} is damaged (")
    assert not (run / "representation.npz").exists()


def test_a_shard_too_many_is_refused(run):
    shutil.copy(
        run / "experience" / "part-00000.parquet", run / "experience" / "part-00009.parquet"
    )
    done = subprocess.run(command("learn", run), capture_output=True, text=True)
    assert refused(done) == (
        f"{run / 'experience'} holds shards that are not of this run; remove them"
    )


def test_a_dask_cluster_that_loses_a_worker_gives_the_same_bytes(whole_run, tmp_path):
    distributed = pytest.importorskip("distributed")
    experiment = load_experiment("cube", parse_overrides(SMALL))
    run = RunDirectory.create(tmp_path / "run", experiment)
    stored = []
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        dask_executor(cluster.scheduler_address) as executor,
    ):

        def kill_one(num_rows):
            if not stored:
                victim = next(iter(cluster.workers.values()))
                os.kill(victim.process.process.pid, signal.SIGKILL)
            stored.append(num_rows)

        collect(run, executor=executor, progress=kill_one)
    assert stored == [300] * NUM_SHARDS
    assert shards(run.path) == shards(whole_run)


def test_a_scheduler_that_is_not_there_is_told(tmp_path):
    line = refused(babble(tmp_path / "run", "--scheduler", "tcp://127.0.0.1:9"))
    assert line.startswith("--scheduler tcp://127.0.0.1:9 does not answer: ")


def test_pandas_polars_and_arrow_read_what_numpy_reads(whole_run):
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    reader = ExperienceReader(whole_run / "experience")
    q, sensation = reader.read("q"), reader.read("sensation")
    assert reader.num_rows == len(q) == len(sensation) == 1200
    frame = pandas.read_parquet(whole_run / "experience")
    np.testing.assert_array_equal(np.stack(frame["q"]), q)
    lazy = polars.scan_parquet(whole_run / "experience" / "*.parquet")
    np.testing.assert_array_equal(lazy.select("sensation").collect()["sensation"], sensation)
    table = reader.dataset().to_table(columns=["q"])
    assert table.column_names == ["q"]
    np.testing.assert_array_equal(np.stack(table["q"].to_pandas()), q)


def test_one_and_two_processes_share_a_pool(whole_run, tmp_path):
    experiment = load_experiment("cube", parse_overrides(SMALL))
    run = RunDirectory.create(tmp_path / "run", experiment)
    with local_executor(2) as executor:
        collect(run, executor=executor)
    assert shards(run.path) == shards(whole_run)
