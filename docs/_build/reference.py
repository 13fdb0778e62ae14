"""The reference pages of the site, generated from the code: Markdown text by path."""

from __future__ import annotations

import dataclasses
import importlib.util
import inspect
import re
import typing
from collections.abc import Iterator
from pathlib import Path

import click

from selftouch_drake.experiment import schema
from selftouch_drake.cli import cli
from selftouch_drake.experiment import Experiment
from selftouch_drake.resources import EXPERIMENTS, SWEEPS, shipped, summary
from selftouch_drake.run.directory import Inside, RunDirectory
from selftouch_drake.run.metrics import METRICS

#: Packages of the API reference with their titles: what a program outside of this one may use.
API = {
    "quotient": (
        "The paper",
        ("quotient", "quotient.learn", "quotient.sensations", "quotient.kernels")
        + ("quotient.distances", "quotient.graph", "quotient.paths", "quotient.representation")
        + ("quotient.lengths", "quotient.layout", "quotient.holes", "quotient.dimension")
        + ("quotient.body", "quotient.links", "quotient.firm")
        + ("quotient.route", "quotient.waypoints", "quotient.smooth", "quotient.plan"),
    ),
    "agent": ("The naive agent", ("agent.agent", "agent.motions", "agent.tries")),
    "representation": (
        "What the agent learns",
        ("agent.representation.learning", "agent.representation.quotient")
        + ("agent.representation.graphs", "agent.representation.touches"),
    ),
    "readings": (
        "What is wrong with a skin",
        ("agent.readings.receptor_faults", "agent.readings.skin_drift"),
    ),
    "shape": (
        "What the agent recovers",
        ("agent.shape.recovery", "agent.shape.metrics"),
    ),
    "body_model": (
        "The body model",
        ("agent.body_model.model", "agent.body_model.find", "agent.body_model.asking")
        + ("agent.body_model.imagination", "agent.body_model.surface", "agent.body_model.own_parts"),
    ),
    "planning": (
        "How the agent plans",
        ("agent.planning.planner", "agent.planning.prediction", "agent.planning.timing"),
    ),
    "experience": (
        "Collecting and reading experience",
        ("experience.collect", "experience.store", "experience.walk"),
    ),
    "robot": ("Skins and robots in Drake", ("robot",)),
    "systems": (
        "Drake systems",
        ("systems.babbler", "systems.tactile_skin", "systems.skin_readout", "systems.joint_readout")
        + ("systems.touch_servo", "systems.plan_source", "systems.naive_agent", "systems.station")
        + ("systems.self_touch_diagram", "systems.simulation", "systems.skin_visualizer"),
    ),
    "geometry": (
        "Surfaces, skins and receptors",
        ("geometry.surfaces", "geometry.closing", "geometry.hollow", "geometry.receptors")
        + ("geometry.geodesics", "geometry.patches", "geometry.farthest"),
    ),
    "experiment": ("Experiments", ("experiment.loading", "experiment.schema")),
    "run": (
        "Runs",
        ("run.directory", "run.artifacts", "run.stages", "run.skin", "run.streams", "run.teaching"),
    ),
    "evaluation": (
        "Scores against the truth",
        ("evaluation.coverage", "evaluation.parts", "evaluation.shape", "evaluation.body_model")
        + ("evaluation.motion",),
    ),
    "show": (
        "Pictures, recordings, live agent",
        ("show.run_data", "show.page.figures", "show.outputs"),
    ),
    "sweep": ("Sweeps", ("sweep.design", "sweep.directory", "sweep.runs", "sweep.table", "sweep.figures")),
    # Packages that are there in some installations only.
    "envs": ("Gymnasium environments", ("envs",)),
}
# What a run directory holds that is no property of `RunDirectory`.
_OTHER_FILES = {
    "experiment.yaml": "The resolved experiment, every field spelled out.",
    "models.json": "SHA-256 of every file that decides the robot.",
    "metrics.json": "All metrics of the run: [metrics](metrics.md).",
    "skin_faults.csv": "What is wrong with each receptor, by `selftouch skin RUN`; beside it a picture.",
    "skin_drift.csv": "What changed in each receptor since an earlier run, by `selftouch skin EARLIER "
    "RUN`; beside it a picture.",
    "plans/": "One file per plan, named by its target sensations, as in `3-250.npz`: the plan, the "
    "motion and, once it was executed, the execution.",
}


