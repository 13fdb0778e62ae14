"""Faults of a skin, put into the stored readings of a run: named right, and healthy ones blamed.

    python benchmarks/accuracy/skin_faults.py build/cube_951 build/torus_951 --seeds 20
    python benchmarks/accuracy/skin_faults.py RUN... --seeds 20 --drift

A run that is missing, of a body and a seed, is babbled and learned. For each run, seed and kind of
fault, a fault is put into some touches of the run, at receptors that the seed draws, and the faults
are found as `selftouch skin` finds them. A case is right if each of its receptors has the right
verdict, and those that stand in each other's place are named. With --drift the first half of the
touches is the first recording, and a fault is put into the second half; no file of places is used.
There is a row for each kind.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from sys import path as search_path

import numpy as np

from selftouch_drake.agent.readings.receptor_faults import (
    Fault,
    SkinFaults,
    find_faults,
    neighbours_in_file,
)
from selftouch_drake.agent.readings.skin_drift import compare_skins
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.receptor_map import read_touches
from selftouch_drake.run.skin import accepted_model, skins_of, touches_on
from selftouch_drake.run.stages import has_learned, learn

search_path.append(str(Path(__file__).parents[2]))  # for `benchmarks`

from benchmarks.shared.babbled import run_at
from benchmarks.shared.results import add_update_option, results

#: What is put in, and the verdict that is right; none for a skin that is well.
KINDS = {
    "nothing": None,
    "dead": Fault.DEAD,
    "dead board": Fault.DEAD,
    "stuck": Fault.STUCK,
    "flickers": Fault.FLICKERS,
    "drops out": Fault.DROPS_OUT,
    "exchanged": Fault.EXCHANGED,
    "turned triangle": Fault.EXCHANGED,
    "elsewhere": Fault.ELSEWHERE,
}
#: Kinds between two recordings.
CHANGES = {
    "nothing": None,
    "dead": "dead",
    "dead board": "dead",
    "stuck": "stuck",
    "flickers": "flickers",
    "drops out": "drops out",
    "exchanged": "exchanged",
    "turned triangle": "exchanged",
    "weaker": "weaker",
}
#: Receptors of a board.
_BOARD = 8


def put_in(
    kind: str, sensation: np.ndarray, place: np.ndarray, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, dict[int, int]]:
    """Touches with a fault, places of a file with a fault, and where each faulty receptor reads.

    Args:
        kind: of `KINDS` or `CHANGES`.
        sensation: `(n, S)` touches.
        place: `(S, 3)` of a file.
        random: draws receptors and amounts.
    """
    sensation, place = sensation.copy(), place.copy()
    number = sensation.shape[1]
    one = int(random.integers(number))
    apart = np.linalg.norm(place - place[one], axis=1)
    at = {one: one}
    strong = float(np.median(sensation.max(axis=1)))
    if kind == "nothing":
        at = {}
    elif kind == "dead":
        sensation[:, one] = 0.0
    elif kind == "dead board":
        board = np.argsort(apart)[:_BOARD]
        sensation[:, board] = 0.0
        at = {int(n): int(n) for n in board}
    elif kind == "stuck":
        sensation[:, one] = strong * random.uniform(0.3, 2.0)
    elif kind == "flickers":
        on = random.random(len(sensation)) < np.exp(random.uniform(*np.log([0.03, 0.3])))
        sensation[on, one] = strong * random.uniform(0.2, 2.0, on.sum())
    elif kind == "drops out":
        off = random.random(len(sensation)) < random.uniform(0.5, 0.9)
        sensation[off, one] = 0.0
    elif kind == "weaker":
        sensation[:, one] *= random.uniform(0.3, 0.7)
    elif kind == "exchanged":
        other = int(random.choice(np.flatnonzero(np.arange(number) != one)))
        sensation[:, [one, other]] = sensation[:, [other, one]]
        at = {one: other, other: one}
    elif kind == "turned triangle":
        three = np.argsort(apart)[:3]
        sensation[:, three] = sensation[:, np.roll(three, 1)]
        at = dict(zip(three.tolist(), np.roll(three, 1).tolist(), strict=True))
    elif kind == "elsewhere":
        # Somewhere on the skin beside another receptor.
        other = int(random.choice(np.flatnonzero(np.arange(number) != one)))
        near = np.argsort(np.linalg.norm(place - place[other], axis=1))[1]
        place[one] = 0.7 * place[other] + 0.3 * place[near]
    return sensation, place, at


def spacing(place: np.ndarray) -> float:
    """Median distance to the next receptor, of `(S, 3)` places."""
    apart = np.linalg.norm(place[:, None] - place, axis=2)
    np.fill_diagonal(apart, np.inf)
    return float(np.median(apart.min(axis=1)))


def named_right(kind: str, found: SkinFaults, at: dict[int, int]) -> bool:
    """Whether each faulty receptor has its verdict."""
    for receptor, where in at.items():
        if found.fault[receptor] != KINDS[kind]:
            return False
        if kind in ("exchanged", "turned triangle") and found.read_as[receptor] != where:
            return False
    return True


def one_recording(path: Path, args: argparse.Namespace, rows: dict[str, list]) -> None:
    """Puts each kind of fault into a run, and counts."""
    run = RunDirectory.open(path)
    q, sensation, names = read_touches(path, args.touches, {})
    (skin,) = skins_of(run, names)
    assert skin.place is not None, f"{path} has no places of receptors"
    model = accepted_model(run)
    for kind in args.kinds or KINDS:
        for seed in range(args.first, args.first + args.seeds):
            random = np.random.default_rng([seed, list(KINDS).index(kind)])
            worn, place, at = put_in(kind, sensation.astype(float), skin.place, random)
            felt = worn.any(axis=1)
            on_place = None
            if model is not None:
                on_place = touches_on(model, q[felt].astype(float), replace(skin, place=place))
            found = find_faults(worn[felt], names, neighbours_in_file(place), on_place)
            blamed = sorted(set(found.faulty.tolist()) - set(at))
            right = named_right(kind, found, at)
            rows.setdefault(kind, []).append((right, len(blamed), len(names) - len(at)))
            if args.verbose and (blamed or not right):
                off = np.linalg.norm(place - skin.place, axis=1).max() / spacing(skin.place)
                said = [(n, str(found.fault[n]), found.evidence[n]) for n in [*at, *blamed]]
                print(
                    f"{path.name} {kind} seed {seed}: {at} off by {off:.1f} right {right}, {said}"
                )


def two_recordings(path: Path, args: argparse.Namespace, rows: dict[str, list]) -> None:
    """Puts each kind of change into the second half of a run, and counts."""
    _, sensation, names = read_touches(path, 2 * args.touches, {})
    run = RunDirectory.open(path)
    (skin,) = skins_of(run, names)
    assert skin.place is not None, f"{path} has no places of receptors"
    before, after = np.array_split(sensation.astype(float), 2)
    for kind in args.kinds or CHANGES:
        for seed in range(args.first, args.first + args.seeds):
            random = np.random.default_rng([seed, list(CHANGES).index(kind), 2])
            worn, _, at = put_in(kind, after, skin.place, random)
            found = compare_skins(before, worn[worn.any(axis=1)], names)
            changed = {n: what for n, what, _ in found.changes}
            blamed = sorted(set(changed) - set(at))
            right = all(
                (CHANGES[kind] or "") in changed.get(n, "-")
                and (CHANGES[kind] != "exchanged" or found.after.read_as[n] == where)
                for n, where in at.items()
            )
            rows.setdefault(kind, []).append((right, len(blamed), len(names) - len(at)))
            if args.verbose and (blamed or not right):
                print(f"{path.name} {kind} seed {seed}: {at} right {right}, {found.changes}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--seeds", type=int, default=20, help="of each kind and run")
    parser.add_argument("--first", type=int, default=0, help="seed")
    parser.add_argument("--touches", type=int, default=3000, help="of a recording")
    parser.add_argument("--babbled", type=int, default=6000, help="touches of a run that is made")
    parser.add_argument("--kinds", nargs="+", choices=sorted({*KINDS, *CHANGES}))
    parser.add_argument("--drift", action="store_true", help="between two recordings")
    parser.add_argument("--verbose", action="store_true", help="print each case that is not right")
    add_update_option(parser, "skin_faults")
    args = parser.parse_args()
    rows: dict[str, list] = {}
    for path in args.runs:
        run = run_at(path, args.babbled)
        if not has_learned(run):
            learn(run)
        (two_recordings if args.drift else one_recording)(path, args, rows)
    faulty = [case for kind, cases in rows.items() if kind != "nothing" for case in cases]
    every = {**rows, "all": [case for cases in rows.values() for case in cases]}
    with results("skin_drift" if args.drift else "skin_faults", update=args.update) as add:
        for kind, cases in every.items():
            named = {"nothing": [], "all": faulty}.get(kind, cases)
            _, blamed, healthy = np.array(cases).T
            row = {
                "fault": kind,
                "cases": len(named),
                "named_right": sum(bool(case[0]) for case in named),
                "healthy": int(healthy.sum()),
                "healthy_blamed": int(blamed.sum()),
                "blamed_worst": int(blamed.max()),
            }
            print(row)
            add(row)


if __name__ == "__main__":
    main()
