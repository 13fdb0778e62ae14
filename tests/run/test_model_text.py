import dataclasses

import numpy as np
import pytest

from selftouch_drake.agent.body_model.model import BASE, UNUSED, JointKind, rejected
from selftouch_drake.run.model_text import (
    JOINT_COLUMNS,
    PART_COLUMNS,
    headline,
    model_text,
    verdict,
)


@pytest.fixture
def model():
    """A trunk that turns, with an arm that slides on it, a head, and a joint that nobody needs."""
    blank = rejected(
        "rejected: too few touches.",
        joint_names=("trunk", "arm", "hand", "tail", "head"),
        kernel_part=np.array([0, 0, 1]),
        num_rows=3,
        num_receptors=4,
    )
    kind = [JointKind.TURNS, JointKind.SLIDES, JointKind.OPEN, JointKind.UNUSED, JointKind.TURNS]
    twists = np.zeros((5, 6))
    twists[0, :3], twists[1, 3:] = [0, 0, 2.0], [0, 0.1, 0]
    twists[2], twists[4, :3] = [0.01, 0, 0, 0, 1, 0], [-1.0, 0, 0]
    sigma = np.full((5, 6), 0.001)
    sigma[2] = np.nan
    return dataclasses.replace(
        blank,
        joint_parent=np.array([BASE, 0, 1, UNUSED, 0]),
        joint_kind=np.array([int(each) for each in kind]),
        twists=twists,
        twist_sigma=sigma,
        order_group=np.array([0, -1, -1, -1, 0]),
        part_link=np.array([BASE, 4]),
        toucher_link=np.array([2]),
        toucher_place=np.zeros((1, 3)),
        covariance=np.diag(np.concatenate([np.square(sigma).ravel(), np.zeros(3)])),
        toucher_shape=np.zeros((1, 5)),
        accepted_by_part=np.array([True, False]),
        reason="Part 1 bends.",
        held_out=np.array([0.971, 0.5]),
        inliers=np.array([0.999, np.nan]),
        num_touches=np.array([12_000, 40]),
        dimension=3,
    )


def test_every_joint_has_a_row(model):
    rows = {row[0]: dict(zip(JOINT_COLUMNS, row, strict=True)) for row in model_text(model).joints}
    assert rows["trunk"]["kind"] == "turns"
    assert rows["trunk"]["axis"] == "+0.000 +0.000 +1.000"
    assert rows["trunk"]["per reading"] == "2 ± 0.001 rad"
    assert rows["trunk"]["order"] == "on the base"
    assert rows["trunk"]["standard error"] == f"{np.degrees(0.001 / 2):.2g}°"
    assert rows["trunk"]["open"] == "order with head"
    assert rows["arm"]["per reading"] == "0.1 ± 0.001"
    assert rows["arm"]["order"] == "after trunk"
    assert rows["hand"]["kind"] == "turns or slides"
    assert rows["hand"]["standard error"] == "unknown"
    assert rows["hand"]["open"] == "kind, axis"
    assert set(rows["tail"].values()) == {"tail", "not used", ""}
    assert rows["head"]["open"] == "order with trunk"


def test_what_is_unknown_has_no_number(model):
    per_reading = dict(zip(JOINT_COLUMNS, model_text(model).joints[2], strict=True))["per reading"]
    assert "nan" not in per_reading


def test_the_tree_is_drawn_from_the_base(model):
    assert list(model_text(model).tree) == [
        "base (wears part 0)",
        "└─ trunk",
        "   ├─ arm > hand (touches with toucher 0)",
        "   └─ head (wears part 1)",
    ]


def test_points_of_a_hand_are_named_together(model):
    several = dataclasses.replace(
        model,
        toucher_link=np.repeat(model.toucher_link, 3),
        toucher_place=np.repeat(model.toucher_place, 3, axis=0),
        toucher_shape=np.repeat(model.toucher_shape, 3, axis=0),
        covariance=np.zeros((39, 39)),
    )
    assert "   ├─ arm > hand (touches with touchers 0, 1, 2)" in model_text(several).tree


def test_parts_are_judged_one_by_one(model):
    rows = [dict(zip(PART_COLUMNS, row, strict=True)) for row in model_text(model).parts]
    assert [row["judgement"] for row in rows] == ["accepted", "rejected"]
    assert [row["held-out touches"] for row in rows] == ["97.1%", "50.0%"]
    assert [row["no outliers"] for row in rows] == ["99.9%", ""]
    assert [row["touches"] for row in rows] == ["12,000", "40"]


def test_the_assumption_and_what_is_unknowable_are_named(model):
    text = " ".join(model_text(model).sentences)
    assert "Assumed: rigid links on joints that turn or slide. Tested on touches" in text
    assert "Part 1 bends." in text
    assert "Where the model was not accepted" in text
    assert "how deep under the skin" in text


def test_one_line_says_the_most(model):
    assert headline(model) == (
        "accepted on all parts but fragments: 2 joints turn, 1 joint slides, 1 turns or slides; "
        "97% of the held-out touches agree with rigid links on joints that turn or slide"
    )
    nothing = dataclasses.replace(model, accepted_by_part=np.zeros(2, dtype=bool))
    assert (verdict(nothing), headline(nothing)) == ("rejected", "rejected: Part 1 bends.")
    told = dataclasses.replace(nothing, reason="rejected: too few.")
    assert headline(told) == "rejected: too few."
    off = dataclasses.replace(nothing, reason="off")
    assert (verdict(off), headline(off)) == ("off", "off")
    assert model_text(off).sentences == [
        "The agent was not asked for a body model: representation.body_model is off."
    ]
    whole = dataclasses.replace(model, accepted_by_part=np.ones(2, dtype=bool))
    assert verdict(whole) == "accepted"


def test_nothing_is_no_tree():
    blank = rejected(
        "no", joint_names=("a",), kernel_part=np.zeros(2, int), num_rows=1, num_receptors=1
    )
    text = model_text(blank)
    assert text.tree == []
    assert text.joints == [("a", "not used", "", "", "", "", "")]
