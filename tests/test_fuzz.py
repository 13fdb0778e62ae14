"""Any input gives a clear error or a correct result, in time, and harms nothing else.

A few dozen inputs each in the ordinary tests; `make fuzz` tries thousands and prints how many.
"""

import dataclasses
import json
import os
import shutil
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import trimesh
import yaml
from by_hand import laid_by_hand
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from selftouch_drake.agent.body_model.model import BodyModel, rejected
from selftouch_drake.agent.memory import RehearsalMemory
from selftouch_drake.agent.motions import Execution, Motion, Plan
from selftouch_drake.agent.representation.embedded import EmbeddedRepresentation
from selftouch_drake.cli import cli, exit_status
from selftouch_drake.experience.store import (
    Contacts,
    ExperienceReader,
    Shard,
    StoreError,
    WalkCounts,
    read_counts,
    shard_name,
    write_shard,
)
from selftouch_drake.experiment import (
    ExperimentError,
    dump_experiment,
    experiment_from_fields,
    load_experiment,
)
from selftouch_drake.experiment.loading import parse_fields
from selftouch_drake.files import load_arrays, save_arrays
from selftouch_drake.geometry.surfaces import mesh_file
from selftouch_drake.quotient.smooth import smooth_path
from selftouch_drake.run.artifacts import (
    load_body,
    load_body_model,
    load_execution,
    load_memory,
    load_representation,
    save_body_model,
    save_memory,
    save_plan,
)
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.model_text import model_text
from selftouch_drake.sweep.design import load_sweep
from selftouch_drake.sweep.table import read_table

# Each feeds many inputs to a parser.
pytestmark = pytest.mark.slow

NUM_INPUTS = int(os.environ.get("SELFTOUCH_FUZZ", "20"))
TRIED = Counter()

fuzz = settings(
    max_examples=NUM_INPUTS,
    deadline=None,
    derandomize=NUM_INPUTS <= 100,
    database=None,
    suppress_health_check=list(HealthCheck),
)

# What is done to a file: cut off, bytes changed, put in or taken out, a part said twice.
edits = st.lists(
    st.tuples(
        st.sampled_from(["cut", "change", "flip", "insert", "remove", "repeat"]),
        st.floats(0, 1),
        st.binary(min_size=1, max_size=8),
    ),
    min_size=1,
    max_size=4,
)


def damaged(content: bytes, edits) -> bytes:
    for kind, share, new in edits:
        at = int(share * max(len(content) - 1, 0))
        end = at + len(new)
        content = {
            "cut": content[:at],
            "change": content[:at] + new + content[end:],
            "flip": content[:at]
            + bytes(b ^ new[0] for b in content[at : at + 1])
            + content[at + 1 :],
            "insert": content[:at] + new + content[at:],
            "remove": content[:at] + content[end:],
            "repeat": content[:end] + content[at:],
        }[kind]
    return content


def loaded_or_refused(load, errors, *words) -> object:
    """What `load` returns; None if it raises one clear line that contains all of `words`."""
    TRIED[sys._getframe(1).f_code.co_name] += 1
    began = time.process_time()
    try:
        return load()
    except errors as error:
        message = str(error)
        assert message.strip()
        assert len(message) < 1000
        assert "Traceback" not in message
        for word in words:
            assert str(word) in message
        return None
    finally:
        # Of computing, so that a busy machine does not look like a hang.
        assert time.process_time() - began < 10


@pytest.fixture(scope="module", autouse=True)
def print_counts():
    yield
    print(f"\n{sum(TRIED.values()):,} inputs: {dict(TRIED)}")  # noqa: T201


