"""Shape and contact over the number of joints: a torus on a neck with more and more joints.

    python benchmarks/accuracy/joints.py --joints 6 7 9 12 16 --pairs 20 --out runs/joints

The paper's arm touches a torus on a neck of joints that turn about z, y and x in turn; the more
there are, the less each one turns. What has run already is not run again.
"""

from __future__ import annotations

import argparse
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml
from matplotlib.figure import Figure

from selftouch_drake.experiment import load_experiment
from selftouch_drake.resources import MODELS
from selftouch_drake.run import stages
from selftouch_drake.show.style import BLUE, GREEN, ORANGE, styled

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.babbled import learned
from benchmarks.shared.results import add_update_option, results

Metrics = dict[str, Any]

#: The metrics shown, and how each is drawn.
COLORS = {"motor": ORANGE, "sensorimotor": BLUE, "learned": GREEN}

#: Joints of the arm; rad, how far each of three joints of a neck turns; m, from neck to body.
_ARM, _TURN, _NECK = 6, 0.65, 0.25
_AXES = ("0 0 1", "0 1 0", "1 0 0")
_LINK = """<link name="{name}"><pose>0 0 {z} 0 0 0</pose><inertial><mass>{mass}</mass><inertia>
<ixx>{i}</ixx><ixy>0</ixy><ixz>0</ixz><iyy>{i}</iyy><iyz>0</iyz><izz>{i}</izz></inertia></inertial></link>
"""
_JOINT = """<joint name="{name}" type="revolute"><pose>0 0 {z} 0 0 0</pose><parent>{parent}</parent>
<child>{child}</child><axis><xyz>{axis}</xyz><limit><lower>-{turn}</lower><upper>{turn}</upper>
<effort>60</effort><velocity>6</velocity></limit><dynamics><damping>0.5</damping></dynamics></axis>
</joint>
"""


def neck(num_joints: int) -> str:
    """The SDFormat text of a body on `num_joints` joints, one or more."""
    names = ["base", *(f"neck_{number}" for number in range(1, num_joints)), "body"]
    turn = round(_TURN * (3 / max(num_joints, 3)) ** 0.5, 3)
    parts = [_LINK.format(name=name, z=-_NECK, mass=0.3, i=0.0002) for name in names[:-1]]
    parts.append(_LINK.format(name="body", z=0, mass=1.0, i=0.05))
    for number, (parent, child) in enumerate(pairwise(names)):
        parts.append(
            _JOINT.format(
                name=f"joint_{number}",
                # In the frame of the child; all but the body's are at the neck.
                z=-_NECK if child == "body" else 0,
                parent=parent,
                child=child,
                axis=_AXES[number % 3],
                turn=turn,
            )
        )
    return f'<sdf version="1.9"><model name="turning_body">\n{"".join(parts)}</model></sdf>\n'


def experiment_file(folder: Path, num_joints: int) -> str | Path:
    """The name of an experiment with `num_joints` joints, or a file that describes one."""
    if num_joints == _ARM:
        return "torus"
    model, directives = folder / f"neck_{num_joints}.sdf", folder / f"neck_{num_joints}.dmd.yaml"
    model.write_text(neck(num_joints - _ARM), encoding="utf-8")
    shipped = (MODELS / "turning_body.dmd.yaml").read_text(encoding="utf-8")
    own = shipped.replace(
        "package://selftouch_drake/turning_body.sdf", f"package://necks/{model.name}"
    )
    directives.write_text(own, encoding="utf-8")
    (folder / "package.xml").write_text('<package format="2"><name>necks</name></package>\n')
    fields = {
        "robot": {"packages": {"necks": "."}, "directives": f"package://necks/{directives.name}"},
        "skins": {
            "body": {
                "link": "turning_body::body",
                "surface": {"shape": "torus", "major_radius": 0.22, "minor_radius": 0.09},
            }
        },
        "touching": {"fingertip": {"frame": "fingertip_0", "radius": 0.01}},
    }
    file = folder / f"joints_{num_joints}.yaml"
    file.write_text(yaml.safe_dump(fields), encoding="utf-8")
    return file


