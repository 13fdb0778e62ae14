"""Every field of an experiment does something: change it, run a command, and see the difference.

A field that is ignored leaves the result as it was, and its row fails.
"""

import dataclasses
import json
import re
import shutil
import typing
from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
import pytest
import trimesh
import yaml
from commands import selftouch

from selftouch_drake.experience.store import ExperienceReader
from selftouch_drake.experiment import Experiment, load_experiment
from selftouch_drake.experiment.loading import merged
from selftouch_drake.run.directory import RunDirectory

# A sphere with few triangles and receptors: quick to build, and touched often.
SPHERE = {"shape": "sphere", "radius": 0.25, "resolution": 0.06}
LITTLE = {
    "skins": {"body": {"surface": SPHERE, "num_receptors": 20}},
    "babbling": {"num_samples": 60, "walk_size": 60},
    "representation": {"num_targets": 50},
}
# The one pair that `finished_run` planned and executed.
START, GOAL = 39, 43


def nested(field, value):
    """`{"joints": {"noise": 0.1}}` for `joints.noise`."""
    for key in reversed(field.split(".")):
        value = {key: value}
    return value


def surface(shape, **fields):
    return nested("skins.body.surface", {"shape": shape, "resolution": 0.06} | fields)


def change(after=30, **fields):
    return {"changes": [{"after": after, **fields}]}


def of_skin(**fields):
    return change(skins={"body": fields})


# --- What commands make of an experiment.


def robot(overrides):
    """What `selftouch robot` prints."""
    done = selftouch("robot", "sphere", "--set", yaml.safe_dump(merged(LITTLE, overrides)))
    assert done.status == 0, done.stderr
    return done.stdout


@cache
def _babbled(text, folder):
    path = folder / f"run{len(list(folder.iterdir()))}"
    words = ("babble", "sphere", "--out", path, "--workers", 1, "--set", text)
    done = selftouch(*words)
    assert done.status == 0, done.stderr
    read = ExperienceReader(RunDirectory.open(path).experience)
    return {name: np.concatenate(list(read.batches(name))) for name in ("q", "sensation")} | {
        "num_walks": len(list(RunDirectory.open(path).experience.glob("*.parquet"))),
        "name": RunDirectory.open(path).experiment.name,
    }


@pytest.fixture(scope="session")
def babbled(tmp_path_factory):
    """The experience that `selftouch babble` stores."""
    folder = tmp_path_factory.mktemp("babbled")
    return lambda overrides: _babbled(yaml.safe_dump(merged(LITTLE, overrides)), folder)


@pytest.fixture(scope="session")
def changed_run(finished_run, tmp_path_factory):
    """What a command makes of a finished run whose experiment is changed: text, metrics, plan."""

    @cache
    def result(text, *words):
        path = tmp_path_factory.mktemp("changed") / "run"
        shutil.copytree(finished_run, path)
        file = path / "experiment.yaml"
        # The first line says that the file belongs to a run.
        first, rest = file.read_text().split("\n", 1)
        fields = merged(yaml.safe_load(rest), yaml.safe_load(text))
        file.write_text(f"{first}\n{yaml.safe_dump(fields, sort_keys=False)}")
        if fields["representation"]["body_model"] == "off":
            (path / "body_model.npz").unlink()
        done = selftouch(words[0], path, *words[1:])
        assert done.status == 0, done.stderr
        plan = path / "plans" / f"{START}-{GOAL}.npz"
        return {
            "text": done.stdout.replace(str(path), ""),
            "metrics": json.loads((path / "metrics.json").read_text()),
            # Who learns anew forgets the plans.
            "plan": dict(np.load(plan)) if plan.exists() else {},
        }

    return lambda overrides, *words: result(yaml.safe_dump(overrides), *words)


def differs(one, other):
    if isinstance(one, dict):
        return any(differs(one[key], other[key]) for key in one)
    return not np.array_equal(one, other)


def sensed(check: Callable) -> Callable:
    """A check of the sensations after and before."""
    return lambda new, old: check(new["sensation"], old["sensation"])


def strides(felt):
    """Median distance between configurations that were kept one after another."""
    return float(np.median(np.abs(np.diff(felt["q"], axis=0)).sum(axis=1)))


def zero_columns(sensation):
    return (sensation == 0).all(axis=0)


# --- The table: field, change, what it is compared with (overrides), and what must differ.

