"""What is wrong with the skin of a run, or what changed in it since another run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from selftouch_drake.agent.body_model.model import BodyModel
from selftouch_drake.agent.body_model.two_recordings import Touches, changed_between
from selftouch_drake.agent.given_model.taxels import compared
from selftouch_drake.agent.readings.receptor_faults import (
    Fault,
    SkinFaults,
    find_faults,
    neighbours_in_file,
)
from selftouch_drake.agent.readings.skin_drift import (
    SkinDrift,
    SkinMove,
    compare_skins,
    field_centres,
    skin_move,
)
from selftouch_drake.experiment.receptor_files import read_receptors
from selftouch_drake.files import load_arrays, write_csv
from selftouch_drake.quotient.sensations import assign
from selftouch_drake.run.artifacts import load_body_model, load_representation
from selftouch_drake.run.directory import RunDirectory, RunError
from selftouch_drake.run.receptor_map import read_touches

#: Columns of the table in the terminal, of one run and of two.
FAULT_COLUMNS = ("receptor", "verdict", "felt", "due", "evidence")
CHANGE_COLUMNS = ("receptor", "change", "evidence")
# Fewest touches and receptors of a skin that are judged.
_LEAST_TOUCHES, _LEAST_RECEPTORS = 50, 4
# m; places that differ by less are the same.
_SAME_PLACE = 1e-6
# If this share of the receptors changed, the runs are hardly of one robot.
_TOO_MANY = 0.5
# A raw reading that never moves is stuck if it rests so many times as far from the others' level
# as these spread; else its receptor is dead.
_APART = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Skin:
    """One skin of a run.

    Attributes:
        name: empty if the run has only one.
        receptors: `(s,)` numbers of its readings.
        names: s of them.
        place: `(s, 3)` m, where a file says that they are; None if nobody knows.
    """

    name: str
    receptors: np.ndarray
    names: Sequence[str]
    place: np.ndarray | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CheckedSkin:
    """A skin, and what is wrong with it."""

    skin: Skin
    faults: SkinFaults


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ComparedSkin:
    """A skin in two runs.

    Attributes:
        skin: as the first run has it.
        drift: what changed.
        move: how it moved as a whole; None if the first run has no body model that tells.
        joints: of each toucher that touched it often enough, what changed of the joints between
            them, in words; empty if nothing did. None if the first run has no body model.
    """

    skin: Skin
    drift: SkinDrift
    move: SkinMove | None
    joints: Sequence[tuple[int, str]] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Taxels:
    """A file of places, and which receptors it has.

    Attributes:
        file: as in `read_receptors`.
        receptors: the first and the last of its receptors; None for all.
    """

    file: Path
    receptors: tuple[int, int] | None = None


def check_skins(run: RunDirectory, most: int, taxels: Taxels | None = None) -> list[CheckedSkin]:
    """Looks for faults in each skin of a run; nothing is written.

    Args:
        run: with touches.
        most: touches that are read.
        taxels: where a file says that the receptors are; by default what the run's own robot says.

    Raises:
        ValueError: there are too few touches or receptors, or the file cannot be used.
    """
    q, sensation, names = _touches(run, most)
    model = accepted_model(run)
    checked = []
    for skin in skins_of(run, names, taxels):
        of_skin = sensation[:, skin.receptors]
        rows = np.flatnonzero(of_skin.any(axis=1))
        if len(rows) < _LEAST_TOUCHES:
            continue
        on_place = None
        if skin.place is not None and model is not None:
            on_place = touches_on(model, q[rows], skin)
        faults = find_faults(
            of_skin[rows],
            skin.names,
            None if skin.place is None else neighbours_in_file(skin.place),
            on_place,
        )
        checked.append(CheckedSkin(skin=skin, faults=_with_import(run, skin, faults)))
    if not checked:
        raise RunError(
            f"{run.path} has no skin with {_LEAST_TOUCHES} touches or more; give a run with more"
        )
    return checked


def compare_runs(
    first: RunDirectory, second: RunDirectory, most: int, taxels: Taxels | None = None
) -> list[ComparedSkin]:
    """Compares the skins of two runs of one robot; arguments and errors are as in `check_skins`.

    Raises:
        RunError: the runs have other receptors, or other joints.
    """
    q_first, before, names = _touches(first, most)
    q_second, after, other = _touches(second, most)
    if len(names) != len(other) or q_first.shape[1] != q_second.shape[1]:
        raise RunError(
            f"{first.path} has {len(names)} receptors and {q_first.shape[1]} joints, {second.path} "
            f"{len(other)} and {q_second.shape[1]}; give two runs of one robot"
        )
    skins = skins_of(first, names, taxels)
    if taxels is None:
        _require_same_places(first, skins, second, skins_of(second, other))
    model = accepted_model(first)
    known = () if model is None else _known_touches(first, (q_first, before), (q_second, after))
    found = []
    for skin in skins:
        here = [some[:, skin.receptors] for some in (before, after)]
        rows = [np.flatnonzero(some.any(axis=1)) for some in here]
        if min(map(len, rows)) < _LEAST_TOUCHES:
            continue
        drift = compare_skins(
            here[0][rows[0]],
            here[1][rows[1]],
            skin.names,
            None if skin.place is None else neighbours_in_file(skin.place),
        )
        move = joints = None
        if model is not None:
            start, end = (
                field_centres(model.place(some.q[own], some.target[own]), felt[own])
                for some, felt, own in zip(known, here, rows, strict=True)
            )
            move = skin_move(start, end)
            changed = skin.receptors[[number for number, _, _ in drift.changes]]
            well = np.setdiff1d(skin.receptors, changed)
            pairs = changed_between(model, *(_felt_by(some, well) for some in known))
            joints = [
                (pair.toucher, pair.change.said(model.joint_names) if pair.change else "")
                for pair in pairs
            ]
        found.append(ComparedSkin(skin=skin, drift=drift, move=move, joints=joints))
    if not found:
        raise RunError(
            f"{first.path} and {second.path} have no skin with {_LEAST_TOUCHES} touches or more in "
            "both; give runs with more"
        )
    return found


def _felt_by(touches: Touches, receptors: np.ndarray) -> Touches:
    """The touches that some receptors feel, and what these read."""
    alone = np.zeros_like(touches.sensation)
    alone[:, receptors] = touches.sensation[:, receptors]
    return touches._replace(sensation=alone).some(np.flatnonzero(alone.any(axis=1)))


def skins_of(run: RunDirectory, names: Sequence[str], taxels: Taxels | None = None) -> list[Skin]:
    """The skins of a run, each with places if the run's robot or a file has them.

    Raises:
        ValueError: the file does not fit the receptors.
    """
    if taxels is not None:
        first, last = taxels.receptors or (0, len(names) - 1)
        if not 0 <= first <= last < len(names):
            raise RunError(
                f"--receptors is {first},{last}; give two numbers from 0 to {len(names) - 1}"
            )
        table = read_receptors(str(taxels.file))
        numbers = np.arange(first, last + 1)
        if len(table.p_LS) != len(numbers):
            raise RunError(
                f"--taxels: {taxels.file} has {len(table.p_LS)} receptors, the skin "
                f"{len(numbers)}; give a row for each in the order of the readings, or choose the "
                "receptors of the file by --receptors"
            )
        chosen = list(names[first : last + 1])
        return [Skin(name="", receptors=numbers, names=chosen, place=table.p_LS)]
    if not run.skin.exists():
        everything = np.arange(len(names))
        return [Skin(name="", receptors=everything, names=list(names), place=None)]
    arrays = load_arrays(run.skin, ["receptor_skin"])
    found = []
    for number, name in enumerate(run.experiment.skins):
        receptors = np.flatnonzero(arrays["receptor_skin"] == number)
        place = arrays.get(f"{name}_p_LS")
        # A reading may be made of those of several receptors.
        fits = place is not None and len(place) == len(receptors)
        if len(receptors) >= _LEAST_RECEPTORS:
            found.append(
                Skin(
                    name=name if len(run.experiment.skins) > 1 else "",
                    receptors=receptors,
                    names=[names[receptor] for receptor in receptors.tolist()],
                    place=place if fits else None,
                )
            )
    return found


def fault_rows(checked: Sequence[CheckedSkin]) -> list[list[str]]:
    """A row of `FAULT_COLUMNS` for each receptor that is not well."""
    return [
        [skin.names[n], str(found.fault[n]), f"{found.felt[n]:,}", f"{found.expected[n]:,.0f}",
         found.evidence[n]]
        for skin, found in ((one.skin, one.faults) for one in checked)
        for n in np.flatnonzero(found.fault != Fault.NONE).tolist()
    ]  # fmt: skip


def check_lines(checked: Sequence[CheckedSkin]) -> list[str]:
    """A line for each skin, and for what nobody knows."""
    lines = []
    for one in checked:
        found = one.faults
        unmet = int((found.fault == Fault.UNKNOWN).sum())
        of = f" of {one.skin.name}" if one.skin.name else ""
        lines.append(
            f"skin: {(found.fault == Fault.NONE).sum()} of {len(found.fault)} receptors{of} are "
            f"well, {len(found.faulty)} are not" + (f", {unmet} were never met" if unmet else "")
        )
        if not found.overlap:
            lines.append(
                f"fields{of} hardly overlap: neighbours do not tell what a receptor should feel, "
                "so most faults cannot be told"
            )
    if any(one.skin.place is None for one in checked):
        lines.append(
            "no file says where receptors are: those that are exchanged or never felt anything "
            "cannot be told; give --taxels, or a second run"
        )
    return lines


def drift_rows(found: Sequence[ComparedSkin]) -> list[list[str]]:
    """A row of `CHANGE_COLUMNS` for each receptor that changed."""
    return [
        [one.skin.names[number], what, evidence]
        for one in found
        for number, what, evidence in one.drift.changes
    ]


def drift_lines(found: Sequence[ComparedSkin]) -> list[str]:
    """A line for each skin: how many changed, and whether it moved as a whole."""
    lines = []
    for one in found:
        of = f" of {one.skin.name}" if one.skin.name else ""
        lines.append(
            f"skin: {len(one.drift.changes)} of {len(one.skin.names)} receptors{of} changed"
        )
        lost = one.drift.before.overlap and not one.drift.after.overlap
        if lost or len(one.drift.changes) > _TOO_MANY * len(one.skin.names):
            lines.append("are these two runs of one robot, with receptors in one order?")
        if one.joints is None:
            lines.append(
                "whether joints, or the skin as a whole, moved, only an accepted body model of the "
                "first run tells"
            )
            continue
        for toucher, moved in one.joints:
            by = f" by toucher {toucher}" if len(one.joints) > 1 else ""
            lines.append(f"joints: {moved or 'nothing moved'}, as touches{of}{by} say")
        if not one.joints:
            lines.append(f"joints: too few touches{of} to compare them")
        if one.move is None:
            lines.append(f"too few receptors{of} felt enough to tell whether it moved as a whole")
            continue
        move = one.move
        verb = "moved" if move.surely else "did not surely move"
        errors = 1.96 * move.shift_sigma, 1.96 * move.turn_sigma
        lines.append(
            f"the skin{of} {verb} as a whole: {move.shift:.2%} of its extent (± {errors[0]:.2%}) "
            f"and {move.turn:.4f} rad (± {errors[1]:.4f}); a joint whose zero moved looks the same"
        )
    return lines


def write_checked(path: Path, checked: Sequence[CheckedSkin]) -> None:
    """Writes a row for each receptor as CSV."""
    names = (
        *("receptor", "verdict", "felt", "due", "missed", "unexpected", "read_as", "likeness"),
        "evidence",
    )
    rows = []
    for skin, found in ((one.skin, one.faults) for one in checked):
        for n, name in enumerate(skin.names):
            at = int(found.read_as[n])
            rows.append(
                [name, found.fault[n], found.felt[n], f"{found.expected[n]:.1f}",
                 *(_number(v[n]) for v in (found.missed, found.unexpected)),
                 skin.names[at] if at >= 0 else "", _number(found.likeness[n]), found.evidence[n]]
            )  # fmt: skip
    write_csv(path, names, rows)


def write_compared(path: Path, found: Sequence[ComparedSkin]) -> None:
    """Writes a row for each receptor as CSV."""
    rows = []
    for one in found:
        changes = {number: (what, evidence) for number, what, evidence in one.drift.changes}
        for n, name in enumerate(one.skin.names):
            drift = one.drift
            rows.append(
                [name, drift.before.fault[n], drift.after.fault[n], _number(drift.gain[n]),
                 _number(drift.gain_sigma[n]), *changes.get(n, ("", ""))]
            )  # fmt: skip
    names = ("receptor", "before", "after", "gain", "log_gain_sigma", "change", "evidence")
    write_csv(path, names, rows)


def _number(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.4g}"


def _touches(run: RunDirectory, most: int) -> tuple[np.ndarray, np.ndarray, list[str]]:
    q, sensation, names = read_touches(run.path, most, {})
    if sensation.shape[1] < _LEAST_RECEPTORS or len(q) < _LEAST_TOUCHES:
        raise RunError(
            f"{run.path} has {len(q)} touches of {sensation.shape[1]} receptors; give a run with "
            f"{_LEAST_TOUCHES} and {_LEAST_RECEPTORS} or more"
        )
    return q.astype(float), sensation.astype(float), names


def _require_same_places(
    first: RunDirectory, skins: Sequence[Skin], second: RunDirectory, others: Sequence[Skin]
) -> None:
    """Refuses runs whose robots have receptors at other places, as experiments of two seeds do.

    Raises:
        RunError: they have.
    """
    for one, other in zip(skins, others, strict=False):
        if one.place is None or other.place is None:
            continue
        if one.place.shape != other.place.shape or not np.allclose(
            one.place, other.place, atol=_SAME_PLACE
        ):
            raise RunError(
                f"{first.path} and {second.path} have receptors at other places, as experiments of "
                "two seeds do; give two runs of one robot"
            )


def accepted_model(run: RunDirectory) -> BodyModel | None:
    """The body model of a run, if it has one and accepted it."""
    if not run.body_model.exists():
        return None
    model = load_body_model(run)
    return model if model.accepted else None


def touches_on(model: BodyModel, q: np.ndarray, skin: Skin) -> np.ndarray | None:
    """`(s,)` touches that the joints put nearest to the place of each receptor in the file.

    Nobody knows of bodies with several touchers or parts which of them a touch was made with: None.
    """
    assert skin.place is not None
    if len(model.toucher_link) != 1 or len(model.part_link) != 1:
        return None
    receptors = model.receptors()
    found, sigma = receptors.place[skin.receptors], receptors.sigma[skin.receptors]
    if np.isfinite(found).all(axis=1).sum() < _LEAST_RECEPTORS:
        return None
    # The model has a unit, a frame and a hand of its own: the file is laid on it.
    beside = min(
        (
            compared(found, np.tile(sigma[:, None], (1, 3)), skin.place * hand)
            for hand in ([1.0, 1.0, 1.0], [-1.0, 1.0, 1.0])
        ),
        key=lambda one: float(np.nanmedian(one.off)),
    )
    place = model.place(q, np.zeros(len(q), dtype=int))
    known = np.isfinite(place).all(axis=1)
    _, nearest = cKDTree(beside.places).query(place[known])
    return np.bincount(nearest, minlength=len(skin.names))


def _known_touches(
    run: RunDirectory, *recordings: tuple[np.ndarray, np.ndarray]
) -> tuple[Touches, ...]:
    """Readings and sensations of recordings, with the target sensations of a run."""
    targets = load_representation(run).target_sensations
    return tuple(
        Touches(q, sensation, assign(sensation.astype(np.float32), targets)[0])
        for q, sensation in recordings
    )


def _with_import(run: RunDirectory, skin: Skin, faults: SkinFaults) -> SkinFaults:
    """Adds what the import of a recording found, and took out of the touches."""
    baseline = run.known_baseline()
    if baseline is None or len(baseline.noise) <= int(skin.receptors.max()):
        return faults
    threshold, noise = baseline.threshold[skin.receptors], baseline.noise[skin.receptors]
    level = baseline.offset[skin.receptors]
    spread = float(np.median(np.abs(level - np.median(level))))
    away = np.abs(level - np.median(level)) > _APART * max(spread, 1e-12)
    still = (noise == 0) & (np.median(noise) > 0) & (faults.felt == 0)
    fault, evidence = faults.fault.copy(), list(faults.evidence)
    for n in np.flatnonzero(np.isinf(threshold)).tolist():
        fault[n] = Fault.FLICKERS
        evidence[n] = "a loose contact in the recording: the import set it aside"
    for n in np.flatnonzero(still & np.isfinite(threshold)).tolist():
        fault[n] = Fault.STUCK if away[n] else Fault.DEAD
        evidence[n] = f"its raw reading stands still at {level[n]:.4g}"
    return replace(faults, fault=fault, evidence=tuple(evidence))
