import numpy as np

from selftouch_drake.show.meshcat.stage import letters


def area(text):
    vertices, faces = letters(text)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    return np.abs(ux * vy - uy * vx).sum() / 2


def test_a_letter_with_a_hole_covers_less_than_its_hull():
    vertices, _ = letters("O")
    width, height = np.ptp(vertices, axis=0)
    assert 0.1 < area("O") / (width * height) < 0.5


def test_lines_are_centred_below_one_another():
    vertices, _ = letters("one line\nand another")
    assert np.abs(vertices[:, 0].min() + vertices[:, 0].max()) < 1e-6
    assert vertices[:, 1].max() < 0.6
    assert vertices[:, 1].min() < -1.5
    assert area("one line\nand another") > area("one line")


def test_empty_text_has_no_letters():
    vertices, faces = letters(" ")
    assert len(vertices) == len(faces) == 0