IMPERFECT = "skins.body.imperfections."
DESCRIBED = {
    "robot.directives": (
        nested("robot.directives", "package://selftouch_drake/two_fingers.dmd.yaml")
        | nested("touching.another", {"frame": "fingertip_1", "radius": 0.01}),
        {},
    ),
    "robot.joints": (nested("robot.joints", ["elbow_pitch", "shoulder_yaw"]), {}),
    "skins.NAME.link": (nested("skins.body.link", "upper_arm"), {}),
    "skins.NAME.surface.shape": (surface("cube", side=0.44), {}),
    "skins.NAME.surface.radius": (surface("sphere", radius=0.2), {}),
    "skins.NAME.surface.side": (surface("cube", side=0.4), surface("cube", side=0.44)),
    "skins.NAME.surface.major_radius": (
        surface("torus", major_radius=0.3, minor_radius=0.09),
        surface("torus", major_radius=0.2, minor_radius=0.09),
    ),
    "skins.NAME.surface.minor_radius": (
        surface("torus", major_radius=0.2, minor_radius=0.1),
        surface("torus", major_radius=0.2, minor_radius=0.09),
    ),
    "skins.NAME.surface.height": (
        surface("cylinder", radius=0.2, height=0.3),
        surface("cylinder", radius=0.2, height=0.4),
    ),
    "skins.NAME.surface.length": (
        surface("capsule", radius=0.2, length=0.1),
        surface("capsule", radius=0.2, length=0.2),
    ),
    "skins.NAME.surface.semi_axes": (
        surface("ellipsoid", semi_axes=[0.3, 0.2, 0.2]),
        surface("ellipsoid", semi_axes=[0.3, 0.3, 0.2]),
    ),
    "skins.NAME.surface.resolution": (
        surface("sphere", radius=0.25, resolution=0.1),
        {},
    ),
    "skins.NAME.thickness": (nested("skins.body.thickness", 0.02), {}),
    "skins.NAME.num_receptors": (nested("skins.body.num_receptors", 30), {}),
}
BABBLED = {
    "name": (nested("name", "other"), {}, lambda new, old: new["name"] == "other"),
    "seed": (nested("seed", 1), {}, differs),
    "skins.NAME.surface.translation": (
        surface("sphere", radius=0.25, translation=[0, 0, 0.05]),
        {},
        differs,
    ),
    "skins.NAME.surface.rpy_deg": (
        surface("cube", side=0.44, rpy_deg=[0, 0, 45]),
        surface("cube", side=0.44),
        differs,
    ),
    "skins.NAME.hydroelastic_modulus": (
        nested("skins.body.hydroelastic_modulus", 6e4),
        {},
        sensed(lambda new, old: new == pytest.approx(2 * old)),
    ),
    "skins.NAME.unevenness": (nested("skins.body.unevenness", 0.8), {}, sensed(differs)),
    "skins.NAME.field_width": (
        nested("skins.body.field_width", 2.0),
        {},
        sensed(lambda new, old: (new > 0).sum() > 1.5 * (old > 0).sum()),
    ),
    "skins.NAME.imperfections.cross_talk": (
        nested(f"{IMPERFECT}cross_talk", 0.5),
        {},
        sensed(lambda new, old: (new > 0).sum() > 1.2 * (old > 0).sum()),
    ),
    "skins.NAME.imperfections.multiplicative_noise": (
        nested(f"{IMPERFECT}multiplicative_noise", 0.2),
        {},
        sensed(lambda new, old: 0.1 < np.std(new[old > 0] / old[old > 0]) < 0.3),
    ),
    "skins.NAME.imperfections.additive_noise": (
        nested(f"{IMPERFECT}additive_noise", 0.05),
        {},
        sensed(lambda new, old: differs(new, old) and new[new > 0].min() >= 0.3),
    ),
    "skins.NAME.imperfections.saturation": (
        nested(f"{IMPERFECT}saturation", 1.0),
        {},
        sensed(lambda new, old: new.max() == 1.0 < old.max()),
    ),
    "skins.NAME.imperfections.quantisation": (
        nested(f"{IMPERFECT}quantisation", 0.25),
        {},
        sensed(lambda new, old: not differs(4 * new, np.round(4 * new))),
    ),
    "skins.NAME.imperfections.dead": (
        nested(f"{IMPERFECT}dead", 0.5),
        {},
        sensed(lambda new, old: zero_columns(new).sum() >= 10 > zero_columns(old).sum()),
    ),
    "skins.NAME.imperfections.threshold": (
        nested(f"{IMPERFECT}threshold", 0.5),
        {},
        sensed(lambda new, old: new[new > 0].min() >= 0.5 > old[old > 0].min()),
    ),
    "skins.NAME.imperfections.delay": (
        merged(nested("babbling.mode", "dynamic"), nested(f"{IMPERFECT}delay", 0.1)),
        nested("babbling.mode", "dynamic"),
        # The same is felt, later: elsewhere.
        lambda new, old: differs(new["q"], old["q"]),
    ),
    "touching.NAME.frame": (nested("touching.fingertip_0.frame", "hand"), {}, differs),
    "touching.NAME.radius": (nested("touching.fingertip_0.radius", 0.03), {}, differs),
    "joints.noise": (
        nested("joints.noise", 0.05),
        {},
        lambda new, old: (
            0.02 < np.std(new["q"] - old["q"]) < 0.08
            and not differs(new["sensation"], old["sensation"])
        ),
    ),
    "babbling.strategy": (nested("babbling.strategy", "active"), {}, differs),
    "babbling.seek": (
        nested("babbling", {"strategy": "active", "seek": "postures"}),
        nested("babbling.strategy", "active"),
        differs,
    ),
    "babbling.mode": (nested("babbling.mode", "dynamic"), {}, differs),
    "babbling.num_samples": (
        nested("babbling.num_samples", 70),
        {},
        lambda new, old: len(new["q"]) == 70 and len(old["q"]) == 60,
    ),
    "babbling.step_size": (
        nested("babbling.step_size", 0.01),
        {},
        lambda new, old: strides(new) < 0.3 * strides(old),
    ),
    "babbling.persistence": (nested("babbling.persistence", 0.0), {}, differs),
    "babbling.step_duration": (
        nested("babbling", {"mode": "dynamic", "step_duration": 0.5}),
        nested("babbling.mode", "dynamic"),
        lambda new, old: strides(new) < 0.7 * strides(old),
    ),
    "babbling.jumps": (
        nested("babbling", {"mode": "dynamic", "jumps": False, "walk_size": 30}),
        nested("babbling", {"mode": "dynamic", "walk_size": 30}),
        lambda new, old: differs(new["q"], old["q"]),
    ),
    "babbling.walk_size": (
        nested("babbling.walk_size", 20),
        {},
        lambda new, old: new["num_walks"] == 3 and old["num_walks"] == 1,
    ),
    "changes.NAME.after": (
        change(after=50, links={"forearm": 0.3}),
        change(after=20, links={"forearm": 0.3}),
        differs,
    ),
    "changes.NAME.links": (change(links={"forearm": 0.3}), change(), differs),
    "changes.NAME.joints": (change(joints={"elbow_pitch": 0.3}), change(), differs),
    "changes.NAME.tools": (change(tools={"fingertip_0": [0.05, 0, 0]}), change(), differs),
    "changes.NAME.skins.NAME.dead": (
        of_skin(dead=list(range(15))),
        change(),
        sensed(lambda new, old: zero_columns(new[30:])[:15].all()),
    ),
    "changes.NAME.skins.NAME.dead_share": (
        of_skin(dead_share=0.7),
        change(),
        sensed(lambda new, old: zero_columns(new[30:]).sum() >= 14),
    ),
    "changes.NAME.skins.NAME.new": (
        merged(nested(f"{IMPERFECT}dead", 0.5), of_skin(new=list(range(20)))),
        merged(nested(f"{IMPERFECT}dead", 0.5), change()),
        sensed(lambda new, old: zero_columns(new[30:]).sum() < zero_columns(old[30:]).sum()),
    ),
    "changes.NAME.skins.NAME.swapped": (
        of_skin(swapped=[[k, k + 1] for k in range(0, 20, 2)]),
        change(),
        sensed(
            lambda new, old: (
                not differs(new[:30], old[:30])
                and not differs(new[30:], old[30:].reshape(-1, 10, 2)[:, :, ::-1].reshape(-1, 20))
            )
        ),
    ),
    "changes.NAME.skins.NAME.swapped_share": (
        of_skin(swapped_share=1.0),
        change(),
        sensed(
            lambda new, old: (
                differs(new[30:], old[30:])
                and new[30:].sum(axis=1) == pytest.approx(old[30:].sum(axis=1))
            )
        ),
    ),
    "changes.NAME.skins.NAME.translation": (of_skin(translation=[0, 0, 0.03]), change(), differs),
    "changes.NAME.skins.NAME.rpy_deg": (of_skin(rpy_deg=[0, 0, 40]), change(), differs),
    "changes.NAME.skins.NAME.stretch": (of_skin(stretch=0.9), change(), differs),
}
PLAN, EXECUTE = ("plan", "--from", START, "--to", GOAL), ("execute", "--from", START, "--to", GOAL)


