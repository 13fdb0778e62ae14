"""Draws all pictures of the README and the documentation into `docs/images`.

    python benchmarks/make/pictures.py                  # all of them
    python benchmarks/make/pictures.py live two_fingers # some
    python benchmarks/make/pictures.py --check          # are they as the code would draw them now?

`body_shape.png` and `plan_path.png` are figures of a torus' report, `moving.gif` its arm under
dynamics, `live.png` the live page, `my_robot.png` the robot of the tutorial, `taken_home.png` an
exported body in simulators, `growing.gif` a skeleton from few touches; pictures with the name of an
experiment are of its report. The others are drawn from stored tables: see `drawings.py`. What has
run already is not run again.
"""

from __future__ import annotations

import argparse
import ast
import functools
import hashlib
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.bodies.embodiment import pilot_in
from selftouch_drake.experiment import Experiment, load_experiment
from selftouch_drake.run import stages
from selftouch_drake.run.artifacts import load_agent, load_execution
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.show.meshcat.live import PLAY_FIT, TARGET, LiveShow
from selftouch_drake.show.meshcat.live_page import shown_page
from selftouch_drake.show.page.figures import FIGURES
from selftouch_drake.show.page.robot_pictures import PostureCamera
from selftouch_drake.show.run_data import RunData
from selftouch_drake.systems import Babbler, MakeSelfTouchDiagram

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.make.drawings import DRAWINGS
from benchmarks.make.taken_home import taken_home
from benchmarks.shared.results import ROOT

IMAGES = ROOT / "docs" / "images"
#: What each picture was drawn with: a digest of the code and the data.
STAMP = IMAGES / "stamp.json"
#: Code that pictures of a kind look like, below the package.
OF_A_RUN = ("show/page/*.py", "show/*.py")
IN_MESHCAT = ("show/meshcat/*.py", "show/*.py")
SOFTWARE_GL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
SIZE = {"babbling": {"num_samples": 400_000}, "representation": {"num_targets": 1000}}
FEW_PAIRS = {"evaluation": {"num_pairs": 2, "shape_metrics": []}}
#: Of the tour that is shown: target sensations, frames a second, pixels and colours.
TOUR = (3, 250, 700, 480, 3)
#: Shipped experiments whose recovered bodies are shown.
GALLERY: dict[str, dict] = {
    "two_arms": {"babbling": {"num_samples": 200_000}},
    "infant": {},
    "icub": {},
    "planar": {},
}
# The files that decide the drawn diagram.
SYSTEMS = ("systems/*.py",)
RATE_HZ, PIXELS, COLORS = 5, 760, 96
# Instants of the execution between two marks of the path so far.
TRAIL_EVERY = 4
# Frames of the live page before the picture is taken: in the middle of a motion.
NUM_FRAMES = 45
# Pixels of the page without its empty margins.
LIVE_CLIP = {"x": 160, "y": 180, "width": 730, "height": 285}


@functools.cache
def torus(folder: Path) -> RunData:
    """A run of the torus, with one executed plan and one executed tour."""
    data = evaluated(folder / "torus", load_experiment("torus", SIZE | FEW_PAIRS))
    for targets in (TOUR[:2], TOUR):
        if not data.run.plan(*targets).exists():
            stages.plan(data.run, *targets)
            stages.execute(data.run, *targets)
    return data


def tutorial_robot(folder: Path) -> RunData:
    """A run of the robot that the tutorial describes, file by file."""
    files = folder / "tutorial"
    files.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROOT / "docs" / "examples" / "my_arm.urdf", files)
    page = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    for text in re.findall(r"^```(?:xml|yaml)\n(.*?)^```$", page, re.DOTALL | re.MULTILINE):
        if name := re.match(r"(?:#|<!--) (\S+\.(?:yaml|sdf))", text):
            (files / name[1]).write_text(text, encoding="utf-8")
    return evaluated(folder / "my_robot", load_experiment(files / "my_robot.yaml", FEW_PAIRS))


