"""A robot's file put right by the touches of a run: what goes in, what comes out."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from selftouch_drake.agent.given_model.refit import SIGNIFICANT, Refit, refitted
from selftouch_drake.agent.given_model.taxels import Compared, compared, doubts, told
from selftouch_drake.agent.given_model.way import Change, GivenWay
from selftouch_drake.agent.given_model.wrong import Verdict, judged_tree
from selftouch_drake.bodies.embodiment import build_world
from selftouch_drake.experiment.receptor_files import ReceptorTable, read_receptors
from selftouch_drake.export.given_model import GivenModelError, read_way
from selftouch_drake.export.urdf_origins import NewOrigin, with_origins
from selftouch_drake.files import write_csv, written_whole
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.receptor_map import read_touches

#: Touches that are read, most that are taken, of which share of the gentlest if there are enough,
#: and fewest of a receptor that is placed.
_READ, _MOST_TOUCHES, _GENTLE, _LEAST_FELT = 20_000, 500, 0.5, 4
#: A receptor feels a touch strongly from this share of the strongest reading on.
_STRONG = 0.5
#: Fewest touches, and receptors.
_LEAST_TOUCHES, _LEAST_RECEPTORS = 30, 3
# 95 % of a normal distribution is within so many standard deviations.
_QUANTILE = 1.96

CHANGE_COLUMNS = ("joint", "number", "change", "95 %", "z", "moved")


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """A robot's file, and what of it touches what.

    Attributes:
        model: the file.
        link: that wears the skin.
        frame: of the ball that touches.
        radius: m, of the ball.
        receptors: the first and the last on the link; None for all.
        taxels: a file with their places on the link; None if nobody knows them.
    """

    model: Path
    link: str
    frame: str
    radius: float = 0.01
    receptors: tuple[int, int] | None = None
    taxels: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corrected:
    """A file's tree beside touches.

    Attributes:
        verdict: whether the tree is wrong.
        refit: from the tree that fits best.
        names: `(S,)` of the receptors that were placed.
        compared: receptors beside their file; None without one.
        taxels_told: what is wrong with that file.
        taxel_doubts: what may be.
    """

    verdict: Verdict
    refit: Refit
    names: Sequence[str]
    compared: Compared | None
    taxels_told: Sequence[str]
    taxel_doubts: Sequence[str]


@dataclass(frozen=True, slots=True, eq=False)
class _Touches:
    """Touches of one skin.

    Attributes:
        q: `(n, J)`.
        sensation: `(n, S)` of the receptors that are placed.
        placed: `(S,)` their numbers on the link.
        names: of all receptors on the link.
    """

    q: np.ndarray
    sensation: np.ndarray
    placed: np.ndarray
    names: Sequence[str]


def corrected(run: RunDirectory, start: Start) -> Corrected:
    """Puts a robot's file right by the touches of a run; nothing is written.

    Raises:
        FileNotFoundError: there is no model.
        ValueError: the run, the model or the receptors' file cannot be used, or nothing like the
            model fits the touches; the text says what to do.
    """
    imported = run.experiment.imported
    joints = list(imported.joints if imported else build_world(run.experiment).robot.joint_names)
    way, columns = read_way(start.model, joints, start.link, start.frame)
    touches = _touches(run.path, start.receptors)
    file = _read_taxels(start.taxels, len(touches.names))
    q = touches.q[:, columns]
    verdict = judged_tree(way, q, touches.sensation)
    if not verdict.fits:
        raise GivenModelError(_nothing_fits(start, verdict))
    try:
        refit = refitted(
            verdict.best.way, q[:, verdict.best.columns], touches.sensation, start.radius
        )
    except np.linalg.LinAlgError:
        raise GivenModelError(
            f"{len(q)} touches of {len(touches.placed)} receptors of {run.path} leave "
            f"{start.model} open; give touches from more postures, all over the skin"
        ) from None
    beside = None if file is None else _beside(refit, touches, file)
    groups = None if file is None or file.group is None else [str(g) for g in file.group]
    return Corrected(
        verdict=verdict,
        refit=refit,
        names=[touches.names[n] for n in touches.placed],
        compared=beside,
        taxels_told=() if beside is None else told(beside, touches.names, groups),
        taxel_doubts=() if beside is None else doubts(beside, touches.names),
    )


def correct_model(run: RunDirectory, start: Start, file: Path | None) -> tuple[list[str], list]:
    """Writes the corrected file and its tables.

    Args:
        run: with touches.
        start: the file to correct.
        file: of the corrected URDF, tables stand beside it; beside the given one by default, and
            in the run if that is no URDF.

    Returns:
        Lines for the user, and rows of `CHANGE_COLUMNS`.
    """
    is_urdf = start.model.suffix == ".urdf"
    # Tables of what is no URDF are kept in the run: nothing is written beside a model of a package.
    folder = start.model.parent if is_urdf else run.path
    out = file or folder / f"{start.model.stem}_refitted.urdf"
    if file is not None and not is_urdf:
        raise ValueError(
            f"--urdf is {file}, but {start.model} is no URDF, and only these are corrected; leave "
            "it out"
        )
    if out.suffix != ".urdf" or out.resolve() == start.model.resolve():
        raise ValueError(f"--urdf is {out}; give another file that ends in .urdf")
    found = corrected(run, start)
    lines = _said(found, start)
    out.parent.mkdir(parents=True, exist_ok=True)
    if is_urdf:
        text = with_origins(start.model.read_bytes(), _new_origins(found))
        with written_whole(out) as aside:
            aside.write_bytes(text)
        lines.append(f"robot: {out}")
    changes, receptors = (out.with_name(f"{out.stem}_{e}.csv") for e in ("changes", "receptors"))
    _write_changes(changes, found.refit)
    _write_receptors(receptors, found)
    lines += [f"changes: {changes}", f"receptors: {receptors}"]
    return lines, [_row(*one) for one in _each(found.refit)]


def _touches(path: Path, receptors: tuple[int, int] | None) -> _Touches:
    q, sensation, names = read_touches(path, _READ, {})
    first, last = receptors or (0, len(names) - 1)
    if not 0 <= first <= last < len(names):
        raise GivenModelError(
            f"--receptors is {first},{last}; give two numbers from 0 to {len(names) - 1}"
        )
    # What others feel, another skin touches.
    sensation, names = sensation[:, first : last + 1], names[first : last + 1]
    felt = np.flatnonzero(sensation.any(axis=1))
    # Gentle touches tell more: harder ones press the skin out of its shape.
    gentle = felt[np.argsort(sensation[felt].sum(axis=1), kind="stable")]
    gentle = np.sort(gentle[: max(int(_GENTLE * len(felt)), _MOST_TOUCHES)])
    rows = gentle[np.linspace(0, len(gentle) - 1, min(_MOST_TOUCHES, len(gentle))).astype(int)]
    q, sensation = q[rows], sensation[rows]
    # Weakly felt receptors lie beyond what was touched.
    strong = sensation > _STRONG * sensation.max(axis=1, keepdims=True, initial=0.0)
    placed = np.flatnonzero(strong.sum(axis=0) >= _LEAST_FELT)
    if len(placed) < _LEAST_RECEPTORS:
        raise GivenModelError(
            f"{path} has {len(placed)} receptors that felt {_LEAST_FELT} touches or more; give a "
            f"run with {_LEAST_RECEPTORS} or more"
        )
    touched = sensation[:, placed].any(axis=1)
    if touched.sum() < _LEAST_TOUCHES:
        raise GivenModelError(
            f"{path} has {touched.sum()} touches of this skin; give a run with {_LEAST_TOUCHES} or "
            "more"
        )
    sensation = sensation[np.ix_(touched, placed)]
    return _Touches(q[touched].astype(float), sensation.astype(float), placed, names)


def _read_taxels(file: Path | None, number: int) -> ReceptorTable | None:
    if file is None:
        return None
    table = read_receptors(str(file))
    if len(table.p_LS) != number:
        raise GivenModelError(
            f"--taxels: {file} has {len(table.p_LS)} receptors, the skin {number}; give a row for "
            "each in the order of the readings, or choose those on the link by --receptors"
        )
    return table


def _beside(refit: Refit, touches: _Touches, file: ReceptorTable) -> Compared:
    found, sigma = np.full((2, len(touches.names), 3), np.nan)
    found[touches.placed], sigma[touches.placed] = refit.places, refit.place_sigma
    return compared(found, sigma, file.p_LS)


def _nothing_fits(start: Start, verdict: Verdict) -> str:
    return (
        f"touches that feel alike lie {np.sqrt(verdict.apart):.0%} of the skin's extent apart by "
        f"{start.model}, and no other axis, sign or exchange of two joints brings them near; check "
        f"--link {start.link}, --frame {start.frame}, --receptors and the units of the recording "
        "(rad, m)"
    )


def _each(refit: Refit) -> list[tuple[Change, float, float]]:
    return list(zip(refit.changes, refit.amounts.tolist(), refit.sigma.tolist(), strict=True))


def _row(change: Change, amount: float, sigma: float) -> list[str]:
    unit, size = ("rad", 1.0) if change.unit == "rad" else ("mm", 1e3)
    digits = 4 if unit == "rad" else 2
    z = amount / sigma
    return [
        change.frame,
        change.text,
        f"{size * amount:+.{digits}f} {unit}",
        f"± {size * _QUANTILE * sigma:.{digits}f}",
        f"{z:+.1f}",
        "yes" if abs(z) > SIGNIFICANT else "no",
    ]


def _said(found: Corrected, start: Start) -> list[str]:
    """Lines for the user: what is wrong, and what touch does not tell."""
    refit, lines = found.refit, []
    if found.verdict.best.text:
        apart = np.sqrt([found.verdict.apart, found.verdict.best_apart])
        lines.append(
            f"wrong: {found.verdict.best.text}; touches that feel alike lie {apart[1]:.0%} of the "
            f"skin's extent apart then, {apart[0]:.0%} by {start.model.name}"
        )
    lines += [f"wrong: {text}" for text in found.taxels_told]
    half = _QUANTILE * np.median(np.linalg.norm(refit.place_sigma, axis=1))
    lines.append(
        f"receptors: {len(found.names)} on {start.link}, ± {1e3 * half:.1f} mm (median, 95 %)"
    )
    if found.compared is not None:
        moved = 1e3 * np.linalg.norm(found.compared.shift), found.compared.turn
        lines.append(
            f"skin: moved by {moved[0]:.1f} mm and {moved[1]:.3f} rad as a whole, receptors "
            f"{1e3 * np.nanmedian(found.compared.off):.1f} mm (median) from {start.taxels}"
        )
    lines += [f"doubt: {text}" for text in found.taxel_doubts]
    if refit.suspect.any():
        names = [found.names[n] for n in np.flatnonzero(refit.suspect).tolist()]
        lines.append(f"suspect, their readings fit no place: {', '.join(names)}")
    offsets = [change.frame for change in refit.untold if change.is_offset]
    if offsets:
        lines.append(
            f"unobservable: the offset of {', '.join(offsets)}, which moves receptors as well; it "
            "stays as it is"
        )
    if not refit.kept.all():
        lines.append(
            f"{(~refit.kept).sum()} numbers that did not move stay as they are in the file"
        )
    if all(change.is_offset for change in refit.changes):
        lines.append("besides offsets, touches ask for no change: all other numbers stay")
    else:
        lines.append(
            "one length, and what else no touch tells beside these numbers, stays as it is in the "
            "file"
        )
    return lines


def _new_origins(found: Corrected) -> dict[str, NewOrigin]:
    """What changes in the file, by joint."""
    way: GivenWay = found.verdict.best.way
    new: dict[str, NewOrigin] = {}
    made = zip(found.refit.changes, found.refit.amounts, found.refit.kept, strict=True)
    for change, amount in [(change, amount) for change, amount, kept in made if kept]:
        before = new.get(change.frame, NewOrigin())
        moved = amount * change.direction
        still = np.zeros(3)
        new[change.frame] = NewOrigin(
            shift=before.shift + (still if change.turns else moved),
            turn=before.turn + (moved if change.turns else still),
        )
    for number in np.flatnonzero(found.verdict.new_axes):
        name = way.names[number]
        before = new.get(name, NewOrigin())
        new[name] = NewOrigin(shift=before.shift, turn=before.turn, axis=way.axes[number])
    return new


def _write_changes(file: Path, refit: Refit) -> None:
    names = ("joint", "number", "unit", "change", "sigma", "z", "told")
    rows = [
        [change.frame, change.text, change.unit, f"{amount:.6g}", f"{sigma:.3g}",
         f"{amount / sigma:.2f}", 1]
        for change, amount, sigma in _each(refit)
    ]  # fmt: skip
    rows += [[change.frame, change.text, change.unit, 0, "", "", 0] for change in refit.untold]
    write_csv(file, names, rows)


def _write_receptors(file: Path, found: Corrected) -> None:
    names = (
        "name",
        "x",
        "y",
        "z",
        "nx",
        "ny",
        "nz",
        "sigma",
        "sigma_x",
        "sigma_y",
        "sigma_z",
        "suspect",
    )
    refit = found.refit
    columns = zip(
        found.names, refit.places, refit.normals, refit.place_sigma, refit.suspect, strict=True
    )
    rows = (
        [name, *(f"{v:.6f}" for v in (*place, *normal, np.linalg.norm(sigma), *sigma)), int(odd)]
        for name, place, normal, sigma, odd in columns
    )
    write_csv(file, names, rows)
