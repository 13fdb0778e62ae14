"""Recordings transformed at random: what must not matter gives the same experience, and what must
matter is refused or said in the summary. None is silent.
"""

import gzip
import json
import re

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.feather
import pytest
from known_recording import NUM_JOINTS, NUM_RECEPTORS, RATE_HZ, SMALL, Good, said
from scipy.io import savemat

from selftouch_drake.experience.recording_error import RecordingError
from selftouch_drake.run.imported import imported_experiment, read_data

NUM_ROWS = 800
#: No seed was used while the reader was written.
SEEDS = range(73_000, 73_080)
START_NS = 1_764_000_000_000_000_000


@pytest.fixture(scope="module")
def good():
    return Good(NUM_ROWS)


@pytest.fixture(scope="module")
def known(good, tmp_path_factory):
    """The experience of the recording as it is, and its limits of plans."""
    path = tmp_path_factory.mktemp("good") / "a.csv"
    good.table().to_csv(path, index=False)
    data = read_data(path)
    return data, np.array(imported_experiment(data, overrides=SMALL).imported.max_velocity)


# What must not matter.


def a_time(rng, good):
    """A name and a column of times in some unit, from zero, from somewhere, or since 1970."""
    unit = str(rng.choice(["s", "ms", "us", "ns", "date", "epoch"]))
    if unit == "date":
        start = np.datetime64("2026-03-29T01:59:55")
        return "timestamp", start + (1e6 * good.time_s).round().astype("timedelta64[us]")
    if unit == "epoch":
        counts = START_NS + (1e9 * good.time_s).round().astype(np.int64)
        return str(rng.choice(["t", "stamp"])), counts // int(rng.choice([1, 1000, 10**6]))
    scale = {"s": 1, "ms": 1e3, "us": 1e6, "ns": 1e9}[unit]
    name = str(rng.choice(["time_{}", "time [{}]", "Timestamp ({})", "stamp.{}"])).format(unit)
    return name, ((good.time_s + rng.integers(0, 5000)) * scale).round(3)


def a_table(rng, good):
    """The recording as a table whose names, order, units and types are drawn."""
    degrees = rng.random() < 0.4
    q = np.rad2deg(good.q) if degrees else good.q
    force = good.force.astype(np.float32) if rng.random() < 0.5 else good.force
    name, times = a_time(rng, good)
    joint = str(rng.choice(["q_{}", "joint_{}", "Q[{}]", "joint_{}_pos", "q {}", "JOINT.{}"]))
    if degrees:
        joint += str(rng.choice([" [deg]", "_deg", " (°)"]))
    skin = str(rng.choice(["taxel_{}", "Touch {}", "tactile[{}]", "skin.{}", "taxels_{} [kPa]"]))
    start = int(rng.integers(0, 2))
    columns = {name: times}
    columns |= {joint.format(n + start): q[:, n] for n in range(NUM_JOINTS)}
    columns |= {skin.format(n + start): force[:, n] for n in range(NUM_RECEPTORS)}
    for extra in ("q_vel_0", "motor_temp_1", "note", "cmd"):
        if rng.random() < 0.3:
            columns[extra] = ["warm"] * NUM_ROWS if extra == "note" else rng.normal(size=NUM_ROWS)
    table = pd.DataFrame(columns)
    if rng.random() < 0.5:
        table = table[rng.permutation(table.columns)]
    return table.iloc[rng.permutation(NUM_ROWS)] if rng.random() < 0.3 else table


def as_text(rng, table, folder):
    """Delimiter, decimals, header, ends of lines, and packing are drawn."""
    sep = str(rng.choice([",", ";", "\t", "|"]))
    decimal = "," if sep in ";\t" and rng.random() < 0.5 else "."
    lines = table.to_csv(index=False, sep=sep, decimal=decimal).splitlines()
    if rng.random() < 0.3:
        lines[0] = f"# {lines[0]}"
    if rng.random() < 0.3:
        lines = ["% of the left arm", "", *lines]
    if rng.random() < 0.3:
        lines = [line + sep for line in lines]
    content = (
        str(rng.choice(["\n", "\r\n"]))
        .join([*lines, ""])
        .encode(str(rng.choice(["utf-8", "utf-8-sig", "utf-16"])))
    )
    ending = str(rng.choice([".csv", ".tsv", ".txt", ".csv.gz"]))
    path = folder / f"a{ending}"
    path.write_bytes(gzip.compress(content) if ending.endswith("gz") else content)
    return path


