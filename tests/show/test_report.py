import dataclasses
import html
import json
import re
from html.parser import HTMLParser
from importlib.resources import files

import numpy as np
import pytest

from selftouch_drake.run.artifacts import load_body_model, save_body_model
from selftouch_drake.run.metrics import METRICS
from selftouch_drake.show import outputs
from selftouch_drake.show.outputs import write_report
from selftouch_drake.show.page.figures import FIGURES
from selftouch_drake.show.page.report import plan_table
from selftouch_drake.show.run_data import RunData


class Links(HTMLParser):
    """Gathers what a page asks for, and which elements it has."""

    def __init__(self, page: str):
        super().__init__()
        self.targets, self.tags = [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.targets += [value for name, value in attrs if name in ("src", "href", "srcset")]


def page_of(run) -> str:
    return run.report.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(reported):
    return page_of(reported)


def cells(page: str) -> str:
    """A page without white space between its tags."""
    return re.sub(r">\s+<", "><", page)


def test_the_report_asks_nothing_of_a_network(page, reported):
    links = Links(page)
    assert links.targets.count("playback.html") == 1
    pages = ("playback.html", "babbling.html")
    images = [target for target in links.targets if target not in pages]
    assert len(images) == len(FIGURES)
    assert all(image.startswith("data:image/png;base64,iVBORw0KGgo") for image in images)
    assert "://" not in re.sub(r'src="[^"]*"|package://', "", page)
    assert "url(" not in page
    assert reported.playback.is_file()


def test_a_malicious_name_is_text(page, reported):
    assert Links(page).tags.count("script") == 2, "the body, and what turns it"
    assert reported.experiment.name not in page
    assert html.escape(reported.experiment.name) in page.replace("&#34;", "&quot;")


def test_metrics_have_meaning_and_unit(page):
    assert "1.2 %" in page
    assert "RMS distance of recovered places from the true ones" in page


def test_the_robot_is_described(page):
    assert "A robot with 6 moving joints wears\na soft skin with 20" in page
    assert "shoulder_pitch</td><td>turns</td><td>-1 to 2.6 rad</td>" in page
    assert "<td>touches body</td>" in page
    assert ">part</th>" not in page, "one part on one skin needs no table"


def test_every_section_of_the_metrics_has_its_place():
    template = (files("selftouch_drake.show.page") / "report.html.j2").read_text(encoding="utf-8")
    placed = set(re.findall(r'table\("([^"]+)"', template))
    assert placed - {"Others"} == {metric.section for metric in METRICS}


def test_the_tiles_are_explained(page):
    assert "<strong>1.2 %</strong><b>shape error</b><span>RMS distance of" in page


def test_motions_before_and_after_practice_stand_side_by_side(page):
    rows = re.findall(r'<td><b>([\w ]+)</b><span>[^<]+</span></td><td class="value">([^<]*)', page)
    assert rows == [("before practice", "81.2 %"), ("practised", "99.8 %")]


def test_the_recovered_body_can_be_turned(page, reported):
    text = re.search(r'id="body-data">(.*?)</script>', page)[1]
    (part,) = json.loads(text)["parts"]
    assert part["kernels"] == list(range(60))
    assert part["closed"]
    assert np.max(part["faces"]) < len(part["places"])
    assert np.abs(part["places"]).max() <= 1.0


def test_the_body_model_is_told_with_its_assumption_and_its_judgement(page):
    text = page[page.index('<h2 id="model">') : page.index('<h2 id="plans">')]
    assert "Its judgement: <strong>accepted</strong>." in text
    assert "Assumed: rigid links on joints that turn or slide. Tested on touches" in text
    assert 'alt="The skeleton that the agent found"' in text
    assert "mirrored\n   and scaled as a whole" in text
    rows = re.findall(r"<tr><td>(\d)</td><td>(\w+)</td><td>turns</td>.*<td>(\S+)</td></tr>", text)
    assert [row[1] for row in rows][:2] == ["shoulder_yaw", "shoulder_pitch"]
    assert [row[0] for row in rows] == list("123456")
    assert {row[2] for row in rows} == {"0.0°"}
    assert "└─ shoulder_yaw &gt; shoulder_pitch" in text


@pytest.fixture
def without_babbling(monkeypatch):
    """No page shows how the robot babbled."""
    monkeypatch.setattr(outputs, "write_babbling", lambda run, data: None)


@pytest.mark.usefixtures("unrendered", "without_babbling")
@pytest.mark.parametrize(("reason", "told"), [("off", False), ("rejected: too few.", True)])
def test_without_an_accepted_model_the_report_tells_why_or_nothing(make_run, reason, told):
    run = make_run("learned")
    model = load_body_model(run)
    nothing = np.zeros_like(model.accepted_by_part)
    save_body_model(run, dataclasses.replace(model, accepted_by_part=nothing, reason=reason))
    write_report(run)
    page = page_of(run)
    assert ('<h2 id="model">' in page) == told
    assert ("has no model of its body: rejected: too few." in page) == told
    assert "Joints that the agent found" not in page


def test_a_recording_stands_beside_its_plan(page):
    link = page.index("Watch the motion from sensation 0 to 40")
    assert (
        page.index('alt="A plan around the body"')
        < link
        < page.index("Predicted and felt sensations")
    )


def test_every_picture_has_a_text_and_headings_have_an_order(page):
    assert re.findall(r"<img(?![^>]* alt=\"[^\"]+\")", page) == []
    assert re.findall(r"<h(\d)>", page)[0] == "1"
    assert set(re.findall(r"<h(\d)>", page)[1:]) == {"2"}


def test_the_plan_is_listed(page):
    assert "<td>0</td><td>40</td><td>3</td><td>1.2 s</td>" in page
    # Nothing of this plan is in the air.
    assert "times through the air" not in page
    assert "91.7 %" in page


def test_several_skins_are_listed_with_what_touches_them(two_skins):
    page = cells(page_of(two_skins))
    assert "A robot with 12 moving joints wears\n2 soft skins with 32" in page
    assert "<td>forearm</td><td>on left_arm::forearm</td>" in page
    assert "<td>left_tip</td><td>on left_hand::" in page
    rows = re.findall(
        r"<td>(\d)</td><td>(\w+)</td><td>(\d+)</td><td>([\d, ]+)</td><td>\4</td>", page
    )
    assert rows == [("0", "body", "50", "1, 0, 1"), ("1", "forearm", "30", "1, 0, 0")]
    assert "<td>3.4 %</td>" in page


def test_a_flight_is_no_lost_contact(two_skins):
    _, (row,), _ = plan_table(RunData(two_skins))
    assert row[:4] == ("64", "8", "4", "1")
    assert row[5] == "100.0 %"


@pytest.mark.usefixtures("unrendered", "without_babbling")
@pytest.mark.parametrize(
    ("stage", "verbs"),
    [
        ("nothing", {"babble", "learn", "plan", "evaluate"}),
        ("learned", {"plan", "evaluate"}),
        ("planned", {"execute", "evaluate"}),
    ],
)
def test_missing_stages_are_named_with_their_remedy(make_run, stage, verbs):
    page = write_report(make_run(stage)).read_text(encoding="utf-8")
    found = set(re.findall(r"selftouch (babble|plan|execute|evaluate)", page))
    assert found - {"babble"} == verbs - {"babble", "learn"}
    assert Links(page).targets.count("playback.html") == 0


def test_progress_rises_to_one(make_run):
    reported = []
    write_report(make_run("nothing"), lambda fraction, doing: reported.append(fraction))
    assert reported == sorted(reported)
    assert reported[-1] == 1.0