def shipped(name: str, folder: Path) -> RunData:
    """A run of a shipped experiment."""
    return evaluated(folder / name, load_experiment(name, GALLERY[name] | FEW_PAIRS))


def evaluated(folder: Path, experiment: Experiment) -> RunData:
    """A run that has learned and whose shape error is known."""
    run = RunDirectory.create(folder, experiment)
    if not stages.has_babbled(run):
        with ThreadPoolExecutor() as executor:
            stages.babble(run, executor)
    if not stages.has_learned(run):
        stages.learn(run)
    if not stages.has_evaluated(run):
        stages.evaluate(run)
    return RunData(run)


def figure(name: str, of: Callable[[Path], RunData], runs: Path) -> Figure:
    return FIGURES[name](of(runs))


def cropped(pictures: np.ndarray) -> np.ndarray:
    """Pictures `(n, height, width, 3)` without empty margins."""
    drawn = (pictures != pictures[0, 0, 0]).any(axis=(0, 3))
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    return pictures[:, rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def moving(runs: Path) -> None:
    """The executed tour, as an animation."""
    data = torus(runs)
    execution = load_execution(data.run, *TOUR)
    time_s = execution.motion.time_s
    shown = np.searchsorted(time_s, np.arange(0.0, time_s[-1], 1 / RATE_HZ))
    q = execution.q_measured[shown]
    camera = PostureCamera(data.world, pixels=PIXELS, postures=q)
    tips = data.world.robot.toucher_positions(execution.q_measured)[:, 0]
    pictures = [
        camera.picture(q[k], execution.felt[i], trail=tips[: i + 1 : TRAIL_EVERY])
        for k, i in enumerate(shown)
    ]
    frames = [Image.fromarray(each) for each in cropped(np.array(pictures))]
    # One palette for all, so that colours do not flicker.
    palette = frames[len(frames) // 2].quantize(COLORS)
    first, *rest = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    first.save(
        IMAGES / "moving.gif",
        save_all=True,
        append_images=rest,
        duration=round(1000 / RATE_HZ),
        loop=0,
        optimize=True,
    )


def live(runs: Path) -> None:
    """The live page in the middle of a motion, as a browser shows it."""
    from playwright.sync_api import sync_playwright

    data, said = torus(runs), list[str]()
    pilot = pilot_in(DrakeBodies(data.world), load_agent(data.run), data.run.experiment)
    with (
        shown_page("torus", announce=said.append, **PLAY_FIT) as meshcat,
        sync_playwright() as driver,
    ):
        show = LiveShow(meshcat, data, pilot)
        show.simulation.set_rate(0.0)
        meshcat.SetSliderValue(TARGET, TOUR[1])
        for _ in range(NUM_FRAMES):
            show.step()
        path = shutil.which("chromium") or shutil.which("google-chrome")
        browser = driver.chromium.launch(executable_path=path, args=SOFTWARE_GL)
        page = browser.new_page(viewport={"width": 1200, "height": 620}, device_scale_factor=1.5)
        page.goto(said[0].split()[2])
        page.wait_for_timeout(5000)
        page.screenshot(path=IMAGES / "live.png", clip=LIVE_CLIP, timeout=120_000)


def diagram(runs: Path) -> None:
    """The self-touch diagram of a torus with a touch servo, as Drake draws it by Graphviz."""
    experiment = load_experiment("torus", {"execution": {"touch_servo": True}})
    babbler = Babbler(experiment)
    babbler.set_name("babbler")
    text = MakeSelfTouchDiagram(experiment, babbler).GetGraphvizString(max_depth=1)
    command = ["dot", "-Tpng", "-Gdpi=110", "-o", str(IMAGES / "diagram.png")]
    subprocess.run(command, input=text.encode(), check=True)


def drawn(name: str, runs: Path) -> None:
    """Draws one picture."""
    if name in DRAWINGS:
        picture = DRAWINGS[name]()
    elif name in OWN:
        OWN[name](runs)
        return
    else:
        picture = FROM_RUNS[name](runs)
    picture.savefig(IMAGES / f"{name}.png", bbox_inches="tight", metadata={"Software": None})


def growing(runs: Path) -> None:
    """A skeleton that grows from few touches."""
    from benchmarks.make.growing import BODY, SEED, TOUCHES, draw  # not needed for the others

    draw(BODY, SEED, TOUCHES, IMAGES / "growing.gif")


#: Pictures that write themselves, and figures of runs.
OWN = {"moving": moving, "live": live, "diagram": diagram, "growing": growing}
FROM_RUNS: dict[str, Callable[[Path], Figure]] = {
    "body_shape": functools.partial(figure, "body_shape", torus),
    "plan_path": functools.partial(figure, "plan_path", torus),
    "my_robot": functools.partial(figure, "body_shape", tutorial_robot),
    "taken_home": taken_home,
    **{
        name: functools.partial(figure, "body_shape", functools.partial(shipped, name))
        for name in GALLERY
    },
}


def digest(name: str) -> str:
    """Digest of the code that draws a picture, and of the tables that it shows."""
    package = ROOT / "selftouch_drake"
    benchmarks = ROOT / "benchmarks"
    files = [package / "show" / "style.py"]
    if name in DRAWINGS:
        files += [
            benchmarks / "make" / "drawings.py",
            benchmarks / "accuracy" / "trust.py",
            benchmarks / "accuracy" / "joints.py",
            benchmarks / "life" / "exploration.py",
        ]
        files += [*(ROOT / "docs" / "data").glob("*.csv")]
    elif name == "growing":
        files += [benchmarks / "make" / "growing.py"]
    else:
        kinds = SYSTEMS if name == "diagram" else IN_MESHCAT if name == "live" else OF_A_RUN
        files += [Path(__file__), *(file for kind in kinds for file in package.glob(kind))]
    if name == "taken_home":
        files += [benchmarks / "make" / "taken_home.py", *package.glob("export/*.py")]
    contents = b"".join(content(file) for file in sorted({*files}))
    return hashlib.sha256(contents).hexdigest()[:16]


def content(file: Path) -> bytes:
    """The content of a file; of a program without docstrings and errors, which draw nothing."""
    if file.suffix != ".py":
        return file.read_bytes()
    tree = ast.parse(file.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(
            node
        ):
            node.body.pop(0)
        elif isinstance(node, ast.Raise):
            node.exc = node.cause = None
    return ast.dump(tree).encode()


def outdated() -> list[str]:
    """Pictures whose code or data changed since they were drawn."""
    stamp = json.loads(STAMP.read_text(encoding="utf-8")) if STAMP.exists() else {}
    return [name for name in ALL if stamp.get(name) != digest(name)]


ALL = (*FROM_RUNS, *OWN, *DRAWINGS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of pictures: {', '.join(ALL)}; default all")
    parser.add_argument("--runs", type=Path, default=Path("runs/pictures"), help="folder of runs")
    parser.add_argument("--check", action="store_true", help="draw nothing, name what is outdated")
    given = parser.parse_args()
    if given.check:
        for name in outdated():
            # As GitHub shows warnings.
            print(f"::warning::docs/images/{name} was drawn by other code; run `make pictures`")
        return
    for name in given.names or ALL:
        drawn(name, given.runs)
        stamp = json.loads(STAMP.read_text(encoding="utf-8")) if STAMP.exists() else {}
        stamp[name] = digest(name)
        STAMP.write_text(json.dumps(stamp, indent=2, sort_keys=True) + "\n", encoding="utf-8")
        (file,) = IMAGES.glob(f"{name}.*")
        print(f"{file}: {file.stat().st_size / 1e6:.1f} MB", flush=True)


if __name__ == "__main__":
    main()