def as_columns(rng, table, folder):
    path = folder / "a.parquet"
    if rng.random() < 0.5:
        table.to_parquet(path, index=False)
        return path
    compression = str(rng.choice(["zstd", "uncompressed"]))
    path = folder / "a.arrow"
    pyarrow.feather.write_feather(pa.Table.from_pandas(table), path, compression=compression)
    return path


def as_arrays(rng, good, folder):
    """Archives of arrays: their names, groups, axes and types are drawn."""
    kind = str(rng.choice(["npz", "npy", "mat", "h5", "h5 of groups"]))
    name, times = a_time(rng, good)
    if kind.startswith(("mat", "h5")) and times.dtype.kind == "M":
        name, times = "time_s", good.time_s
    names = str(rng.choice(["q", "joint_positions", "qpos"])), str(rng.choice(["touch", "taxels"]))
    name = name if name.isidentifier() else "time_s"
    times = times if name != "time_s" else good.time_s
    arrays = {names[0]: good.q, names[1]: good.force.astype(rng.choice([np.float32, float]))}
    if rng.random() < 0.3 and kind != "npy":
        arrays = {key: array.T for key, array in arrays.items()}
    arrays[name] = times
    if kind == "npy":
        for key, array in arrays.items():
            np.save(folder / f"{key}.npy", array)
        return folder
    path = folder / f"a.{kind.split()[0]}"
    if kind == "npz":
        np.savez(path, **arrays)
    elif kind == "mat":
        savemat(path, {"log": arrays} if rng.random() < 0.5 else arrays)
    else:
        with h5py.File(path, "w") as file:
            for key, array in arrays.items():
                file[f"obs/{key}" if "groups" in kind else key] = array
    return path


def in_pieces(rng, table, folder):
    """Several files one after another, of equal kinds, or joints beside skin."""
    if rng.random() < 0.5:
        cuts = np.sort(rng.choice(np.arange(200, NUM_ROWS - 200), 2, replace=False))
        for number, part in enumerate(np.split(np.arange(NUM_ROWS), cuts)):
            table.iloc[part].to_csv(folder / f"part{number + 8}.csv", index=False)
        return folder
    is_skin = table.columns.str.contains("taxel|touch|tactile|skin", case=False)
    is_joint = table.columns.str.contains(r"^(?:q|joint)(?!.*vel)", case=False)
    table.loc[:, ~is_skin].to_csv(folder / "arm.csv", index=False)
    table.loc[:, ~is_joint].to_csv(folder / "board.csv", index=False)
    return folder


def as_lerobot(rng, good, folder):
    (folder / "meta").mkdir()
    (folder / "data").mkdir()
    names = [f"j{n}.pos" for n in range(NUM_JOINTS)]
    given = names if rng.random() < 0.5 else {"motors": names}
    info = {"features": {"observation.state": {"names": given}}, "fps": 50}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    table = pd.DataFrame({"observation.state": list(good.q), "observation.touch": list(good.force)})
    table["timestamp"], table["episode_index"] = good.time_s, 0
    table.to_parquet(folder / "data" / "file-000.parquet")
    return folder


FORMS = ("text", "text", "text", "columns", "arrays", "arrays", "pieces", "lerobot")


@pytest.mark.parametrize("seed", SEEDS)
def test_what_must_not_matter_gives_the_same_experience(seed, good, known, tmp_path):
    rng = np.random.default_rng(seed)
    form = str(rng.choice(FORMS))
    if form in ("arrays", "lerobot"):
        path = (as_arrays if form == "arrays" else as_lerobot)(rng, good, tmp_path)
    else:
        table = a_table(rng, good)
        write = {"text": as_text, "columns": as_columns, "pieces": in_pieces}[form]
        if form == "pieces":
            table = table.sort_index()
        path = write(rng, table, tmp_path)
    data, (expected, limits) = read_data(path), known
    np.testing.assert_allclose(data.felt.q, expected.felt.q, atol=1e-4)
    np.testing.assert_allclose(data.felt.sensation, expected.felt.sensation, rtol=1e-5, atol=1e-4)
    found = imported_experiment(data, overrides=SMALL).imported.max_velocity
    np.testing.assert_allclose(found, limits, rtol=0.05)
    text = said(data)
    assert f"rows: {NUM_ROWS}, of which 0 are incomplete" in text
    for word in ("left out", "odd:", "set aside"):
        assert word not in text