class Made:
    """A run with every kind of file, and their contents."""

    def __init__(self, directory, shard, representation):
        self.directory, self.shard, self.representation = directory, shard, representation


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    small = {"babbling": {"num_samples": 60}, "representation": {"num_targets": 50}}
    experiment = load_experiment("cube", small)
    path = tmp_path_factory.mktemp("fuzz") / "run"
    made = RunDirectory.create(path, experiment)
    random = np.random.default_rng(0)
    shard = Shard(
        walk=0,
        num_steps=1000,
        num_impossible=7,
        step=np.arange(60),
        q=random.uniform(-1, 1, (60, 6)).astype(np.float32),
        sensation=random.uniform(0, 1, (60, 100)).astype(np.float32),
        contacts=Contacts(
            offsets=np.arange(61),
            skin=np.zeros(60, np.int8),
            toucher=np.zeros(60, np.int8),
            p_LC=random.uniform(-1, 1, (60, 3)).astype(np.float32),
        ),
    )
    write_shard(path, shard, fingerprint=made.fingerprint())
    representation = laid_by_hand(
        [*shard.q[:49, None], shard.q[49:]],
        np.stack([np.arange(49), np.arange(1, 50)], axis=1),
        target_sensations=shard.sensation[:50],
        overlap=np.eye(100, dtype=bool),
        set_distance=np.ones((50, 50), np.float32),
        embedding=random.uniform(-1, 1, (50, 3)),
        kind=EmbeddedRepresentation,
    )
    save_arrays(made.representation, representation.to_arrays() | made.stamp())
    topology = {"num_parts": np.array(1), "kernels": np.arange(50), "pieces": np.zeros((0, 3))}
    topology |= {"stress": np.array(0.1), "spectrum": np.linspace(1, 0, 50)}
    topology |= {"doubt": np.array(""), "betti": np.array([1, 0, 1])}
    topology |= {"scales": np.array([3.0, 0.5, 0.2])}
    topology |= {"skin_dimension": np.array(2), "embedding_dimension": np.array(3)}
    topology |= {f"diagram_{dimension}": random.uniform(0, 1, (4, 2)) for dimension in range(3)}
    save_arrays(made.topology, topology | made.stamp())
    save_arrays(made.body_distances, {"distances": np.ones((50, 50), np.float32)} | made.stamp())
    save_memory(made, RehearsalMemory.blank(representation))
    save_body_model(made, chain_of_six(representation))
    save_arrays(made.skin, {"body_p_LS": np.zeros((100, 3)), "body_vertices": np.zeros((4, 3))})
    motion = Motion(
        plan=Plan(
            nodes=np.array([3, 1, 4]),
            links=np.array([2, 3]),
            in_air=np.zeros(2, bool),
            modes=np.full(len(np.array([3, 1, 4])) - 1, -1),
            imagined=np.zeros(len(np.array([3, 1, 4])), bool),
            waypoints_q=random.uniform(-1, 1, (3, 6)),
            waypoint_s=np.arange(3.0),
            path=smooth_path(random.uniform(-1, 1, (3, 6))),
        ),
        time_s=np.arange(7.0),
        s=np.linspace(0, 2, 7),
        q=random.uniform(-1, 1, (7, 6)),
        v=random.uniform(-1, 1, (7, 6)),
        predicted=random.uniform(0, 1, (7, 100)),
        predicted_spread=np.ones(7),
    )
    execution = Execution(
        motion=motion,
        felt=random.uniform(0, 1, (7, 100)),
        q_measured=random.uniform(-1, 1, (7, 6)),
        v_measured=random.uniform(-1, 1, (7, 6)),
        torque=random.uniform(-1, 1, (14, 6)),
    )
    save_plan(made, execution, 3, 4)
    made.add_metrics({"babbling_num_samples": 60, "topology_betti": [1, 0, 1], "x": {"y": 0.5}})
    return Made(made, shard, representation)


def chain_of_six(representation) -> BodyModel:
    """A model in which each joint carries the next one, and the last one touches."""
    blank = rejected(
        "it is made by hand",
        joint_names=tuple("abcdef"),
        kernel_part=representation.part,
        num_rows=representation.num_rows,
        num_receptors=100,
    )
    return dataclasses.replace(
        blank,
        joint_parent=np.arange(6) - 1,
        joint_kind=np.ones(6, dtype=int),
        twists=np.random.default_rng(0).normal(size=(6, 6)),
        part_link=np.array([-1]),
        toucher_link=np.array([5]),
        toucher_place=np.ones((1, 3)),
        covariance=np.full((39, 39), np.nan),
        toucher_shape=np.zeros((1, 5)),
        accepted_by_part=np.array([True]),
    )


def put(path, content: bytes):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


# ---- experiments and sweeps ----

tokens = st.sampled_from(
    [
        *("skins", "body", "surface", "shape", "mesh", "robot", "packages", "touching", "frame"),
        *("link", "seed", "name", "sphere", "semi_axes", "imperfections", "collision"),
        *("joints", "noise", "grid", "each", "cases", "seeds", "experiments", "set", "dead"),
        *(
            "skins.body.num_receptors",
            "a.b",
            "..",
            "cube",
            "/dev/zero",
            "../../etc/passwd",
            "nan",
            "1e9",
        ),
        *(": ", ", ", "{", "}", "[", "]", "\n", "\n  ", "- ", "? ", "&a ", "*a", "<<: *a", "# "),
        *("!!int ", "!!float ", "!!binary ", "!!set ", "!!python/object:os.system ", "!!bool "),
        *("'", '"', "\\x00", "\\ud800", "\0", "\ufeff", "\x85", "\t", "---", "...", "%YAML 1.1"),
        *("0x", "0b_", "1e999", ".nan", "-.inf", "1:61:1", "2026-02-30", "~", "=", "yes", "é"),
    ]
)
texts = st.lists(tokens, max_size=14).map("".join) | st.text(max_size=60)
WHOLE = dump_experiment(load_experiment("two_arms")).encode()
SWEEP = b"""experiments: [cube]
seeds: [0, 1]
set: {babbling: {num_samples: 1000}}
grid: {skins.body.num_receptors: [50, 100], representation.num_targets: [60, 70]}
each: {joints.noise: [0, 0.1]}
cases: [{skins: {body: {imperfections: {dead: 0.1}}}}]
"""


