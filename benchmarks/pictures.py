"""Draws the pictures of the README and of the documentation's first page. Run it as a script.

    python benchmarks/pictures.py --runs runs/pictures

`body_shape.png` and `plan_path.png` are figures of a torus' report, `moving.gif` its arm under full
dynamics: coloured receptors feel. What has run already is not run again.
"""

from __future__ import annotations

import argparse
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image

from selftouch_drake.experiment import load_experiment
from selftouch_drake.robot import World
from selftouch_drake.run import stages
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.knowledge import load_execution
from selftouch_drake.run.showing import write_figures
from selftouch_drake.show import PostureCamera

IMAGES = Path(__file__).parents[1] / "docs" / "images"
SIZE = {"babbling": {"num_samples": 400_000}, "representation": {"num_targets": 1000}}
FIGURES = ("body_shape", "plan_path")
#: Of the tour that is shown: target sensations, frames a second, pixels and colours.
TOUR = (3, 250, 700, 480, 3)
RATE_HZ, PIXELS, COLORS = 12, 720, 64


def run_of(folder: Path) -> tuple[RunDirectory, World]:
    """A run of the torus, with one executed plan and one executed tour."""
    experiment = load_experiment("torus", SIZE)
    run, world = RunDirectory.create(folder, experiment), World(experiment)
    if not stages.has_babbled(run):
        with ThreadPoolExecutor() as executor:
            stages.babble(run, world, executor)
    if not stages.has_learned(run):
        stages.learn(run)
    for targets in (TOUR[:2], TOUR):
        stages.plan(run, world, *targets)
        stages.execute(run, world, *targets)
    return run, world


def cropped(pictures: np.ndarray) -> np.ndarray:
    """Pictures `(n, height, width, 3)` without the margins in which nothing is ever drawn."""
    drawn = (pictures != pictures[0, 0, 0]).any(axis=(0, 3))
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    return pictures[:, rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def moving(run: RunDirectory, world: World) -> Image.Image:
    """The executed tour, as a picture that moves."""
    execution = load_execution(run, *TOUR)
    time_s = execution.motion.time_s
    shown = np.searchsorted(time_s, np.arange(0.0, time_s[-1], 1 / RATE_HZ))
    camera = PostureCamera(world, pixels=PIXELS)
    pictures = [camera.picture(execution.q_measured[i], execution.felt[i]) for i in shown]
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
    return first


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, default=Path("runs/pictures"), help="run directory")
    run, world = run_of(parser.parse_args().runs)
    write_figures(run, world=world)
    for name in FIGURES:
        shutil.copy(run.figures / f"{name}.png", IMAGES / f"{name}.png")
    moving(run, world)
    for name in (*FIGURES, "moving"):
        (file,) = IMAGES.glob(f"{name}.*")
        print(f"{file}: {file.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
