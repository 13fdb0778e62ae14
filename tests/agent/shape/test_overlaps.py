import numpy as np
import pytest
from bodies_by_hand import shape_error, sphere

from selftouch_drake.agent.representation.learning import learn
from selftouch_drake.agent.representation.touches import expected_readings, receptors_together
from selftouch_drake.agent.shape.overlaps import overlap_lengths
from selftouch_drake.agent.shape.recovery import recover

pytestmark = pytest.mark.usefixtures("module_without_networks")

PLACE, RECEPTORS = sphere(8000), sphere(60)
FORCE = np.clip(PLACE @ RECEPTORS.T - 0.75, 0.0, None).astype(np.float32)


def learned(sensation):
    batches = [(sensation, PLACE)]
    return learn(lambda: batches, num_targets=120, max_kernel_size=200).representation


def true_positions(representation):
    members = map(representation.members, range(representation.num_targets))
    return np.array([PLACE[representation.kernel_row[rows]].mean(axis=0) for rows in members])


@pytest.mark.parametrize("level", [1.0, 7.0])
def test_who_feels_a_touch_tells_the_shape(level):
    known = learned(level * (FORCE > 0).astype(np.float32))
    true = true_positions(known)
    body = recover(known, "learned", holes=False)
    error = shape_error(body.positions, true)
    assert error < 0.02
    assert body.parts[0].doubt is None
    # What is stored is what is felt, and angles between sets are worse.
    share = known.target_sensations / known.target_sensations.max(axis=1, keepdims=True)
    assert np.median((share > 0.02).sum(axis=1)) < 25
    assert shape_error(recover(known, "sensorimotor", holes=False).positions, true) > 1.5 * error


def test_forces_tell_more_than_who_feels_a_touch():
    known = learned(FORCE)
    assert overlap_lengths(known, 2) is None
    assert expected_readings(FORCE, receptors_together(FORCE)) is None


def test_receptors_that_feel_nothing_together_tell_no_lengths():
    # Fields without overlap: each touch is felt by the nearest receptor alone, or by none other.
    nearest = (PLACE @ RECEPTORS.T).argmax(axis=1)
    alone = np.eye(len(RECEPTORS), dtype=np.float32)[nearest]
    batches = [(alone, PLACE)]
    known = learn(lambda: batches, num_targets=60, max_kernel_size=200).representation
    assert overlap_lengths(known, 2) is None