def again(experiment):
    if experiment is not None:
        assert experiment_from_fields(yaml.safe_load(dump_experiment(experiment))) == experiment


@fuzz
@given(text=texts)
def test_any_override(text):
    again(loaded_or_refused(lambda: load_experiment("cube", parse_fields(text)), ExperimentError))


@fuzz
@given(edits=edits)
def test_a_damaged_experiment(edits, tmp_path_factory):
    path = put(tmp_path_factory.getbasetemp() / "any.yaml", damaged(WHOLE, edits))
    again(loaded_or_refused(lambda: load_experiment(path), ExperimentError))


@fuzz
@given(content=texts.map(lambda text: text.encode("utf-8", "surrogatepass")) | st.binary())
def test_any_sweep(content, tmp_path_factory):
    path = put(tmp_path_factory.getbasetemp() / "any_sweep.yaml", content)
    loaded_or_refused(lambda: load_sweep(path), ExperimentError)


@fuzz
@given(edits=edits)
def test_a_damaged_sweep(edits, tmp_path_factory):
    path = put(tmp_path_factory.getbasetemp() / "any_sweep.yaml", damaged(SWEEP, edits))
    sweep = loaded_or_refused(lambda: load_sweep(path), ExperimentError)
    if sweep is not None:
        assert len(set(map(dump_experiment, sweep.experiments))) == len(sweep.experiments)


# ---- what a run holds ----


@fuzz
@given(edits=edits, folder=st.sampled_from(["experience", "truth"]))
def test_a_damaged_shard(edits, folder, run, tmp_path_factory):
    there = tmp_path_factory.getbasetemp() / "store"
    whole = (run.directory.path / folder / shard_name(0)).read_bytes()
    path = put(there / folder / shard_name(0), damaged(whole, edits))
    fingerprint = run.directory.fingerprint()

    def load():
        steps = read_counts(there, 0, num_rows=60, fingerprint=fingerprint, folder=folder)
        reader = ExperienceReader(there / folder)
        assert reader.num_rows == 60
        if folder == "truth":
            return steps, vars_of(Contacts.joined(list(reader.contacts())))
        return steps, {column: reader.read(column) for column in ("q", "sensation")}

    def vars_of(contacts):
        return {name: getattr(contacts, name) for name in ("offsets", "skin", "toucher", "p_LC")}

    found = loaded_or_refused(load, StoreError, path)
    if found is not None:
        assert found[0] == WalkCounts(1000, 7, 60)
        expected = {"q": run.shard.q, "sensation": run.shard.sensation}
        for name, array in found[1].items():
            there = expected[name] if folder == "experience" else vars_of(run.shard.contacts)[name]
            np.testing.assert_array_equal(array, there)


kinds = st.sampled_from(
    [
        pa.list_(pa.float32(), 6),
        pa.list_(pa.float64(), 6),
        pa.list_(pa.string(), 1),
        pa.list_(pa.float32()),
        pa.float32(),
        pa.list_(pa.float32(), 0),
        pa.list_(pa.list_(pa.float32(), 2), 3),
    ]
)


@fuzz
@given(kind=kinds, num_rows=st.integers(0, 3), null=st.booleans())
def test_a_foreign_shard(kind, num_rows, null, tmp_path_factory):
    there = tmp_path_factory.getbasetemp() / "foreign"
    path = put(there / shard_name(0), b"")
    inner = kind
    entry = 1.5
    sizes = []
    while pa.types.is_fixed_size_list(inner) or pa.types.is_list(inner):
        sizes.append(getattr(inner, "list_size", 2))
        inner = inner.value_type
    entry = "x" if pa.types.is_string(inner) else 1.5
    for size in reversed(sizes):
        entry = [entry] * size
    values = [None if null and row == 1 else entry for row in range(num_rows)]
    pq.write_table(pa.table({"q": pa.array(values, kind)}), path)
    q = loaded_or_refused(lambda: ExperienceReader(there).read("q"), StoreError, path)
    if q is not None:
        assert q.dtype == np.float32
        assert q.shape == (num_rows, 6)
        assert (q == 1.5).all()


