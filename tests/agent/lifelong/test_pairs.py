"""The pair seeker finds pairs of places that random postures seldom find."""

import numpy as np

from selftouch_drake.agent.lifelong.pairs import PairSeeker, TouchPairs, touching_pairs

NUM_JOINTS = 8
FINGER, BODY = 6, 60


def feels(q):
    """A finger moves along a body, which other joints must bend the more, the farther it goes.

    The finger's tip and the place that it touches both feel it; far along, four joints must be near
    their limits.
    """
    at, bent = q[:, 0], q[:, 1:4]
    touches = (bent > at[:, None] - 0.15).all(axis=1)
    near = np.abs(np.linspace(0.0, 1.0, BODY) - at[:, None]) < 0.03
    tip = np.abs(np.linspace(0.0, 1.0, FINGER) - q[:, 4:5]) < 0.3
    return np.hstack([tip, near]) * touches[:, None].astype(float)


def explored(num_rounds, *, learns, seed):
    """What was felt in rounds of 200 postures."""
    pairs, rng, all_felt = TouchPairs(), np.random.default_rng(seed), []
    for _ in range(num_rounds):
        moves = PairSeeker(
            agent=None,
            q=np.full(NUM_JOINTS, 0.5),
            felt=np.zeros(FINGER + BODY),
            rng=rng,
            lower=np.zeros(NUM_JOINTS),
            upper=np.ones(NUM_JOINTS),
            stride=np.full(NUM_JOINTS, 0.05),
            pairs=pairs,
            timed=False,
        ).moves()
        path, asked = next(moves), []
        for _ in range(200):
            asked.append(path[-1])
            path = moves.send((path, feels(path)))
        asked = np.array(asked)
        felt = feels(asked)
        if learns:
            pairs.take(asked[felt.any(axis=1)], felt[felt.any(axis=1)])
        all_felt.append(felt)
    return np.concatenate(all_felt), pairs


def test_it_seeks_rare_pairs():
    far = slice(FINGER + BODY * 9 // 10, None)
    for seed in range(2):
        seeking, _ = explored(12, learns=True, seed=seed)
        at_random, _ = explored(12, learns=False, seed=seed)
        found, by_chance = (felt[:, far].any(axis=1).sum() for felt in (seeking, at_random))
        assert found > 1.4 * by_chance, seed


def held(num_postures, *, rng):
    """Four places while postures are held for 10 looks each: what is asked for, and what is felt.

    The first touches the second in every sixth posture, and other things in some; the third feels
    anything, and the fourth is lain on in most postures, steadily.
    """
    asked = np.repeat(np.arange(float(num_postures)), 10)[:, None]
    felt = np.exp(rng.normal(0.0, 0.3, (len(asked), 4)))
    kind = asked[:, 0] % 6
    felt[:, 1] = np.where(kind == 0, 3.0 * felt[:, 0], 0.0)
    felt[kind > 2, 0] = 0.0
    felt[rng.random(len(asked)) < 0.6, 2] = 0.0
    felt[:, 3] = np.where((kind == 0) | (kind > 2), 10.0, 0.0)
    return asked, np.repeat(felt, 3, axis=1)


def test_places_whose_strengths_change_alike_touch_each_other():
    pairs = TouchPairs()
    asked, felt = held(48, rng=np.random.default_rng(0))
    for start in range(0, 480, 60):
        pairs.take(asked[start : start + 60], felt[start : start + 60])
    first, second = pairs.pool[0], pairs.pool[3]
    assert len(set(pairs.pool)) == 4
    ((pair, touches),) = pairs.seen.items()
    assert pair == (min(first, second), max(first, second))
    postures = [pairs.posture(touch).item() for touch in touches]
    assert postures == [float(number) for number in range(0, 48, 6)]
    assert pairs.num_touches == 480


def test_of_one_look_all_places_are_pairs():
    assert touching_pairs(np.array([[0.0, 1.0, 2.0, 3.0]])) == [(1, 2), (1, 3), (2, 3)]


def test_a_held_posture_is_one_of_many_looks():
    """The body is given time to get there and to press."""
    seeker = PairSeeker(
        agent=None,
        q=np.zeros(2),
        felt=np.zeros(4),
        rng=np.random.default_rng(0),
        lower=-np.ones(2),
        upper=np.ones(2),
        stride=np.ones(2),
        pairs=TouchPairs(),
    )
    moves = seeker.moves()
    there = next(moves)
    pressed = moves.send((there, np.zeros((1, 4))))
    assert there.shape == (1, 2)
    assert len(pressed) > 4
    assert (pressed == there).all()
    assert (np.abs(pressed) <= 1.0).all()