MODEL = "representation.body_model"


def of_plan(key, check):
    return lambda new, old: check(new["plan"][key], old["plan"][key])


def duration(new, old):
    return new["plan"]["time_s"][-1] > 1.5 * old["plan"]["time_s"][-1]


def tracking(done):
    return float(re.search(r"tracking: ([0-9.e-]+)", done["text"])[1])


def of_metric(check):
    return lambda new, old: check(new["metrics"], old["metrics"])


ACTED = {
    "planning.knot_spacing": (PLAN, nested("planning.knot_spacing", 0.5), of_plan("q", differs)),
    "planning.prefer": (PLAN, nested("planning.prefer", "joints"), of_plan("q", differs)),
    "execution.max_velocity": (PLAN, nested("execution.max_velocity", 0.1), duration),
    "execution.max_acceleration": (PLAN, nested("execution.max_acceleration", 0.1), duration),
    "execution.time_step": (
        EXECUTE,
        nested("execution.time_step", 0.004),
        of_plan("felt", differs),
    ),
    "execution.stiffness": (
        EXECUTE,
        nested("execution.stiffness", 200.0),
        lambda new, old: tracking(new) > 1.4 * tracking(old),
    ),
    "execution.damping": (
        EXECUTE,
        nested("execution.damping", 10.0),
        of_plan("felt", differs),
    ),
    "joints.offset": (
        EXECUTE,
        nested("joints.offset", 0.05),
        lambda new, old: tracking(new) > 2 * tracking(old),
    ),
    "representation.num_targets": (
        ("learn",),
        nested("representation.num_targets", 70),
        of_metric(lambda new, old: new["representation_num_targets"] == 70),
    ),
    "representation.max_kernel_size": (
        ("learn",),
        nested("representation.max_kernel_size", 20),
        of_metric(lambda new, old: new["kernel_size_max"] == 20 < old["kernel_size_max"]),
    ),
    "representation.metric": (
        ("learn",),
        nested("representation.metric", "motor"),
        of_metric(lambda new, old: new["topology_margin"] != old["topology_margin"]),
    ),
    MODEL: (
        ("learn",),
        nested(MODEL, "off"),
        of_metric(lambda new, old: "body_model_wall_s" in old and "body_model_wall_s" not in new),
    ),
    "evaluation.num_pairs": (
        ("evaluate", "--workers", 1),
        nested("evaluation.num_pairs", 2),
        of_metric(lambda new, old: new["planning_num_pairs"] == 2),
    ),
    "evaluation.shape_metrics": (
        ("evaluate", "--workers", 1),
        nested("evaluation.shape_metrics", ["motor"]),
        of_metric(
            lambda new, old: (
                set(new["shape_rms_fraction_by_metric"]) < set(old["shape_rms_fraction_by_metric"])
            )
        ),
    ),
    "execution.max_tries": (
        ("evaluate", "--workers", 1),
        nested("joints.offset", 0.06) | nested("execution.max_tries", 2),
        of_metric(lambda new, old: new["rehearsal_tries_mean"] == 2.0),
    ),
}
# Why a field has no row here.
EXEMPT = {
    "robot.packages": "tests/run/test_mistakes.py: a package that is not given is not found",
    "robot.collision_depth": "tests/robot/test_collisions.py: postures that it allows",
    "skins.NAME.surface.mesh": "test_meshes_are_read_in_their_unit below",
    "skins.NAME.surface.scale": "test_meshes_are_read_in_their_unit below",
    "skins.NAME.receptors.file": "tests/robot/test_receptor_files.py",
    "skins.NAME.receptors.scale": "tests/robot/test_receptor_files.py",
    "skins.NAME.receptors.part": "tests/robot/test_receptor_files.py",
    "skins.NAME.reading.mode": "tests/robot/test_readings.py",
    "skins.NAME.reading.threshold": "tests/robot/test_readings.py",
    "skins.NAME.reading.hysteresis": "tests/robot/test_readings.py",
    "skins.NAME.reading.bits": "tests/robot/test_readings.py",
    "skins.NAME.reading.full_scale": "tests/robot/test_readings.py",
    "touching.NAME.link": "tests/robots/test_shipped.py: the hands of the infant",
    "execution.touch_servo": "tests/run/test_acting.py: contact with it and without it",
    "python.file": "tests/bodies/test_own.py",
    "python.class_": "tests/bodies/test_own.py",
    "python.arguments": "tests/bodies/test_own.py",
    "python.timeout_s": "tests/bodies/test_own.py",
    "babbling.robot_hours": "tests/bodies/test_lives.py: babbling ends when they are over",
    "gymnasium.env": "tests/bodies/test_gymnasium.py",
    "gymnasium.arguments": "tests/bodies/test_gymnasium.py",
    "gymnasium.joints": "tests/bodies/test_gymnasium.py",
    "gymnasium.touch": "tests/bodies/test_gymnasium.py",
    "gymnasium.joint_names": "tests/bodies/test_gymnasium.py",
    "gymnasium.lower": "tests/bodies/test_gymnasium.py",
    "gymnasium.upper": "tests/bodies/test_gymnasium.py",
    "gymnasium.velocity": "tests/bodies/test_gymnasium.py",
    "gymnasium.acceleration": "tests/bodies/test_gymnasium.py",
    "gymnasium.action": "tests/bodies/test_gymnasium.py",
    "gymnasium.step_s": "tests/bodies/test_gymnasium.py",
    "gymnasium.set_posture": "tests/bodies/test_gymnasium.py",
    "gymnasium.reset_option": "tests/bodies/test_gymnasium.py",
    "imported.source": "only says where the data were",
    "imported.content": "tests/run/test_imported.py: other rows are another run",
    "imported.joints": "tests/run/test_imported.py: names of the columns of a joint trajectory",
    "imported.num_receptors": "tests/run/test_imported.py",
    "imported.max_velocity": "tests/run/test_imported.py",
    "imported.max_acceleration": "tests/run/test_imported.py",
}