def pages() -> dict[str, str]:
    """The text of each reference page, by its path below the documentation."""
    found = {
        "reference/cli.md": command_line(),
        "reference/experiment.md": experiment_fields(),
        "reference/metrics.md": metrics(),
        "reference/figures.md": figures(),
        "reference/files.md": files(),
    }
    return found | dict(_api_pages())


def api_navigation() -> list[dict[str, str]]:
    """The titles and paths of the pages of the API, for the site's navigation."""
    return [{title: path} for path, (title, _) in _api().items()]


def command_line() -> str:
    """Every command with its arguments, options and help."""
    text = ["# Command line\n", "`selftouch` exits with 0 on success, 2 on a user's mistake (one "]
    text += ["line says what to do), 130 after Ctrl-C. A stopped command resumes if it is given "]
    text += ["again.\n"]
    for name, command in cli.commands.items():
        context = click.Context(command, info_name=name, parent=click.Context(cli))
        usage = " ".join(command.collect_usage_pieces(context))
        chosen = [p for p in command.params if isinstance(p, click.Option)]
        options = [record for p in chosen if (record := p.get_help_record(context))]
        text += [f"\n## {name}\n", f"```\nselftouch {name} {usage}\n```\n", _help(command)]
        if options:
            text += ["", *_table(("option", "meaning"), [(f"`{o}`", h) for o, h in options])]
    return "\n".join(text) + "\n"


def experiment_fields() -> str:
    """Every field of an experiment with its type, default and meaning."""
    text = [
        "# Experiment fields\n",
        "An experiment is one YAML file. Every field has a default, except the robot, the skins and "
        "what touches. `--set` lays a mapping over any of it; `selftouch experiments --show NAME` "
        "prints a shipped one. An unknown key or a wrong value is refused, with the reason.\n",
        "Shipped experiments:\n",
        *_table(
            ("name", "robot"),
            [(f"`{n}`", summary(EXPERIMENTS / f"{n}.yaml")) for n in shipped(EXPERIMENTS)],
        ),
    ]
    for prefix, schema in _schemas(Experiment, ""):
        text += [f"\n## {prefix[:-1] or 'Top level'}\n", f"{inspect.getdoc(schema)}\n"]
        hints = typing.get_type_hints(schema)
        meanings = dict(_comments(schema))
        rows = [
            (f"`{prefix}{f.name}`", _type(hints[f.name]), _default(f), meanings.get(f.name, ""))
            for f in dataclasses.fields(schema)
        ]
        text += _table(("field", "type", "default", "meaning"), rows)
    text += ["\n## Shipped experiments\n"]
    for name in shipped(EXPERIMENTS):
        text += [f"### {name}\n", f"```yaml\n{_content(EXPERIMENTS / f'{name}.yaml')}```\n"]
    text += ["\n## Shipped sweeps\n"]
    for name in shipped(SWEEPS):
        text += [f"### {name} (sweep)\n", f"```yaml\n{_content(SWEEPS / f'{name}.yaml')}```\n"]
    return "\n".join(text) + "\n"


def metrics() -> str:
    """Every metric of a run with its unit, meaning and target."""
    text = [
        "# Metrics\n",
        "`metrics.json` holds these numbers. A share is stored as 0 to 1 and shown in percent. A "
        "metric that means nothing for an experiment is absent.\n",
    ]
    for section in dict.fromkeys(metric.section for metric in METRICS):
        text += [f"\n## {section}\n"]
        rows = [
            (f"`{m.key}`", m.unit, m.meaning, m.target) for m in METRICS if m.section == section
        ]
        text += _table(("key", "unit", "meaning", "target"), rows)
    return "\n".join(text) + "\n"


def figures() -> str:
    """Every picture of the report."""
    from selftouch_drake.show.page.figures import FIGURES

    text = [
        "# Figures\n",
        "`selftouch report RUN` draws these pictures into `RUN/figures`, as PNG, and with `--vector` "
        "as PDF too. A picture whose data are not there yet is left out, with the reason.\n",
    ]
    rows = [(f"`{name}.png`", inspect.getdoc(draw) or "") for name, draw in FIGURES.items()]
    return "\n".join([*text, *_table(("file", "what it shows"), rows)]) + "\n"


