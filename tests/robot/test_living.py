import numpy as np

from selftouch_drake.robot.living import LivingAgent


def test_each_motion_goes_on_from_where_the_arm_is(cube_world):
    q_start = np.array([0.3, 0.2, 0.5, 0.0, 0.4, 0.0])
    living = LivingAgent(cube_world.experiment, cube_world.skin, cube_world.fields, q_start)
    time_s = np.linspace(0.0, 1.0, 101)
    blend = (10 * time_s**3 - 15 * time_s**4 + 6 * time_s**5)[:, None]

    for step in (np.array([0.2, 0, 0, 0.3, 0, 0]), np.array([0, 0, 0.2, 0, 0, 0.4])):
        q_before = living.q.copy()
        q = living.q_commanded + blend * step
        living.follow(time_s, q, np.gradient(q, time_s, axis=0))
        assert np.allclose(living.q, q_before)
        furthest = 0.0
        while living.time_s < 1.1:
            living.advance(0.05)
            furthest = max(furthest, np.abs(living.q - living.q_commanded).max())
        assert furthest < 0.05
        assert np.allclose(living.q, q[-1], atol=5e-3)
    assert living.felt.shape == (cube_world.fields.num_receptors,)