def row(field, slow):
    return pytest.param(field, marks=pytest.mark.slow if slow else ())


def is_slow(field):
    """Under dynamics, or tested in its own room too."""
    return field.startswith("changes") or field.endswith(
        ("delay", "mode", "jumps", "step_duration")
    )


@pytest.mark.parametrize("field", DESCRIBED)
def test_the_description_of_the_robot_shows(field):
    overrides, other = DESCRIBED[field]
    assert robot(overrides) != robot(other)


@pytest.mark.parametrize("field", [row(field, is_slow(field)) for field in BABBLED])
def test_babbling_shows(field, babbled):
    overrides, other, check = BABBLED[field]
    assert check(babbled(overrides), babbled(other))


@pytest.mark.parametrize(
    "field",
    [row(field, words[0] in ("learn", "evaluate")) for field, (words, *_) in ACTED.items()],
)
def test_what_the_agent_learns_and_does_shows(field, changed_run):
    words, overrides, check = ACTED[field]
    # A body model takes longer than all else that is learned, and matters to its own row alone.
    # Where there is one, plans are imagined, and need not be told what to prefer.
    without_model = words == ("learn",) or field == "planning.prefer"
    given = nested(MODEL, "off") if without_model and field != MODEL else {}
    assert check(changed_run(merged(given, overrides), *words), changed_run(given, *words))


