"""Recording, report and live agent in a browser (headless Chromium).

Screenshots stay in pytest's temporary directory, to be looked at.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
from laid_out import execution_of, world_of
from matplotlib.image import imread

from selftouch_drake.show.meshcat.live import PLAY_FIT, LiveShow
from selftouch_drake.show.meshcat.live_page import shown_page
from selftouch_drake.show.meshcat.pages import LIFE_FIT, ROBOT_FIT, LifePage, RobotPage
from selftouch_drake.show.page.figures import FIGURES
from selftouch_drake.show.run_data import RunData

pytestmark = pytest.mark.slow
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SOFTWARE_GL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
# ms; WebGL without a graphics card is slow, and so is a machine that tests on all its cores.
PATIENCE = 120_000


@pytest.fixture(scope="module")
def chromium():
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright")
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip("no Chromium on this machine; install it with `apt install chromium`")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=SOFTWARE_GL, timeout=PATIENCE)
        yield browser
        browser.close()


@contextmanager
def visited(browser, url):
    """A page and its errors."""
    page, errors = browser.new_page(viewport={"width": 800, "height": 500}), []
    page.set_default_timeout(PATIENCE)
    page.on("console", lambda m: errors.append(m.text) if m.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(url)
    yield page, errors
    page.close()


def picture(page, path) -> np.ndarray:
    """`(height, width, 3)` pixels of the page's canvas, 0 to 1."""
    page.locator("canvas").first.screenshot(path=path)
    return imread(path)[..., :3]


def num_colors(image) -> int:
    return len(np.unique((15 * image).round() @ [1, 16, 256]))


def changed(before, after) -> float:
    """The share of pixels that differ."""
    return float((np.abs(before - after).max(axis=2) > 0.1).mean())


def colors_at(page, time_s: float) -> list[str]:
    """The colours of all receptors at a time of the recording."""
    return page.evaluate(
        """async (time) => {
             viewer.animator.pause();
             viewer.animator.seek(time);
             await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
             const body = viewer.scene_tree.find(["skins", "body", "receptors"]);
             return Object.values(body.children).map(
               receptor => receptor.find(["<object>"]).object.material.color.getHexString());
           }""",
        time_s,
    )


def test_the_recording_moves_and_colours_the_skin(chromium, reported, tmp_path):
    with visited(chromium, reported.playback.as_uri()) as (page, errors):
        page.wait_for_function("typeof viewer == 'object' && viewer.animator.duration > 0")
        at_first = colors_at(page, 0.0)
        first = picture(page, tmp_path / "first.png")
        at_last = colors_at(page, 1.2)
        last = picture(page, tmp_path / "last.png")
        assert page.get_by_text("N per receptor").is_visible()
    assert errors == []
    assert num_colors(first) > 50
    assert changed(first, last) > 0.002
    assert len(at_first) == len(at_last) == reported.experiment.num_receptors
    assert at_first != at_last


def test_babbling_moves_the_robot_from_the_link_of_the_report(chromium, reported, tmp_path):
    with visited(chromium, reported.report.as_uri()) as (page, errors):
        page.get_by_role("link", name="Watch the first ten seconds").click()
        page.wait_for_function("typeof viewer == 'object' && viewer.animator.duration > 0")
        assert page.evaluate("viewer.animator.duration") == pytest.approx(10.0, abs=0.2)
        colors_at(page, 0.0)
        first = picture(page, tmp_path / "babbling_first.png")
        colors_at(page, 5.0)
        later = picture(page, tmp_path / "babbling_later.png")
        assert page.get_by_text("joint controllers follow its random walk").is_visible()
    assert errors == []
    assert num_colors(first) > 50
    assert changed(first, later) > 0.002


def position_at(page, time_s: float, *path: str) -> list[float]:
    """Position of an object in its parent, at a time of the recording."""
    return page.evaluate(
        """async ([time, path]) => {
             viewer.animator.pause();
             viewer.animator.seek(time);
             await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
             return viewer.scene_tree.find(path).object.position.toArray();
           }""",
        [time_s, list(path)],
    )