@pytest.fixture
def copy(run, tmp_path_factory):
    """Another run of the same experiment, whose files may be damaged."""
    path = tmp_path_factory.getbasetemp() / "copy"
    if not path.exists():
        shutil.copytree(run.directory.path, path)
    return RunDirectory(path, run.directory.experiment)


@fuzz
@given(edits=edits)
def test_a_damaged_representation(edits, run, copy):
    path = put(copy.representation, damaged(run.directory.representation.read_bytes(), edits))
    found = loaded_or_refused(lambda: load_representation(copy), ValueError, path)
    if found is not None:
        for name in ("target_sensations", "kernel_q", "kernel_offsets", "edges", "part"):
            np.testing.assert_array_equal(getattr(found, name), getattr(run.representation, name))


arrays = st.sampled_from(
    [
        np.zeros(()),
        np.zeros(0),
        np.zeros((50, 3)),
        np.full((50, 50), np.nan),
        np.array(["x"]),
        np.arange(60),
        np.arange(51) - 7,
        np.array([[0, 99]]),
        np.zeros((60, 6), dtype=complex),
        np.array(b"\xff"),
    ]
)


def with_foreign(data, file):
    """The content of a file with some arrays replaced."""
    content = load_arrays(file)
    for name in data.draw(st.sets(st.sampled_from(sorted(content)), min_size=1, max_size=3)):
        content[name] = data.draw(arrays)
    return content


@fuzz
@given(data=st.data())
def test_a_foreign_representation(data, run, copy):
    save_arrays(copy.representation, with_foreign(data, run.directory.representation))
    loaded_or_refused(lambda: load_representation(copy), ValueError, copy.representation)


@fuzz
@given(edits=edits, name=st.sampled_from(["topology", "body_distances"]))
def test_a_damaged_body(edits, name, run, copy):
    whole = {n: getattr(run.directory, n).read_bytes() for n in ("topology", "body_distances")}
    for other, content in whole.items():
        put(getattr(copy, other), content)
    path = put(getattr(copy, name), damaged(whole[name], edits))
    found = loaded_or_refused(lambda: load_body(copy, run.representation), ValueError, path)
    if found is not None:
        assert [len(part.kernels) for part in found.parts] == [50]


@fuzz
@given(data=st.data(), name=st.sampled_from(["topology", "body_distances"]))
def test_a_foreign_body(data, name, run, copy):
    for other in ("topology", "body_distances"):
        put(getattr(copy, other), getattr(run.directory, other).read_bytes())
    save_arrays(getattr(copy, name), with_foreign(data, getattr(run.directory, name)))
    loaded_or_refused(lambda: load_body(copy, run.representation), ValueError, getattr(copy, name))


@fuzz
@given(edits=edits)
def test_a_damaged_body_model(edits, run, copy):
    path = put(copy.body_model, damaged(run.directory.body_model.read_bytes(), edits))
    found = loaded_or_refused(lambda: load_body_model(copy), ValueError, path)
    if found is not None:
        np.testing.assert_array_equal(found.twists, load_body_model(run.directory).twists)


@fuzz
@given(data=st.data())
def test_a_foreign_body_model(data, run, copy):
    save_arrays(copy.body_model, with_foreign(data, run.directory.body_model))
    found = loaded_or_refused(lambda: load_body_model(copy), ValueError, copy.body_model)
    if found is not None:
        found.place(np.zeros((2, len(found.joint_names))), np.zeros(2, dtype=int))
        model_text(found)


@fuzz
@given(edits=edits)
def test_a_damaged_memory(edits, run, copy):
    path = put(copy.rehearsal, damaged(run.directory.rehearsal.read_bytes(), edits))
    found = loaded_or_refused(lambda: load_memory(copy, run.representation), ValueError, path)
    if found is not None:
        np.testing.assert_array_equal(found.link_penalty, 1.0)
        assert found.num_tries == 0


@fuzz
@given(data=st.data())
def test_a_foreign_memory(data, run, copy):
    save_arrays(copy.rehearsal, with_foreign(data, run.directory.rehearsal))
    loaded_or_refused(lambda: load_memory(copy, run.representation), ValueError, copy.rehearsal)


@fuzz
@given(edits=edits)
def test_a_damaged_plan(edits, run, copy):
    path = put(copy.plan(3, 4), damaged(run.directory.plan(3, 4).read_bytes(), edits))
    found = loaded_or_refused(lambda: load_execution(copy, 3, 4), ValueError, path)
    if found is not None:
        expected = load_execution(run.directory, 3, 4).to_arrays()
        for name, array in found.to_arrays().items():
            np.testing.assert_array_equal(array, expected[name])