def measured(num_joints: int, arguments: argparse.Namespace) -> Metrics:
    """The metrics of a run with `num_joints` joints; a missing run is made."""
    size = {
        "seed": arguments.seed,
        "babbling": {"num_samples": arguments.touches},
        "representation": {"num_targets": arguments.targets},
        "evaluation": {"num_pairs": arguments.pairs},
    }
    experiment = load_experiment(experiment_file(arguments.out, num_joints), size)
    run = learned(arguments.out / f"run_{num_joints}", experiment)
    if "execution_contact_mean" not in run.metrics():
        stages.evaluate(run)
    return run.metrics()


def line(num_joints: int, found: Metrics) -> str:
    """A line of the table."""
    errors = " | ".join(f"{found['shape_rms_fraction_by_metric'][metric]:.1%}" for metric in COLORS)
    holes = " ".join(map(str, found["topology_betti"]))
    return (
        f"| {num_joints} | {errors} | {holes} | {found['unpractised_contact_mean']:.1%} "
        f"| {found['execution_contact_mean']:.1%} / {found['execution_contact_worst']:.0%} "
        f"| {found['execution_reach_rate']:.0%} | {found.get('shape_doubt_by_part', [''])[0]} |"
    )


#: Columns of the table beside the errors by metric, and the metrics of a run that they hold.
CONTACT = {
    "first": "execution_contact_mean",
    "worst": "execution_contact_worst",
    "straight": "unpractised_contact_mean",
}


def row(num_joints: int, found: Metrics) -> dict[str, float]:
    """A row of the table: shape errors and contact, as fractions."""
    errors = {metric: found["shape_rms_fraction_by_metric"][metric] for metric in COLORS}
    contact = {name: found[key] for name, key in CONTACT.items()}
    return {"joints": num_joints, **{k: round(v, 4) for k, v in (errors | contact).items()}}


@styled
def picture(rows: list[dict[str, str]]) -> Figure:
    """Shape error by every metric, and contact of plans, over the number of joints."""
    joints = [int(row["joints"]) for row in rows]
    figure = Figure(figsize=(8.4, 3.4), layout="constrained")
    shape, contact = figure.subplots(1, 2)
    for metric, color in COLORS.items():
        error = [100 * float(row[metric]) for row in rows]
        shape.plot(joints, error, "o-", color=color, label=metric)
    shape.set(ylabel="shape error (% of the extent)", ylim=(0, None))
    for name, label, color, style in (
        ("first", "first execution, mean", BLUE, "o-"),
        ("worst", "first execution, worst", BLUE, "o:"),
        ("straight", "without practice, mean", ORANGE, "o-"),
    ):
        share = [100 * float(row[name]) for row in rows]
        contact.plot(joints, share, style, color=color, label=label)
    contact.set(ylabel="time in contact (%)", ylim=(0, 102))
    for ax in (shape, contact):
        ax.set(xlabel="joints")
        ax.set_xticks(joints)
        ax.legend()
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--joints", nargs="+", type=int, default=[6, 7, 9, 12, 16])
    parser.add_argument("--touches", type=int, default=400_000)
    parser.add_argument("--targets", type=int, default=500)
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=501)
    parser.add_argument("--out", type=Path, default=Path("runs/joints"))
    add_update_option(parser, "joints")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    print(
        "| joints | motor | sensorimotor | learned | holes | contact straight "
        "| contact, mean / worst | reached | doubt |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    with results("joints", update=arguments.update) as add:
        for num_joints in arguments.joints:
            found = measured(num_joints, arguments)
            add(row(num_joints, found))
            print(line(num_joints, found), flush=True)


if __name__ == "__main__":
    main()