def files() -> str:
    """Every file of a run directory."""
    run = RunDirectory(Path(), Experiment())
    rows = [(f"`{name}`", meaning) for name, meaning in _OTHER_FILES.items()]
    for name, entry in vars(RunDirectory).items():
        if isinstance(entry, Inside):
            path = getattr(run, name)
            rows.append((f"`{path}{'' if path.suffix else '/'}`", entry.meaning))
    text = [
        "# Files of a run\n",
        "A run is a directory of plain files: YAML, JSON, Parquet, NumPy and HTML. "
        "[Learning](../learning.md#the-store) has the columns of the Parquet files and shows how to read "
        "them; [Running](../running.md#what-protects-the-files) says what protects the files.\n",
        *_table(("path", "what it holds"), sorted(rows)),
        "\nThe arrays of `representation.npz` are the attributes of "
        "`selftouch_drake.agent.representation.quotient.QuotientRepresentation`, those of a plan's file the "
        "attributes of `Plan`, `Motion` and `Execution` in `selftouch_drake.agent.motions`.",
    ]
    return "\n".join(text) + "\n"


def _api() -> dict[str, tuple[str, tuple[str, ...]]]:
    """Title and modules of each API page by its path, as far as the modules are there."""
    return {
        f"reference/api/{name}.md": (title, modules)
        for name, (title, modules) in API.items()
        if importlib.util.find_spec(f"selftouch_drake.{modules[0]}") is not None
    }


def _api_pages() -> Iterator[tuple[str, str]]:
    for path, (title, modules) in _api().items():
        parts = [f"# {title}\n"]
        parts += [f"::: selftouch_drake.{module}\n" for module in modules]
        yield path, "\n".join(parts)


def _schemas(schema: type, prefix: str) -> Iterator[tuple[str, type]]:
    """The dataclass tree, each class with the dotted prefix of its fields."""
    yield prefix, schema
    for name, hint in typing.get_type_hints(schema).items():
        if dataclasses.is_dataclass(hint):
            yield from _schemas(typing.cast(type, hint), f"{prefix}{name}.")
        for item in typing.get_args(hint):
            if dataclasses.is_dataclass(item):
                yield from _schemas(typing.cast(type, item), f"{prefix}{name}.NAME.")


def _comments(schema: type) -> Iterator[tuple[str, str]]:
    """Each field of a dataclass with the comment above it."""
    words: list[str] = []
    for line in inspect.getsource(schema).splitlines():
        if comment := re.match(r"\s+# (.*)", line):
            words.append(comment[1])
            continue
        if entry := re.match(r"    (\w+): ", line):
            yield entry[1], _with_choices(" ".join(words))
        words = []


def _with_choices(text: str) -> str:
    """Names of constants become what they hold."""
    for name in ("SHAPES", "SHAPE_METRICS"):
        choices = ", ".join(f"`{choice}`" for choice in getattr(schema, name))
        text = re.sub(rf"(One of|one of) {name}\b", rf"\1 {choices}", text)
    return text


def _type(hint: object) -> str:
    text = hint.__name__ if isinstance(hint, type) and not typing.get_args(hint) else str(hint)
    text = text.replace("typing.", "").replace("selftouch_drake.experiment.", "")
    names = {"str": "text", "int": "whole number", "float": "number", "None": "null"}
    return re.sub(r"\b(str|int|float|None)\b", lambda word: names[word[1]], text)


def _default(entry: dataclasses.Field) -> str:
    if entry.default is not dataclasses.MISSING:
        value = entry.default
    elif entry.default_factory is not dataclasses.MISSING:
        value = entry.default_factory()
    else:
        return "none: give it"
    if dataclasses.is_dataclass(value):
        return "see below"
    return "`null`" if value is None else f"`{value!r}`" if value != "" else ""


def _help(command: click.Command) -> str:
    # After a \b click keeps the lines as they are; such an example is a fenced block here.
    return inspect.cleandoc(command.help or "").replace("\b\n", "")


def _content(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    def row(cells: tuple[str, ...]) -> str:
        return "| " + " | ".join(" ".join(c.split()).replace("|", "\\|") for c in cells) + " |"

    return [row(head), "|" + "---|" * len(head), *map(row, rows)]
