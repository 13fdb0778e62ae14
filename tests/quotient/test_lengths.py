import numpy as np

from selftouch_drake.quotient.lengths import locally_scaled


def test_local_scale_evens_out_crowded_and_sparse_places():
    edges = np.array([[0, 1], [1, 2], [3, 4], [4, 5]])
    place = np.array([0.0, 1.0, 2.0, 10.0, 15.0, 20.0])
    length = place[edges[:, 1]] - place[edges[:, 0]]
    np.testing.assert_allclose(locally_scaled(length, edges), 1.0)