def test_meshes_are_read_in_their_unit(tmp_path):
    """`surface.mesh` and `surface.scale`: the area of the skin follows."""

    def area(radius, scale):
        file = tmp_path / f"ball_{radius}.ply"
        trimesh.creation.icosphere(radius=radius).export(file)
        fields = {"mesh": str(file), "scale": scale, "resolution": 0.06}
        text = robot(nested("skins.body.surface", fields))
        return float(re.search(r"([0-9]+) cm²", text)[1])

    assert area(0.25, 1.0) == pytest.approx(area(250, 0.001), rel=0.01)
    assert area(0.2, 1.0) < 0.7 * area(0.25, 1.0)


def leaves(schema: type, prefix: str = "") -> Iterator[str]:
    """Dotted names of all fields below a settings class; NAME stands for a name or a number."""
    for name, hint in typing.get_type_hints(schema).items():
        inner = [hint, *typing.get_args(hint)]
        below = [kind for kind in inner if dataclasses.is_dataclass(kind)]
        several = typing.get_origin(hint) in (dict, list)
        for kind in below:
            yield from leaves(kind, f"{prefix}{name}.{'NAME.' if several else ''}")
        if not below:
            yield f"{prefix}{name}"


def test_every_field_is_in_the_table():
    rows = [*DESCRIBED, *BABBLED, *ACTED, *EXEMPT]
    assert sorted(rows) == sorted(leaves(Experiment))


def test_the_pair_of_the_small_run_is_that_of_the_table(finished_run):
    assert (finished_run / "plans" / f"{START}-{GOAL}.npz").exists()
    assert load_experiment(finished_run / "experiment.yaml").evaluation.num_pairs == 1
