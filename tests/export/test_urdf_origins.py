"""Other origins and axes in the text of a URDF: nothing else changes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from selftouch_drake.export.urdf_origins import NewOrigin, with_origins

TEXT = b"""<?xml version="1.0"?>
<robot name="arm">  <!-- <joint name="elbow"><origin xyz="9 9 9"/></joint> -->
  <link name="a"/><link name="b"/><link name="c"/>
  <joint type='revolute'
         name='elbow' >
    <origin rpy = '0 0 1.5707963267948966'   xyz='1 2 3'/>
\t<parent link="a"/><child link="b"/><axis xyz="0 0 1"></axis>
  </joint>
  <joint name="wrist" type="continuous"><parent link="b"/><child link="c"/></joint>
  <transmission name="t"><joint name="elbow"><origin xyz="7 7 7"/></joint></transmission>
  <joint name="a > b" type="fixed"/>
</robot>
"""


def test_nothing_changes_where_nothing_is_asked():
    assert with_origins(TEXT, {"elbow": NewOrigin(), "knee": NewOrigin(shift=np.ones(3))}) == TEXT


def test_a_shift_goes_along_the_axes_of_the_joint():
    found = with_origins(TEXT, {"elbow": NewOrigin(shift=np.array([0.5, 0.0, 0.0]))})
    assert found == TEXT.replace(b"xyz='1 2 3'", b"xyz='1 2.5 3'")


def test_a_turn_is_behind_that_of_the_file():
    turn = np.array([0.1, -0.2, 0.3])
    found = with_origins(TEXT, {"elbow": NewOrigin(turn=turn)})
    start = found.index(b"rpy = '") + len(b"rpy = '")
    rpy = [float(part) for part in found[start : found.index(b"'", start)].split()]
    wanted = Rotation.from_euler("xyz", [0, 0, np.pi / 2]) * Rotation.from_rotvec(turn)
    np.testing.assert_allclose(
        Rotation.from_euler("xyz", rpy).as_matrix(), wanted.as_matrix(), atol=1e-8
    )
    assert b"xyz='1 2 3'" in found
    assert found.count(b"\n") == TEXT.count(b"\n")


@pytest.mark.parametrize("name", ["elbow", "wrist"])
def test_an_axis_is_replaced_or_added(name):
    found = with_origins(TEXT, {name: NewOrigin(axis=np.array([0.0, -1.0, -0.0]))})
    if name == "elbow":
        assert found == TEXT.replace(b'<axis xyz="0 0 1">', b'<axis xyz="0 -1 0">')
    else:
        added = b'<joint name="wrist" type="continuous">\n    <axis xyz="0 -1 0"/><parent'
        assert found == TEXT.replace(b'<joint name="wrist" type="continuous"><parent', added)


def test_an_origin_that_was_left_out_is_added():
    found = with_origins(TEXT, {"wrist": NewOrigin(shift=np.array([0.0, 0.0, 0.25]))})
    assert b'type="continuous">\n    <origin xyz="0 0 0.25"/><parent link="b"/>' in found
