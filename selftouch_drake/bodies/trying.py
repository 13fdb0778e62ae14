"""Tries a body: moves it a little, and says in words what it is like and what is wrong."""

import time
from collections.abc import Iterator

import numpy as np

from selftouch_drake.agent.body import Felt
from selftouch_drake.bodies.checked import CheckedBody

#: Postures that are tried by default, of a body that jumps.
_JUMPED = 500

#: Likewise, of a body that travels.
_TRAVELLED = 20

#: Standard deviation of a step of a body that travels, as a share of each joint's range.
_STRIDE = 0.06

#: Times that one posture is visited again.
_VISITS = 5

#: A reading counts as touch beyond so many standard deviations between visits of one posture.
_FIRM = 6.0

#: Visits of one posture may differ by this share of what postures differ by.
_UNLIKE = 0.2

#: At least this share of the postures must be reached.
_MISSED = 0.5


def try_body(body: CheckedBody, num_postures: int | None = None) -> Iterator[str]:
    """Lines about a body, as they are found; what is wrong begins with `problem:`.

    A body that travels begins in the middle of its limits, and goes on from there in small steps.

    Raises:
        BodyError: it does not do what a body must.
    """
    yield f"{body.name}: {len(body.joint_names)} joints, {body.num_receptors} receptors"
    for name, *limits in zip(
        body.joint_names, body.lower, body.upper, body.velocity, body.acceleration, strict=True
    ):
        yield "  {}: {:.4g} to {:.4g}, at most {:.4g}/s and {:.4g}/s²".format(name, *limits)
    rng = np.random.default_rng(0)
    num = num_postures or (_JUMPED if body.jumps else _TRAVELLED)
    span, middle = body.upper - body.lower, (body.lower + body.upper) / 2
    if body.jumps:
        asked = rng.uniform(body.lower, body.upper, (num, len(span)))
    else:
        steps = _STRIDE * span * rng.normal(size=(num, len(span)))
        asked = (middle + np.cumsum(steps, axis=0) - steps[0]).clip(body.lower, body.upper)
    began = time.perf_counter()
    felt = body.feel(asked)
    speed = num / (time.perf_counter() - began)
    slow = "" if body.jumps else f", {body.robot_s / num:.2g} s of the robot each"
    yield (
        f"feels {speed:.3g} postures per second{slow}; "
        f"it {'jumps' if body.jumps else 'travels'} to them, and reached {felt.reached.mean():.0%}"
    )
    if felt.reached.mean() < _MISSED:
        yield (
            f"problem: {1 - felt.reached.mean():.0%} of the postures are not reached; narrow lower "
            "and upper, or look why it stops"
        )
    if felt.reached.any():
        ends = asked[felt.reached][[0, -1]]
        yield from _differences(body, body.feel(np.tile(ends, (_VISITS, 1))), felt)
    moved = np.ptp(felt.q, axis=0) > 0.1 * np.ptp(asked, axis=0)
    for name in np.array(body.joint_names)[~moved]:
        yield f"problem: {name} does not move; leave it out, or look what holds it"


def _differences(body: CheckedBody, again: Felt, felt: Felt) -> Iterator[str]:
    """What the readings are at rest, whether visits feel alike, and what is touched."""
    visits = again.sensation.reshape(_VISITS, 2, -1)
    noise = visits.std(axis=0).max(axis=0)
    rest = np.median(felt.sensation, axis=0)
    apart = np.abs(felt.sensation - rest)
    differ, most = float(np.ptp(visits, axis=0).max()), float(apart.max())
    yield (
        f"at rest receptors read {rest.min():.4g} to {rest.max():.4g}; visits of one posture "
        f"differ by up to {differ:.3g}, postures by {most:.3g}"
    )
    firm = apart > np.maximum(_FIRM * noise, 1e-6 * np.abs(rest) + 1e-12)
    touched, felt_once = firm.any(axis=1).sum(), firm.any(axis=0).sum()
    yield (
        f"touches in {touched} of {len(firm)} postures, of {felt_once} of {body.num_receptors} "
        "receptors"
    )
    if differ > _UNLIKE * most:
        yield (
            "problem: the same posture feels as different each time as others do; it touches "
            "nothing, or feel does not wait until the robot is still, or readings drift"
        )
    elif not touched:
        yield (
            "problem: no posture touches anything; look whether it can reach itself, and whether "
            "the receptors are connected, or try more postures"
        )
    if touched > 0.9 * len(firm):
        yield (
            "problem: it touches in nearly every posture; most receptors must rest most of the time"
        )
