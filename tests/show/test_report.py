import html
import re
from html.parser import HTMLParser

import pytest

from selftouch_drake.show import headline, readings, write_report


class Links(HTMLParser):
    """Gathers what a page asks for, and which elements it has."""

    def __init__(self, page: str):
        super().__init__()
        self.targets, self.tags = [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.targets += [value for name, value in attrs if name in ("src", "href", "srcset")]


@pytest.fixture(scope="module")
def page(reported):
    return reported.report.read_text(encoding="utf-8")


def test_the_report_asks_nothing_of_a_network(page, reported):
    links = Links(page)
    assert links.targets.count("playback.html") == 1
    images = [target for target in links.targets if target != "playback.html"]
    assert len(images) == 11
    assert all(image.startswith("data:image/png;base64,iVBORw0KGgo") for image in images)
    assert "://" not in re.sub(r'src="[^"]*"', "", page)
    assert "url(" not in page
    assert reported.playback.is_file()


def test_a_malicious_name_is_text(page, reported):
    assert "script" not in Links(page).tags
    assert reported.experiment.name not in page
    assert html.escape(reported.experiment.name) in page.replace("&#34;", "&quot;")


def test_figures_are_told_with_meaning_and_unit(page):
    assert "1.2 %" in page
    assert "error of the recovered body, as a share of its extent" in page


def test_the_plan_is_listed(page):
    assert "<td>0</td><td>40</td><td>3</td>" in page
    assert "91.7 %" in page


@pytest.mark.parametrize(
    ("stage", "verbs"),
    [
        ("nothing", {"babble", "learn", "plan", "evaluate"}),
        ("learned", {"plan", "evaluate"}),
        ("planned", {"execute", "evaluate"}),
    ],
)
def test_missing_stages_are_named_with_their_remedy(make_run, unrendered, stage, verbs):
    page = write_report(make_run(stage)).read_text(encoding="utf-8")
    found = set(re.findall(r"selftouch (babble|plan|execute|evaluate)", page))
    assert found - {"babble"} == verbs - {"babble", "learn"}
    assert Links(page).targets.count("playback.html") == 0


def test_progress_rises_to_one(make_run):
    told = []
    write_report(make_run("nothing"), lambda fraction, doing: told.append(fraction))
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_every_figure_of_the_contract_has_a_meaning():
    keys = {
        "babbling_num_samples": 100_000,
        "topology_betti": [1, 0, 1],
        "kernel_spread_median_m": 0.0191,
        "neighbour_agreement": 0.905,
        "shape_rms_fraction_by_metric": {"literal": 0.114, "motor": 0.05},
        "planning_query_ms_p95": 21.4,
        "execution_tracking_rms_rad": 0.0031,
        "execution_force_max_N": 6.2,
        "a_new_figure": 1234.5,
    }
    told = {r.key: (r.value, bool(r.meaning)) for stage in readings(keys).values() for r in stage}
    assert told == {
        "babbling_num_samples": ("100,000", True),
        "topology_betti": ("1, 0, 1", True),
        "kernel_spread_median_m": ("0.0191 m", True),
        "neighbour_agreement": ("90.5 %", True),
        "shape_rms_fraction_by_metric": ("literal 11.4 %, motor 5.0 %", True),
        "planning_query_ms_p95": ("21.4 ms", True),
        "execution_tracking_rms_rad": ("0.0031 rad", True),
        "execution_force_max_N": ("6.2 N", True),
        "a_new_figure": ("1,234", False),
    }


def test_the_headline_holds_what_is_known():
    assert headline({}) == []
    figures = {"execution_contact_mean": 0.997, "shape_rms_fraction": 0.038}
    assert headline(figures) == [("shape error", "3.8 %"), ("contact held", "99.7 %")]
