"""External faults: killed processes, full disks, concurrent writers, lost shards."""

import ctypes
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow.dataset
import pytest
from commands import SMALL, refused, selftouch
from filelock import FileLock

from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.bodies.embodiment import body_of
from selftouch_drake.experience.collect import collect, require_complete
from selftouch_drake.experience.store import ExperienceReader, StoreError
from selftouch_drake.experiment import load_experiment
from selftouch_drake.experiment.loading import parse_fields
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.run import executors, stages
from selftouch_drake.run.artifacts import load_representation, save_memory
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.executors import dask_executor, local_executor

NUM_SHARDS = 4


def command(verb, *arguments):
    return [sys.executable, "-m", "selftouch_drake", verb, *map(str, arguments)]


def babble(run, *more):
    return ("babble", "cube", "--out", run, "--set", SMALL, "--workers", 1, *more)


def shards(run: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(run)): path.read_bytes()
        for folder in ("experience", "truth")
        for path in sorted((run / folder).iterdir())
    }


def collect_into(run, executor, **options):
    how = {"fingerprint": run.fingerprint(), "executor": executor, "body_of": body_of}
    collect(run.experiment, run.path, **how, **options)


@pytest.fixture(scope="session")
def learned_run(finished_run, tmp_path_factory):
    """A small run with a plan, and a memory of rehearsals."""
    path = shutil.copytree(finished_run, tmp_path_factory.mktemp("learned") / "run")
    file = path / "experiment.yaml"
    file.write_text(file.read_text().replace("shape_metrics: null", "shape_metrics: []"))
    run = RunDirectory.open(path)
    stages.plan(run, 0, 1)
    save_memory(run, RehearsalMemory.blank(load_representation(run)))
    return path


@pytest.fixture
def run(learned_run, tmp_path):
    return shutil.copytree(learned_run, tmp_path / "run")


