"""Receptors from files: where they are, and what is said about mistakes."""

import time

import numpy as np
import pytest
import yaml
from commands import selftouch

from selftouch_drake.experiment import load_experiment
from selftouch_drake.experiment.schema import ReceptorFile
from selftouch_drake.geometry.receptors import placed_fields
from selftouch_drake.geometry.surfaces import ellipsoid, sphere
from selftouch_drake.robot import World
from selftouch_drake.robot.skins import InwardNormalsWarning, make_skins

RADIUS = 0.25


def on_sphere(number, radius=RADIUS):
    """`(number, 3)` m, points spread evenly by the golden angle."""
    z = 1 - (2 * np.arange(number) + 1) / number
    turn = np.pi * (3 - 5**0.5) * np.arange(number)
    return radius * np.stack([*(np.sqrt(1 - z**2) * [np.cos(turn), np.sin(turn)]), z], axis=1)


def saved(path, p, **columns):
    """The path of a file with places `(S, 3)` and further columns."""
    if path.suffix == ".npz":
        np.savez(path, positions=p, **columns)
    elif path.suffix == ".pcd":
        names = "x y z normal_x normal_y normal_z"
        rows = np.hstack([p, p]).astype(np.float32)
        head = f"VERSION 0.7\nFIELDS {names}\nSIZE{' 4' * 6}\nTYPE{' F' * 6}\nPOINTS {len(p)}\n"
        path.write_bytes(f"{head}DATA binary\n".encode() + rows.tobytes())
    elif path.suffix == ".txt":
        zeros = "0 0 0 0 0 0\n"
        lines = "".join(f"{x} {y} {z} 1 0 0\n{zeros}" for x, y, z in p)
        path.write_text(f"name skin\n[calibration]\n{zeros}{lines}")
    else:
        rows = zip(*p.T, *columns.values(), strict=True)
        lines = [",".join(map(str, row)) for row in [("x", "y", "z", *columns), *rows]]
        path.write_text("# made by a test\n" + "\n".join(lines) + "\n")
    return str(path)


def of(receptors, **fields):
    skin = {"surface": {"shape": "sphere", "radius": RADIUS, "resolution": 0.06}}
    return {"skins": {"body": skin | {"receptors": receptors} | fields}}