def test_a_skin_that_moves_takes_its_receptors_along(chromium, two_skins, tmp_path):
    with visited(chromium, two_skins.playback.as_uri()) as (page, errors):
        page.wait_for_function("typeof viewer == 'object' && viewer.animator.duration > 0")
        moved = [position_at(page, time_s, "skins", "forearm") for time_s in (0.0, 1.2)]
        expected = [position_at(page, time_s, "expected", "forearm") for time_s in (0.0, 1.2)]
        still = [position_at(page, time_s, "skins", "body") for time_s in (0.0, 1.2)]
        receptors = page.evaluate(
            'Object.keys(viewer.scene_tree.find(["skins", "forearm", "receptors"]).children).length'
        )
        picture(page, tmp_path / "two_skins.png")
    assert errors == []
    assert np.abs(np.subtract(*moved)).max() > 0.1
    assert expected == moved
    assert still[0] == still[1]
    assert receptors == 12


# Boxes on the screen, in pixels, of the parts of a scene and of the legend: left, top, right and
# bottom.
BOXES = """() => {
  const boxes = {};
  const path = ["skins", "drake", "touching", "expected", "recovered", "known", "status"];
  const titles = Object.keys(viewer.scene_tree.find(["titles"]).children);
  for (const where of [...path.map(p => [p]), ...titles.map(t => ["titles", t])]) {
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    viewer.scene_tree.find(where).object.traverseVisible((each) => {
      const places = each.geometry && each.geometry.attributes.position;
      if (!places || !each.visible) return;
      each.updateWorldMatrix(true, false);
      for (let i = 0; i < places.count; i += Math.ceil(places.count / 300)) {
        const p = each.position.clone().fromBufferAttribute(places, i)
          .applyMatrix4(each.matrixWorld).project(viewer.camera);
        const x = (p.x + 1) / 2 * innerWidth, y = (1 - p.y) / 2 * innerHeight;
        box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y);
        box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
      }
    });
    if (box[0] < box[2]) boxes[where.join("/")] = box;
  }
  const legend = document.getElementById("legend").getBoundingClientRect();
  boxes.legend = [legend.left, legend.top, legend.right, legend.bottom];
  return boxes;
}"""


def overlap(one, other) -> bool:
    """Whether two boxes on the screen do."""
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


@pytest.mark.parametrize("width", [420, 1200])
def test_a_recording_is_inside_the_screen_and_its_captions_free(
    chromium, two_skins, tmp_path, width
):
    with visited(chromium, two_skins.playback.as_uri()) as (page, errors):
        page.set_viewport_size({"width": width, "height": 800})
        page.wait_for_function("typeof viewer == 'object' && viewer.animator.duration > 0")
        colors_at(page, 0.0)
        boxes = page.evaluate(BOXES)
        assert "two_skins" in page.title()
        page.screenshot(path=tmp_path / f"playback_{width}.png")
    assert errors == []
    captions = {name: boxes.pop(name) for name in list(boxes) if name.startswith("titles/")}
    assert len(captions) == 3
    assert {"skins", "drake", "expected", "recovered", "legend"} <= set(boxes)
    for name, (left, top, right, bottom) in (boxes | captions).items():
        assert -1 <= left < right <= width + 1, name
        assert -1 <= top < bottom <= 801, name
    for name, caption in captions.items():
        assert not any(overlap(caption, box) for box in boxes.values()), name
        assert not any(overlap(caption, c) for other, c in captions.items() if other != name)
    # All that is shown stands about the middle.
    shown = np.array([*boxes.values(), *captions.values()])[:, [0, 2]]
    assert abs(shown.min() + shown.max() - width) < 0.15 * width


def drawn_robot(run, meshcat):
    RobotPage(meshcat, world_of("two_skins"))


