import dataclasses

import numpy as np
import pytest

from selftouch_drake.agent.representation.embedded import EmbeddedRepresentation, embedded


@pytest.fixture
def places(representation):
    return np.arange(3.0 * representation.num_targets).reshape(-1, 3)


def test_what_was_learned_is_the_same_with_places_beside_it(representation, places):
    found = embedded(representation, places)
    for field in dataclasses.fields(representation):
        assert getattr(found, field.name) is getattr(representation, field.name)
    assert found.embedding is places


def test_files_keep_the_places(representation, places):
    arrays = embedded(representation, places).to_arrays()
    assert set(arrays) == {*representation.to_arrays(), "embedding"}
    np.testing.assert_array_equal(EmbeddedRepresentation.from_arrays(arrays).embedding, places)
    with pytest.raises(ValueError, match=r"^embedding is missing$"):
        EmbeddedRepresentation.from_arrays(representation.to_arrays())


def test_some_kernels_keep_their_places(representation, places):
    some = np.array([3, 7, 50])
    np.testing.assert_array_equal(
        embedded(representation, places).restricted(some).embedding, places[some]
    )


def test_other_places_are_refused(representation):
    message = r"^embedding has shape \(5, 3\), expected \(120, 3\)$"
    with pytest.raises(ValueError, match=message):
        embedded(representation, np.zeros((5, 3)))