# What must matter. Each harm returns a table or arrays, and what must be said of it.


def without_a_joint(rng, good):
    table = good.table().drop(columns=f"q_{rng.integers(1, NUM_JOINTS - 1)}")
    return table, r"joints are numbered up to 3, and 1 \(\d\) of these numbers are missing"


def without_receptors(rng, good):
    gone = rng.choice(np.arange(1, NUM_RECEPTORS - 1), rng.integers(2, 15), replace=False)
    table = good.table().drop(columns=[f"taxel_{n}" for n in gone])
    return table, rf"numbered up to 39, and {len(gone)} \("


def without_the_first_half_of_the_skin(rng, good):
    half = int(rng.integers(15, 25))
    table = good.table().drop(columns=[f"taxel_{n}" for n in range(half)])
    return table, rf"receptors are numbered up to 39, and {half - 1} \("


def without_the_skin(rng, good):
    table = good.table().iloc[:, : 1 + NUM_JOINTS]
    return table, "no column with a usual name for --sensation"


def half_of_the_skin_dead(rng, good):
    force = good.force.copy()
    force[:, : NUM_RECEPTORS // 2] = rng.choice([0.0, 3.5])
    return good.table(force=force), "receptors that never read anything: 20"


def half_of_the_skin_dead_from_some_time_on(rng, good):
    force = good.force.copy()
    # Touches come from anywhere at any time.
    order = rng.permutation(NUM_ROWS)
    force, q = force[order], good.q[order]
    first = int(rng.integers(300, 500))
    force[first:, NUM_RECEPTORS // 2 :] = 0.0
    arrays = {"q": q, "touch": force}
    return arrays, r"feel nothing in the last \d0 % of the touches"


def a_block_of_nan(rng, good):
    table = good.table()
    first = int(rng.integers(0, 500))
    columns = rng.choice(table.columns[1:], rng.integers(1, 10), replace=False)
    table.loc[first : first + 99, columns] = np.nan
    return table, "rows: 800, of which 100 are incomplete"


def a_receptor_without_numbers(rng, good):
    table = good.table()
    table[f"taxel_{rng.integers(0, 40)}"] = np.nan
    return table, r"1 receptors \(taxel_\d+\) hold no number, and count as dead"


def a_joint_without_numbers(rng, good):
    table = good.table()
    table[f"q_{rng.integers(0, 4)}"] = np.nan
    return table, r"joint q_\d of .* holds no number; leave it out by --q"


def a_line_cut_off(rng, good):
    text = good.table().to_csv(index=False)
    end = text.rindex("\n", 0, -1)
    cut = text[: end + int(rng.integers(20, 60))]
    return cut, "rows: 800, of which 1 are incomplete"


def a_file_cut_off(rng, good):
    return f"{rng.choice(['npz', 'parquet', 'h5'])}", "is damaged"


def another_robot(rng, good):
    other = good.table(q=good.q[:, :3] if rng.random() < 0.5 else np.hstack([good.q] * 2))
    return [good.table(), other], r"part1.csv has \d joints, but .*part0.csv has 4"


def another_skin(rng, good):
    num = int(rng.integers(10, 39))
    other = good.table(force=good.force[:, :num])
    return [good.table(), other], rf"part1.csv has {num} receptors, but"


def a_second_file_without_a_header(rng, good):
    return [good.table(), None], "has no column with a usual name for --q"


def the_same_rows_twice(rng, good):
    table = pd.concat([good.table()] * 2).sort_values("time_s", kind="stable")
    return table, "800 rows have the time of the row before"


def a_unit_that_nobody_states(rng, good):
    return good.table(
        time=np.arange(NUM_ROWS) + rng.integers(0, 99)
    ), "in an unknown unit: give --time-unit"


def a_zero_that_is_set_anew(rng, good):
    q, joint = good.q.copy(), int(rng.integers(0, 3))
    q[int(rng.integers(100, 700)) :, joint] += 1.0
    return good.table(q=q), f"joint q_{joint} jumps by .* was its zero set anew"


def a_quaternion_among_the_joints(rng, good):
    four = good.q[:, :4] + rng.normal(size=4)
    base = four / np.linalg.norm(four, axis=1, keepdims=True)
    return {"qpos": np.hstack([good.q, base]), "touch": good.force}, r"\[4\] to .*are a quaternion"


def cosines_and_sines(rng, good):
    angles = good.q[:, :2] * rng.uniform(1, 2)
    arrays = {"q": np.hstack([np.cos(angles), np.sin(angles)]), "touch": good.force}
    return arrays, r"q\[0\] and q\[2\] are cosine and sine of one angle"


def rows_that_fill_up_the_file(rng, good):
    rows = np.minimum(np.arange(NUM_ROWS + 100), NUM_ROWS - 1)
    arrays = {"q": good.q[rows], "touch": good.force[rows]}
    return arrays, "100 rows repeat the row before in every number"


def a_time_that_is_a_thousand_times_too_fast(rng, good):
    return good.table(time_s=good.time_s / 1000), "joints cross their range in .* --time-unit"


def a_clock_that_begins_again(rng, good):
    time_s = good.time_s.copy()
    first = int(rng.integers(200, 600))
    time_s[first:] -= time_s[first]
    return good.table(time_s=time_s), "the clock starts again 1 times"


def a_gap(rng, good):
    time_s = good.time_s + np.where(np.arange(NUM_ROWS) < rng.integers(100, 700), 0, 60)
    return good.table(time_s=time_s), "1 gaps; 2 pieces"


def a_clock_that_changes_its_unit(rng, good):
    time_s = good.time_s.copy()
    time_s[int(rng.integers(300, 500)) :] *= 1000
    return good.table(time_s=time_s), "unknown unit|gaps|odd: at their fastest"


def no_order_and_no_time(rng, good):
    order = rng.permutation(NUM_ROWS)
    return {"q": good.q[order], "touch": good.force[order]}, "the joints jump from row to row"


def degrees_that_nobody_states(rng, good):
    return good.table(q=np.rad2deg(good.q)), "as degrees do"


def one_joint_in_degrees(rng, good):
    q, joint = good.q.copy(), int(rng.integers(0, 3))
    q[:, joint] = np.rad2deg(q[:, joint])
    return good.table(q=q), rf"1 \(q_{joint}\) reach .* as degrees do"


def joints_without_decimals(rng, good):
    return good.table(q=good.q.round()), "positions: were decimals cut off"


def a_joint_twice(rng, good):
    return good.table(q=good.q[:, [0, 1, 2, 1]]), "joint q_3 repeats q_1"


def a_joint_that_stands_still(rng, good):
    q = good.q.copy()
    q[:, 2] = rng.normal()
    return good.table(q=q), r"joints that never move: 1 \(q_2\)"


def a_joint_that_wraps(rng, good):
    q = good.q.copy()
    q[:, 0] = (q[:, 0] * 3 + rng.uniform(2.2, 4) + np.pi) % (2 * np.pi) - np.pi
    return good.table(q=q), r"q_0\) begin again after a turn"


def velocities_among_the_joints(rng, good):
    state = np.hstack([good.q, np.gradient(good.q, axis=0) * RATE_HZ])
    return {"state": state, "touch": good.force}, "4 velocities, or efforts, of the other joints"


def joints_and_skin_exchanged(rng, good):
    return {
        "q": good.force,
        "touch": good.q,
    }, "are --q and --sensation exchanged|nothing is felt in 799 rows"


def lost_packets(rng, good):
    force = good.force.copy()
    rows = rng.choice(NUM_ROWS, 8, replace=False)
    force[rows] = 255.0
    return good.table(force=force), "left out: 8 rows"


def a_receptor_that_counts(rng, good):
    force = good.force.copy()
    force[:, 7] = np.arange(NUM_ROWS)
    return good.table(force=force), r"set aside: 1 \(taxel_7\)|never read anything: 1 \(taxel_7\)"


def a_saturated_skin(rng, good):
    force = np.minimum(good.force, np.quantile(good.force[good.force > 0], 0.5))
    return good.table(force=force), "as if saturated"


def words_among_numbers(rng, good):
    table = good.table().astype(object)
    rows = rng.choice(NUM_ROWS, 3, replace=False)
    table.loc[rows, "q_1"] = "ERR"
    return table, "of which 3 are incomplete"


def columns_of_one_name(rng, good):
    lines = good.table().to_csv(index=False).splitlines()
    text = "\n".join(f"{line},{n % 9 if n else 'taxel_3'}" for n, line in enumerate(lines))
    return text, "several columns taxel_3 that differ"


def infinite_readings(rng, good):
    force = good.force.copy()
    force[rng.choice(NUM_ROWS, 12, replace=False), 3] = np.inf
    return {"q": good.q, "touch": force, "t": good.time_s}, "of which 12 are incomplete"


def another_number_of_rows(rng, good):
    cut = int(rng.integers(1, 400))
    return {"q": good.q, "touch": good.force[cut:]}, "has 800 rows of q and"


def a_pose_for_joints(rng, good):
    table = good.table().rename(columns={"q_0": "x", "q_1": "y", "q_2": "z", "q_3": "grip"})
    table.attrs["options"] = {"q": "x,y,z,grip"}
    return table, r"3 \(x, y, z\) are places by their names"


def commands_for_joints(rng, good):
    table = good.table().rename(columns=lambda name: name.replace("q_", "q_target_"))
    table.attrs["options"] = {"q": "q_*"}
    return table, "takes q_target_0 too, which by its name is no joint position"


HARMS = (
    *(without_a_joint, without_receptors, without_the_first_half_of_the_skin, without_the_skin),
    *(half_of_the_skin_dead, half_of_the_skin_dead_from_some_time_on, a_block_of_nan),
    *(
        a_receptor_without_numbers,
        a_joint_without_numbers,
        a_line_cut_off,
        a_file_cut_off,
        another_robot,
        another_skin,
    ),
    *(a_second_file_without_a_header, the_same_rows_twice, a_unit_that_nobody_states),
    *(a_zero_that_is_set_anew, rows_that_fill_up_the_file),
    *(a_quaternion_among_the_joints, cosines_and_sines),
    *(a_time_that_is_a_thousand_times_too_fast, a_clock_that_begins_again, a_gap),
    *(a_clock_that_changes_its_unit, no_order_and_no_time, degrees_that_nobody_states),
    *(one_joint_in_degrees, joints_without_decimals, a_joint_twice, a_joint_that_stands_still),
    *(a_joint_that_wraps, velocities_among_the_joints, joints_and_skin_exchanged, lost_packets),
    *(a_receptor_that_counts, a_saturated_skin, words_among_numbers, columns_of_one_name),
    *(infinite_readings, another_number_of_rows, a_pose_for_joints, commands_for_joints),
)


def written(harmed, good, folder):
    """Where the harmed recording is, and the options with which it is read."""
    if isinstance(harmed, list):
        for number, table in enumerate(harmed):
            header = table is not None
            table = good.table() if table is None else table
            table.to_csv(folder / f"part{number}.csv", index=False, header=header)
        return folder, {}
    if isinstance(harmed, dict):
        np.savez(folder / "a.npz", **harmed)
        return folder / "a.npz", {}
    if isinstance(harmed, pd.DataFrame):
        harmed.to_csv(folder / "a.csv", index=False)
        return folder / "a.csv", harmed.attrs.get("options", {})
    if harmed in ("npz", "parquet", "h5"):
        path = folder / f"a.{harmed}"
        if harmed == "npz":
            np.savez(path, q=good.q, touch=good.force)
        elif harmed == "parquet":
            good.table().to_parquet(path)
        else:
            with h5py.File(path, "w") as file:
                file["q"], file["touch"] = good.q, good.force
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
        return path, {}
    (folder / "a.csv").write_text(harmed)
    return folder / "a.csv", {}


@pytest.mark.parametrize("seed", SEEDS[:1])
@pytest.mark.parametrize("harm", HARMS, ids=lambda harm: harm.__name__)
def test_what_must_matter_is_refused_or_said(harm, seed, good, tmp_path):
    harmed, expected = harm(np.random.default_rng(seed), good)
    path, options = written(harmed, good, tmp_path)
    try:
        text = said(read_data(path, **options))
    except (RecordingError, ValueError) as error:
        text = str(error)
    assert re.search(expected, text), text