def drawn_life(run, meshcat):
    page = LifePage(meshcat)
    page.enter(world_of("two_skins"))
    done = execution_of("two_skins")
    life = SimpleNamespace(
        num_touches=1234, has_doubts=False, noticed=[], learner=SimpleNamespace(knows=False)
    )
    page.lived(done.q_measured[:1], done.felt[:1], life)


def drawn_play(run, meshcat):
    LiveShow(meshcat, RunData(run), SimpleNamespace())


# For each live page: what draws it, and how it fits.
LIVE_PAGES = {
    "robot": (drawn_robot, ROBOT_FIT, {"status"}),
    "life": (drawn_life, LIFE_FIT, {"status"}),
    "play": (drawn_play, PLAY_FIT, {"status", "titles/felt", "titles/expected"}),
}


@pytest.mark.parametrize("kind", LIVE_PAGES)
def test_a_live_page_has_a_legend_and_is_inside_the_screen(chromium, two_skins, tmp_path, kind):
    draw, fit, wanted = LIVE_PAGES[kind]
    said = []
    with shown_page(f"{kind} <live>", announce=said.append, **fit) as meshcat:
        draw(two_skins, meshcat)
        (url,) = re.findall(r"http://\S+", said[0])
        with visited(chromium, url) as (page, errors):
            for width in (420, 1200):
                page.set_viewport_size({"width": width, "height": 800})
                page.wait_for_function('viewer.scene_tree.find(["status", "<object>"]).object')
                page.wait_for_timeout(1000)
                boxes = page.evaluate(BOXES)
                page.screenshot(path=tmp_path / f"{kind}_{width}.png")
                assert page.title() == f"{kind} <live>"
                assert page.get_by_text("The more a receptor feels").is_visible()
                check_inside(boxes, width, wanted)
        assert errors == []


def check_inside(boxes, width, wanted):
    """Everything is on a screen 800 pixels high, and captions cover nothing."""
    captions = {n: boxes.pop(n) for n in list(boxes) if n.startswith(("titles/", "status"))}
    assert wanted <= set(captions)
    assert {"skins", "drake", "legend"} <= set(boxes)
    for name, (left, top, right, bottom) in (boxes | captions).items():
        assert -1 <= left < right <= width + 1, name
        assert -1 <= top < bottom <= 801, name
    for name, caption in captions.items():
        covered = [
            n for n, box in (boxes | captions).items() if n != name and overlap(caption, box)
        ]
        assert covered == [], name
    assert not any(overlap(boxes["legend"], box) for n, box in boxes.items() if n != "legend")


@pytest.mark.parametrize("width", [420, 1200])
def test_tables_and_pictures_of_a_report_scroll_inside_themselves(chromium, two_skins, width):
    with visited(chromium, two_skins.report.as_uri()) as (page, _):
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        outside = """() => [...document.querySelectorAll("table, img")].filter((e) => {
          const box = (e.closest(".scroll") || e).getBoundingClientRect();
          return box.left < 0 || box.right > innerWidth;
        }).length"""
        assert page.evaluate(outside) == 0
        # Letters of 9 points at 160 dots per inch have 20 pixels.
        letters = "all => all.map(e => 20 * e.getBoundingClientRect().width / e.naturalWidth)"
        assert min(page.eval_on_selector_all("img", letters)) >= 8.9
        squeezed = """() => [...document.querySelectorAll("td")].filter((e) =>
          e.textContent.length > 20 && e.getBoundingClientRect().width < 60).length"""
        assert page.evaluate(squeezed) == 0


def test_the_report_shows_every_figure(chromium, reported, tmp_path):
    with visited(chromium, reported.report.as_uri()) as (page, errors):
        widths = page.eval_on_selector_all("img", "all => all.map(img => img.naturalWidth)")
        page.screenshot(path=tmp_path / "report.png", full_page=True)
        page.get_by_role("link", name="Watch the motion").click()
        page.wait_for_function("typeof viewer == 'object' && viewer.animator.duration > 0")
    assert errors == []
    assert len(widths) == len(FIGURES)
    assert min(widths) > 100


