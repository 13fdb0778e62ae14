"""A recording whose touches are known, and whether a source written in some form holds them."""

import numpy as np
import pandas as pd

from benchmarks.shared.raw_skin import recorded
from selftouch_drake.run.import_summary import summary
from selftouch_drake.run.imported import imported_experiment, read_data

NUM_ROWS, NUM_JOINTS, NUM_RECEPTORS = 3000, 4, 40
SMALL = {"representation": {"num_targets": 50}}
RATE_HZ = 50.0


class Good:
    """A recording of four joints and forty receptors whose touches are known."""

    def __init__(self, num_rows=NUM_ROWS):
        made = recorded(num_rows, NUM_RECEPTORS, rate_hz=RATE_HZ)
        self.q = np.round(made.q[:, :NUM_JOINTS], 4)
        self.force = np.round(100 * made.force.astype(float), 3)
        self.time_s = np.round(np.arange(num_rows) / RATE_HZ, 3)
        self.touching = self.force.any(axis=1)

    def table(self, q=None, force=None, **others):
        """A data frame with usual names, other columns first."""
        q, force = self.q if q is None else q, self.force if force is None else force
        columns = others or {"time_s": self.time_s}
        columns |= {f"q_{joint}": q[:, joint] for joint in range(q.shape[1])}
        columns |= {f"taxel_{n}": force[:, n] for n in range(force.shape[1])}
        return pd.DataFrame(columns)


def require_same(good, source, *, rows=None, **options):
    """The touches of a source are those of the good recording, at most of its rows."""
    data = read_data(source, **options)
    rows = np.arange(len(good.q)) if rows is None else rows
    touching = rows[good.touching[rows]]
    assert len(data.recording.q) == len(rows)
    assert data.recording.q.shape[1] == NUM_JOINTS
    np.testing.assert_allclose(data.felt.q, good.q[touching], atol=2e-6)
    np.testing.assert_allclose(data.felt.sensation, good.force[touching], atol=1e-4)
    if options.get("time") != "none":
        limits = imported_experiment(data, overrides=SMALL).imported.max_velocity
        steps = np.abs(np.diff(good.q, axis=0)) * RATE_HZ
        np.testing.assert_allclose(limits, np.quantile(steps, 0.99, axis=0), rtol=0.03)
    else:
        assert data.recording.time_s is None
    return data


def said(data):
    return "\n".join(summary(data, imported_experiment(data, overrides=SMALL)))