@pytest.mark.slow
@pytest.mark.parametrize("num_stored", [0, 2])
def test_killed_at_any_moment_and_started_again_gives_the_same_bytes(
    num_stored, finished_run, tmp_path
):
    run = tmp_path / "run"
    process = subprocess.Popen(
        command(*babble(run)), start_new_session=True, stderr=subprocess.DEVNULL
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
    assert selftouch(*babble(run)).status == 0
    assert shards(run) == shards(finished_run)
    assert {path: path.stat().st_mtime_ns for path in kept} == stamps


def test_a_second_writer_of_experience_is_refused(run):
    before = shards(run)
    with FileLock(run / ".lock"):
        line = refused("babble", run / "experiment.yaml", "--out", run, "--workers", 1)
    assert line == (
        f"{run} is being written by another process; wait for it, or choose another --out"
    )
    assert shards(run) == before


def test_a_full_disk_is_reported_and_leaves_no_half_shard(tmp_path, small_files):
    # The skin's file fits, the only shard does not.
    run, limit = tmp_path / "run", 300_000
    large = ("--set", "{babbling: {num_samples: 6000, walk_size: 6000}}")
    with small_files(limit):
        line = refusal(*babble(run, *large))
    assert "File too large" in line
    assert list((run / "experience").iterdir()) == []
    assert selftouch(*babble(run, *large)).status == 0
    (shard,) = (run / "experience").iterdir()
    assert shard.stat().st_size > limit


def test_a_folder_that_cannot_be_written_is_reported():
    # Not even root may make a folder there.
    assert "/proc/selftouch" in refused(*babble(Path("/proc/selftouch")))


def test_a_lost_shard_is_named_and_collected_again(run, finished_run):
    lost = run / "experience" / "part-00002.parquet"
    lost.unlink()
    assert refused("learn", run) == (
        f"{lost} is missing; collect it again with "
        f"`selftouch babble {run / 'experiment.yaml'} --out {run}`"
    )
    lost = run / "truth" / "part-00001.parquet"
    lost.unlink()
    opened = RunDirectory.open(run)
    with pytest.raises(StoreError, match=re.escape(f"{lost} is missing; collect it again with ")):
        require_complete(
            opened.experiment, opened.path, fingerprint=opened.fingerprint(), truth=True
        )
    assert selftouch("babble", run / "experiment.yaml", "--out", run, "--workers", 1).status == 0
    assert shards(run) == shards(finished_run)


PAIR = ["--from", "0", "--to", "1"]
# Every file that a verb reads, and that verb.
READ = [
    ("experiment.yaml", ["learn"]),
    ("models.json", ["learn"]),
    ("models.json", ["execute", *PAIR]),
    ("metrics.json", ["learn"]),
    ("metrics.json", ["evaluate"]),
    ("metrics.json", ["report"]),
    ("experience/part-00001.parquet", ["learn"]),
    ("truth/part-00003.parquet", ["evaluate"]),
    ("truth/part-00003.parquet", ["report"]),
    ("representation.npz", ["plan", *PAIR]),
    ("representation.npz", ["execute", *PAIR]),
    ("representation.npz", ["evaluate"]),
    ("representation.npz", ["report"]),
    ("topology.npz", ["report"]),
    ("body_distances.npz", ["evaluate"]),
    ("rehearsal.npz", ["plan", *PAIR]),
    ("rehearsal.npz", ["execute", *PAIR, "--rehearse", "2"]),
    ("plans/0-1.npz", ["execute", *PAIR]),
    ("plans/0-1.npz", ["report"]),
]


def refusal(*words) -> str:
    """The last line of a refused command: it may have shown progress before."""
    done = selftouch(*words)
    assert done.status == 2, done
    assert "Traceback" not in done.stderr
    line = done.stderr.strip().splitlines()[-1]
    assert line.startswith("selftouch: ")
    return line.removeprefix("selftouch: ")


def content(folder: Path) -> dict[Path, bytes]:
    return {p: p.read_bytes() for p in folder.rglob("*") if p.is_file() and p.name != ".lock"}


@pytest.mark.parametrize(("name", "command"), READ)
def test_a_damaged_or_foreign_file_is_named_and_left(name, command, run):
    file, (verb, *options) = run / name, command
    whole = file.read_bytes()
    another = run / ("skin.npz" if file.suffix != ".npz" else "experience/part-00000.parquet")
    garbage = bytes(range(256)) * 9
    for damaged in (b"", garbage, whole[: len(whole) // 2], another.read_bytes()):
        file.write_bytes(damaged)
        before = content(run)
        line = refusal(verb, run, *options)
        # Half an experiment may still be YAML: then it is the field that is named.
        assert str(file) in line or name == "experiment.yaml"
        assert content(run) == before


@pytest.mark.parametrize(
    ("name", "command"), [r for r in READ if r[0].endswith(("npz", "metrics.json"))]
)
def test_a_whole_file_of_another_run_is_refused(name, command, run):
    file, (verb, *options) = run / name, command
    if file.suffix == ".json":
        figures = json.loads(file.read_text())
        assert figures["made_for"].startswith("format ")
        file.write_text(json.dumps(figures | {"made_for": "format 2, 0123456789abcdef"}))
    else:
        arrays = load_arrays(file)
        (stamp,) = {"made_for", "belongs_to"} & arrays.keys()
        save_arrays(file, arrays | {stamp: np.array("format 2, 0123456789abcdef")})
    before = content(run)
    line = refusal(verb, run, *options)
    assert line.startswith(f"{file} belongs to another experiment or version; ") or (
        line == f"{file} belongs to another representation; delete it and rehearse again"
    )
    assert content(run) == before


def test_a_plan_that_does_not_fit_together_is_refused(run):
    file = run / "plans" / "0-1.npz"
    plan = load_arrays(file)
    for name, wrong in (
        ("q", plan["q"][:, :3]),
        ("v", plan["v"][:-1]),
        ("time_s", np.full(len(plan["time_s"]), np.nan)),
        ("predicted", np.full(plan["predicted"].shape, "x")),
        ("waypoints_q", np.array(3.0)),
    ):
        save_arrays(file, plan | {name: wrong})
        assert refusal("execute", run, *PAIR).startswith(f"{file} is not a plan: ")


# Every verb that writes, and what it needs beside the run.
WRITING = [
    ["learn"],
    *(
        pytest.param(verb, marks=pytest.mark.slow)
        for verb in (["evaluate"], ["plan", *PAIR], ["execute", *PAIR], ["report"])
    ),
]


@pytest.fixture
def sweep(tmp_path):
    """A sweep file with one run, and the folder of the sweep."""
    file = tmp_path / "small.yaml"
    file.write_text(f"{{experiments: [cube], set: {SMALL}}}")
    return file, tmp_path / "sweep"


@pytest.mark.parametrize("command", WRITING)
def test_a_full_disk_is_reported_by_every_stage_and_nothing_is_lost(command, run, small_files):
    verb, *options = command
    if verb == "learn":
        # This metric trains no network.
        file = run / "experiment.yaml"
        file.write_text(file.read_text().replace("metric: learned", "metric: motor"))
    before = content(run)
    with small_files(4096):
        line = refusal(verb, run, *options)
    assert re.fullmatch(rf"{run}/[\w/.-]+ cannot be written: .*File too large.*", line)
    assert content(run) == before


def test_a_full_disk_is_reported_by_a_sweep(sweep, small_files):
    file, out = sweep
    with small_files(4096):
        line = refusal("sweep", file, "--out", out, "--workers", 1)
    assert re.fullmatch(rf"{out}/runs/[\w/.-]+ cannot be written: .*File too large.*", line)
    assert not list(out.rglob("*.npz"))
    assert not list(out.rglob("*.part"))


@pytest.fixture
def small_files():
    """The operating system refuses larger files, as if the disk were full."""

    @contextmanager
    def limited(size):
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limited


@pytest.fixture
def mere_mortal():
    """Removes root's right to write to read-only folders, in this thread."""
    if os.geteuid() != 0:
        yield
        return
    libc = ctypes.CDLL(None)
    header, rights = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    libc.capget(header, rights)
    effective = rights[0]
    rights[0] &= ~(1 << 1)  # CAP_DAC_OVERRIDE
    if libc.capset(header, rights) != 0:
        pytest.skip("root cannot give up its rights here")
    yield
    rights[0] = effective
    libc.capset(header, rights)


@pytest.mark.parametrize("command", WRITING)
def test_a_folder_that_may_not_be_written_is_reported_before_any_work(command, run, mere_mortal):
    before = content(run)
    run.chmod(0o555)
    try:
        line = refusal(command[0], run, *command[1:])
    finally:
        run.chmod(0o755)
    assert line == f"{run} cannot be written; make it writable, or work on a copy"
    assert content(run) == before


def test_a_sweep_whose_folder_may_not_be_written_is_reported(sweep, mere_mortal):
    file, out = sweep
    out.mkdir()
    out.chmod(0o555)
    try:
        assert str(out) in refusal("sweep", file, "--out", out, "--workers", 1)
    finally:
        out.chmod(0o755)
    assert list(out.iterdir()) == []


@pytest.mark.parametrize("command", WRITING)
def test_every_stage_that_writes_waits_for_no_other(command, run):
    before = content(run)
    with FileLock(run / ".lock"):
        line = refusal(command[0], run, *command[1:])
    assert line == (
        f"{run} is being written by another process; wait for it, or choose another --out"
    )
    assert content(run) == before


def test_what_was_learned_for_another_experiment_is_refused(run):
    file = run / "experiment.yaml"
    other = file.read_text().replace("max_kernel_size: 1000", "max_kernel_size: 999")
    file.write_text(other)
    for verb in (["plan", run, "--from", 0, "--to", 1], ["evaluate", run]):
        assert refusal(*verb) == (
            f"{run / 'representation.npz'} belongs to another experiment or version; "
            f"run `selftouch learn {run}`"
        )


@pytest.mark.slow
def test_learning_that_is_killed_and_done_again_gives_the_same_bytes(run, learned_run):
    process = subprocess.Popen(command("learn", run), stderr=subprocess.DEVNULL)
    while not list(run.glob(".*.part")) and process.poll() is None:
        time.sleep(0.001)
    process.kill()
    process.wait()
    stages.learn(RunDirectory.open(run))
    for name in ("representation.npz", "topology.npz", "body_distances.npz"):
        assert (run / name).read_bytes() == (learned_run / name).read_bytes(), name


def test_a_killed_worker_is_reported(tmp_path):
    # So many walks that the other worker does not end them all meanwhile.
    many = {"babbling": {"num_samples": 40_000, "walk_size": 500}}
    run = RunDirectory.create(tmp_path / "run", load_experiment("cube", many))
    with local_executor(2) as executor:
        doomed = []

        def kill_one(num_rows):
            # Once only: a batch that was ready before is reported after the worker is gone.
            if not doomed:
                doomed.append(next(iter(executor._processes)))
                os.kill(doomed[0], signal.SIGKILL)

        with pytest.raises(ChildProcessError, match="continues from the stored walks"):
            collect_into(run, executor, progress=kill_one)


def test_an_altered_shard_is_named(run):
    shard = run / "experience" / "part-00001.parquet"
    altered = bytearray(shard.read_bytes())
    altered[len(altered) // 3] ^= 0xFF
    shard.write_bytes(altered)
    (run / "representation.npz").unlink()
    assert refusal("learn", run).startswith(f"{shard} is damaged (")
    assert not (run / "representation.npz").exists()


def test_a_shard_too_many_is_refused(run):
    shutil.copy(
        run / "experience" / "part-00000.parquet", run / "experience" / "part-00009.parquet"
    )
    assert refused("learn", run) == (
        f"{run / 'experience'} holds more shards than the {NUM_SHARDS} of this run; remove "
        f"part-{NUM_SHARDS:05}.parquet and those after it"
    )


@pytest.mark.slow
def test_a_dask_cluster_that_loses_a_worker_gives_the_same_bytes(finished_run, tmp_path):
    distributed = pytest.importorskip("distributed")
    experiment = load_experiment("cube", parse_fields(SMALL))
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

        for folder in ("experience", "truth"):
            (run.path / folder).mkdir(exist_ok=True)
            (run.path / folder / ".part-00002.parquet.1.part").write_bytes(b"left by a killed one")
        collect_into(run, executor, progress=kill_one)
    assert stored == [500] * NUM_SHARDS
    assert shards(run.path) == shards(finished_run)


@pytest.mark.slow
def test_learning_on_a_cluster_gives_the_same_bytes(finished_run, tmp_path):
    distributed = pytest.importorskip("distributed")
    run = shutil.copytree(finished_run, tmp_path / "run")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        done = selftouch("learn", run, "--scheduler", cluster.scheduler_address)
        assert done.status == 0, done.err
    for name in ("representation.npz", "touch_model.npz", "topology.npz"):
        assert (run / name).read_bytes() == (finished_run / name).read_bytes()


def test_a_scheduler_that_does_not_exist_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(executors, "ANSWERS_WITHIN", "1s")
    line = refusal(*babble(tmp_path / "run", "--scheduler", "tcp://127.0.0.1:9"))
    assert line.startswith("--scheduler tcp://127.0.0.1:9 does not answer (")


def test_pandas_polars_and_arrow_read_what_numpy_reads(finished_run):
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    reader = ExperienceReader(finished_run / "experience")
    q, sensation = reader.read("q"), reader.read("sensation")
    assert reader.num_rows == len(q) == len(sensation) == 2000
    frame = pandas.read_parquet(finished_run / "experience")
    np.testing.assert_array_equal(np.stack(frame["q"]), q)
    lazy = polars.scan_parquet(finished_run / "experience" / "*.parquet")
    np.testing.assert_array_equal(lazy.select("sensation").collect()["sensation"], sensation)
    table = pyarrow.dataset.dataset(finished_run / "experience").to_table(columns=["q"])
    assert table.column_names == ["q"]
    np.testing.assert_array_equal(np.stack(table["q"].to_pandas()), q)