# The contrast of each text with what is behind it, by the formula of WCAG 2.
LEAST_CONTRAST = """() => {
  const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
  const light = (c) => [0.2126, 0.7152, 0.0722].reduce((sum, share, i) => {
    const x = c[i] / 255;
    return sum + share * (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
  }, 0);
  const behind = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const color = rgb(getComputedStyle(e).backgroundColor);
      if (color.length === 3 || color[3] > 0) return color;
    }
    return [255, 255, 255];
  };
  let least = 21;
  for (const e of document.querySelectorAll("main *")) {
    if (![...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim())) continue;
    const [a, b] = [light(rgb(getComputedStyle(e).color)), light(behind(e))].sort();
    least = Math.min(least, (b + 0.05) / (a + 0.05));
  }
  return least;
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_the_report_fits_and_can_be_read(chromium, two_skins, tmp_path, width, scheme):
    with visited(chromium, two_skins.report.as_uri()) as (page, errors):
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(LEAST_CONTRAST) >= 4.5
        page.screenshot(path=tmp_path / f"{width}_{scheme}.png")
    assert errors == []


def test_the_recovered_body_turns_and_answers(chromium, reported, tmp_path):
    with visited(chromium, reported.report.as_uri()) as (page, errors):
        body = page.locator("#body-canvas")
        body.focus()
        before = picture(page, tmp_path / "before.png")
        page.keyboard.press("ArrowRight")
        assert changed(before, picture(page, tmp_path / "turned.png")) > 0.01
        box = body.bounding_box()
        for share in (0.45, 0.6):
            page.mouse.click(box["x"] + share * box["width"], box["y"] + share * box["height"])
        assert re.fullmatch(r"--from \d+ --to \d+", page.locator("#body-chosen").inner_text())
    assert errors == []


@contextmanager
def playing(run):
    """A process that plays a run, and the lines that it prints."""
    command = [sys.executable, "-m", "selftouch_drake", "play", str(run.path)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    try:
        yield process, iter(process.stdout.readline, "")
    finally:
        process.kill()
        process.communicate()


def first_line(lines, pattern: str) -> re.Match:
    """The next line that matches."""
    printed = []
    for line in lines:
        printed.append(line)
        if match := re.search(pattern, line):
            return match
    pytest.fail(f"never printed {pattern!r}, only {printed}")


def set_slider(page, name: str, value: float) -> None:
    field = page.locator("li.cr", has_text=name).locator("input")
    field.fill(str(value))
    field.press("Enter")


def test_the_live_agent_answers_and_a_browser_may_come_back(chromium, reported, tmp_path):
    with playing(reported) as (process, lines):
        url = first_line(lines, r"live at (http://\S+)")[1]
        with visited(chromium, url) as (page, errors):
            page.get_by_text("Open Controls").click()
            # Before it asks: a slow browser may need longer for a picture than the agent to move.
            before = picture(page, tmp_path / "before.png")
            set_slider(page, "target sensation", 40)
            first_line(lines, r"^to sensation 40(, through the air)?$")
            first_line(lines, r"^sensation 40: .*in contact")
            after = picture(page, tmp_path / "after.png")
            assert errors == []
        assert num_colors(after) > 50
        assert changed(before, after) > 0.002

        with visited(chromium, url) as (page, errors):
            page.get_by_text("Open Controls").click()
            slider = page.locator("li.cr", has_text="target sensation").locator("input")
            assert slider.input_value() == "40"
            assert num_colors(picture(page, tmp_path / "again.png")) > 50
            page.locator("li.cr", has_text=re.compile("^end$")).click()
            first_line(lines, "^ended$")
            assert process.wait(60) == 0


def test_ctrl_c_ends_the_live_agent(reported):
    with playing(reported) as (process, lines):
        first_line(lines, "to sensation")
        process.send_signal(signal.SIGINT)
        first_line(lines, "^ended$")
        assert process.wait(60) == 0
        assert process.stderr.read() == ""
