"""Whether the live agent reaches the wanted speed while a browser shows it.

    python benchmarks/cost/live.py runs/cube

For each speed: seconds of the world per second of the clock, and what a second of the world costs
this process, in seconds of CPU. The browser draws in software, as on a machine without a graphics
card. The agent tours; planning counts.
"""

from __future__ import annotations

import argparse
import shutil
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

from selftouch_drake.bodies.drake import DrakeBodies
from selftouch_drake.bodies.embodiment import pilot_in
from selftouch_drake.run.artifacts import load_agent
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.show.meshcat.live import SPEED, LiveShow
from selftouch_drake.show.meshcat.stage import FRAME_S, open_meshcat
from selftouch_drake.show.run_data import RunData

SPEEDS = (0.5, 1.0, 2.0, 4.0)
SOFTWARE_GL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="run directory")
    parser.add_argument("--seconds", type=float, default=20.0, help="of the clock, for each speed")
    parser.add_argument("--no-browser", action="store_true", help="measure without a browser")
    given = parser.parse_args()
    run = RunDirectory.open(given.run)
    data, meshcat = RunData(run), open_meshcat()
    pilot = pilot_in(DrakeBodies(data.world), load_agent(run), run.experiment)
    pilot.prepare_queries()
    show = LiveShow(meshcat, data, pilot)
    with sync_playwright() as driver:
        if not given.no_browser:
            path = shutil.which("chromium") or shutil.which("google-chrome")
            page = driver.chromium.launch(executable_path=path, args=SOFTWARE_GL).new_page()
            page.goto(meshcat.web_url())
        print("| asked for | reached | CPU per second of the world |\n|---|---|---|")
        for speed in SPEEDS:
            meshcat.SetSliderValue(SPEED, speed)
            show.step()
            began, cpu, frames = time.perf_counter(), time.process_time(), 0
            while time.perf_counter() - began < given.seconds:
                show.step()
                frames += 1
            lived = frames * FRAME_S * speed
            reached = lived / (time.perf_counter() - began)
            print(f"| {speed} | {reached:.2f} | {(time.process_time() - cpu) / lived:.2f} s |")


if __name__ == "__main__":
    main()