@fuzz
@given(data=st.data())
def test_a_foreign_plan(data, run, copy):
    save_arrays(copy.plan(3, 4), with_foreign(data, run.directory.plan(3, 4)))
    loaded_or_refused(
        lambda: load_execution(copy, 3, 4), ValueError, copy.plan(3, 4).name.split(".")[0]
    )


@fuzz
@given(content=st.binary(max_size=60) | edits.map(lambda e: damaged(b"PK\x03\x04" * 9, e)))
def test_any_arrays(content, tmp_path_factory):
    path = put(tmp_path_factory.getbasetemp() / "any_arrays.npz", content)
    loaded_or_refused(lambda: load_arrays(path), ValueError, path)


@fuzz
@given(data=st.data())
def test_any_figures(data, run, tmp_path_factory):
    there = tmp_path_factory.getbasetemp() / "figures"
    whole = (run.directory.path / "metrics.json").read_bytes()
    content = data.draw(edits.map(lambda e: damaged(whole, e)) | st.binary(max_size=40))
    path = put(there / "metrics.json", content)
    # Its models are known, and need not be read each time.
    put(there / "models.json", (run.directory.path / "models.json").read_bytes())
    found = loaded_or_refused(RunDirectory(there, run.directory.experiment).metrics, RunError, path)
    if found is not None:
        assert json.loads(json.dumps(found)) == found or "NaN" in json.dumps(found)


@fuzz
@given(edits=edits)
def test_a_damaged_table(edits, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "table.parquet"
    columns = {"run": ["a", "b"], "experiment": ["c", "d"], "seed": [1, 2], "error": [None, "e"]}
    table = pa.table(columns).replace_schema_metadata({"selftouch.fields": ""})
    pq.write_table(table, path, write_page_checksum=True)
    put(path, damaged(path.read_bytes(), edits))
    loaded_or_refused(lambda: read_table(path), ValueError, path)


# ---- meshes ----

BALL = trimesh.creation.icosphere(subdivisions=1, radius=0.2)
MESHES = {suffix: BALL.export(file_type=suffix) for suffix in ("obj", "stl", "ply")}
MESHES = {k: v.encode() if isinstance(v, str) else v for k, v in MESHES.items()}


@fuzz
@given(suffix=st.sampled_from(sorted(MESHES)), data=st.data())
def test_a_damaged_mesh(suffix, data, tmp_path_factory):
    content = data.draw(edits.map(lambda e: damaged(MESHES[suffix], e)) | st.binary(max_size=99))
    path = put(tmp_path_factory.getbasetemp() / f"any.{suffix}", content)
    surface = loaded_or_refused(lambda: mesh_file(path, resolution=0.2), ValueError, path)
    if surface is not None:
        assert surface.is_watertight
        assert surface.volume > 0
        assert np.isfinite(surface.vertices).all()


# ---- the command line ----

words = st.sampled_from(
    [
        *("run", "babble", "learn", "plan", "execute", "evaluate", "report", "sweep", "RUN"),
        *("robot", "experiments", "--show"),
        *("--from", "--to", "--through", "--from-q", "--set", "--rehearse", "-h", "--"),
        *("3", "-1", "99999999999999999999", "1,2", "1,,2", "nan,inf", "0,0,0,0,0,0", "{", "é\0"),
        *("--out=/proc/nowhere", "--version", "--port=1", "--workers=0", "nothing"),
    ]
)


@fuzz
@given(arguments=st.lists(words | st.text(max_size=5), max_size=6))
def test_any_command(arguments, run, tmp_path_factory, capsys):
    """Nothing is computed here: commands are refused, or find no run."""
    there = tmp_path_factory.getbasetemp() / "nowhere"
    there.mkdir(exist_ok=True)
    here = Path.cwd()
    line = [str(there / "run") if word == "RUN" else word for word in arguments]
    if line[:1] in (["run"], ["babble"], ["sweep"], ["robot"]):
        line = [line[0], "no_such_experiment", *line[1:]]
    os.chdir(there)
    try:
        TRIED["test_any_command"] += 1
        status = exit_status(lambda: cli.main(line, prog_name="selftouch", standalone_mode=False))
    finally:
        os.chdir(here)
    assert status in (0, 2)
    written = capsys.readouterr().err
    assert "Traceback" not in written
    assert (status == 2) == written.startswith("selftouch: ")
    assert list(there.iterdir()) == []