def mistake(tmp_path, receptors, **fields):
    """The one line on stderr of a command that must refuse this file."""
    overrides = yaml.safe_dump(of(receptors, **fields))
    # The shipped sphere says how many receptors it has.
    text = "robot: {directives: package://selftouch_drake/arm_on_body.dmd.yaml}\n"
    text += "touching: {finger: {frame: fingertip, radius: 0.01}}\n"
    text += "skins: {body: {link: body, surface: {shape: sphere, radius: 0.25}}}\n"
    (tmp_path / "mine.yaml").write_text(text)
    done = selftouch("robot", tmp_path / "mine.yaml", "--set", overrides)
    assert (done.status, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    return line.replace(str(tmp_path), "HERE")


@pytest.mark.filterwarnings("ignore::selftouch_drake.robot.skins.MovedReceptorsWarning")
@pytest.mark.parametrize("suffix", [".csv", ".txt", ".npz", ".pcd"])
def test_receptors_lie_where_each_kind_of_file_says(tmp_path, suffix):
    p = on_sphere(60)
    overrides = of(saved(tmp_path / f"taxels{suffix}", p), num_receptors=60)
    (skin,) = make_skins(load_experiment("sphere", overrides))
    assert skin.fields.num_receptors == 60
    # Half an edge of the fine triangles is 6 mm; the triangles lie up to 3 mm below the sphere.
    assert np.linalg.norm(skin.fields.p_LS - p, axis=1).max() < 0.012
    # Every receptor feels most of a force at its own place.
    assert (skin.fields.weights_at(p).toarray().argmax(axis=1) == np.arange(60)).all()


def test_a_file_has_its_number_its_unit_and_its_widths(tmp_path):
    p = on_sphere(80)
    width = np.where(p[:, 2] > 0, 60, 120)
    file = saved(tmp_path / "taxels.csv", 1e3 * p, width=width)
    experiment = load_experiment("sphere", of({"file": file, "scale": 0.001}, num_receptors=80))
    with pytest.warns(UserWarning, match="80 receptors were moved onto the surface, by"):
        (skin,) = make_skins(experiment)
    weights = skin.fields.vertex_weights
    area = np.asarray((weights > 0).sum(axis=0)).ravel() / weights.shape[0]
    # Of a sphere, a cap of radius r along the surface covers (1 - cos(r / R)) / 2.
    expected = (1 - np.cos(width / 1e3 / RADIUS)) / 2
    np.testing.assert_allclose(area / expected, 1, atol=0.35)
    assert abs((area / expected).mean() - 1) < 0.05
    # Where fields overlap they share a force, and where there are gaps it is felt in part.
    total = np.asarray(weights.sum(axis=1)).ravel()
    assert total.max() <= 1 + 1e-12
    assert total.min() < 0.1


def test_normals_say_on_which_side_of_a_thin_link_a_receptor_lies():
    plate = ellipsoid([0.1, 0.1, 0.01], resolution=0.01)
    p = np.array([[x, y, -0.001] for x in (-0.03, 0.03) for y in (-0.03, 0.03)])
    below, _ = placed_fields(plate, p)
    above, moved = placed_fields(plate, p, normal=np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert (below.p_LS[:, 2] < 0).all()
    assert (above.p_LS[:, 2] > 0).all()
    assert ((moved > 0.007) & (moved < 0.013)).all()


@pytest.mark.filterwarnings("ignore::selftouch_drake.robot.skins.MovedReceptorsWarning")
def test_normals_of_a_whole_skin_that_point_inwards_are_turned(tmp_path):
    p = on_sphere(40)
    n = p / RADIUS

    def skin(name, normals):
        file = saved(tmp_path / f"{name}.npz", p, normals=normals)
        return make_skins(load_experiment("sphere", of(file)))[0].fields.p_LS

    right = skin("outward", n)
    with pytest.warns(InwardNormalsWarning, match="point into the link, and were turned"):
        np.testing.assert_array_equal(skin("inward", -n), right)
    mixed = np.where(np.arange(40)[:, None] % 8 == 0, -n, n)
    with pytest.warns(InwardNormalsWarning, match="5 of 40 normals point into the link"):
        skin("mixed", mixed)


def test_four_thousand_receptors_take_seconds():
    fields, _ = placed_fields(sphere(RADIUS, resolution=0.03), on_sphere(4000))
    # Each feels a few spacings around, not everything.
    assert fields.vertex_weights.nnz < 0.005 * np.prod(fields.vertex_weights.shape)
    assert np.asarray(fields.vertex_weights.sum(axis=1)).min() > 0.9


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::selftouch_drake.robot.skins.MovedReceptorsWarning")
def test_a_touch_of_many_receptors_costs_at_most_twice_as_much(tmp_path):
    """CPU time of touches with 200 and with 1,500 receptors, in turn; measured 1.33 times."""
    worlds = []
    for number in (200, 1500):
        file = saved(tmp_path / f"{number}.npz", on_sphere(number))
        worlds.append(World(load_experiment("sphere", of(file, num_receptors=number))))
    robot = worlds[0].robot
    q = np.random.default_rng(0).uniform(*robot.babbled_range, (20_000, robot.num_joints))
    took = {0: [], 1: []}
    for turn in range(4):
        for number, world in enumerate(worlds):
            began = time.process_time()
            for part in np.split(q, 10):
                world.probe.felt_rows(part)
            took[number] += [time.process_time() - began] * (turn > 0)
    assert np.median(took[1]) < 2 * np.median(took[0])


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.csv", "x,y\n1,2\n", "has no column z, but x, y; name them x, y, z"),
        ("a.csv", "1,2\n1,2\n", "has no column x, y, z, but none; name them x, y, z"),
        ("a.csv", "x,y,z\n1,2\n", "has 2 columns in row 2, but 3 names"),
        ("a.csv", "x,y,z\n1,2,four\n", "could not convert string to float: 'four'"),
        ("a.txt", "1 2 3\n1 2 4\n1 2 nan\n", "has a place that is not finite in row 3; correct it"),
        ("a.txt", "1 2 3\n1 2 4\n", "has 2 receptors; give at least 4"),
        (
            "a.csv",
            "x,y,z,name\n1,2,3,a\n1,2,4,b\n1,2,3,c\n2,2,2,d\n",
            "has row 2 (a), 4 (c) at one place; leave one of them out",
        ),
        ("a.xyz", "", "has none of the endings .csv, .txt, .npz, .pcd; give one of these"),
        ("a.npz", "text", "is no archive of arrays; save it by numpy.savez"),
        ("a.pcd", "text", "has no entry 'FIELDS'; save it anew"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_one_line(tmp_path, name, content, says):
    (tmp_path / name).write_text(content)
    line = mistake(tmp_path, str(tmp_path / name))
    assert line == f"selftouch: skins.body.receptors HERE/{name} {says}"


#: As `selftouch model` writes it, and with the columns that `selftouch map` has.
TAXELS = "name,part,x,y,z\n" + "".join(
    f"t{n},{part},{x},{y},{z}\n" for n, (x, y, z) in enumerate(on_sphere(24)) for part in [n % 2]
).replace("t7,1", "t7,").replace("t5,1", "t5,")
MAP = TAXELS.replace("name,part", "receptor,part")


@pytest.mark.parametrize("text", [TAXELS, MAP])
def test_a_table_of_taxels_has_parts_and_receptors_that_were_never_met(tmp_path, text):
    file = tmp_path / "taxels.csv"
    file.write_text(text)
    first, second = (ReceptorFile(file=str(file), part=part).read() for part in (0, 1))
    np.testing.assert_allclose(first.p_LS, on_sphere(24)[::2])
    met = [n for n in range(1, 24, 2) if n not in (5, 7)]
    np.testing.assert_allclose(second.p_LS, on_sphere(24)[met])
    assert second.those([0, 2]) == "row 3 (t1), 11 (t9)"  # rows as in the file
    alone = tmp_path / "alone.csv"
    alone.write_text("\n".join(line for line in text.splitlines() if ",0," not in line))
    np.testing.assert_allclose(ReceptorFile(file=str(alone)).read().p_LS, second.p_LS)


def test_a_part_that_is_not_in_the_table_is_refused(tmp_path):
    file = tmp_path / "taxels.csv"
    file.write_text(TAXELS)
    for given, says in [
        ({}, "has receptors of parts 0, 1; give one of them as part"),
        ({"part": 2}, "has no receptors of part 2, but of 0, 1"),
    ]:
        line = mistake(tmp_path, {"file": str(file)} | given)
        assert line == f"selftouch: skins.body.receptors HERE/taxels.csv {says}"
    plain = saved(tmp_path / "plain.csv", on_sphere(9))
    line = mistake(tmp_path, {"file": plain, "part": 0})
    assert line.endswith("plain.csv has no column part, but part is 0; leave it out")


def test_a_file_that_is_not_there_is_named(tmp_path):
    line = mistake(tmp_path, "nothing.csv")
    assert line.endswith("nothing.csv cannot be read: No such file or directory")


def test_receptors_off_the_surface_are_named(tmp_path):
    p = on_sphere(60)
    p[[7, 9]] *= 2
    line = mistake(tmp_path, saved(tmp_path / "a.csv", p))
    assert line.startswith(
        "selftouch: skins.body.receptors HERE/a.csv has 2 of 60 receptors off the surface by more "
        "than their fields reach, "
    )
    assert "mm: row 10, 12, by up to 25" in line


def test_millimetres_are_suspected(tmp_path):
    line = mistake(tmp_path, saved(tmp_path / "a.csv", 1e3 * on_sphere(60)))
    assert line.endswith("Are these millimetres? Then give skins.body.receptors.scale: 0.001")


def test_another_number_than_the_file_has_is_refused(tmp_path):
    line = mistake(tmp_path, saved(tmp_path / "a.npz", on_sphere(60)), num_receptors=50)
    assert line == (
        "selftouch: skins.body.num_receptors is 50; HERE/a.npz has 60: leave num_receptors out"
    )


def test_receptors_of_another_link_are_recognised(tmp_path):
    """Receptors around the centre of an infant's head, given to its torso."""
    file = saved(tmp_path / "head.csv", on_sphere(400, 0.08))
    skins = {"torso": {"receptors": file, "num_receptors": 400}}
    done = selftouch("robot", "infant", "--set", yaml.safe_dump({"skins": skins}))
    assert done.status == 2
    assert "nearer to skins.head: give them to that skin" in done.stderr


def test_a_shape_of_receptors_needs_them(tmp_path):
    done = selftouch("robot", "sphere", "--set", "{skins: {body: {surface: receptors}}}")
    assert done.status == 2
    assert done.stderr == (
        "selftouch: skins.body.surface.shape is 'receptors'; give receptors a file, or another "
        "shape\n"
    )
