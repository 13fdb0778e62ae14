"""Runs for what the agent must be able to do, on touches that Drake made.

Bounds in these tests fail if the agent gets worse by half. Each file makes one run, so that
`--dist loadfile` spreads them over the cores.
"""

import json
from pathlib import Path
from typing import Any

from selftouch_drake.cli import cli, exit_status


def selftouch(*words: object) -> int:
    """Exit status of a command, in this process."""
    return exit_status(lambda: cli.main([str(word) for word in words], standalone_mode=False))


def made(
    path: Path,
    name: str,
    *,
    touches: int,
    targets: int,
    pairs: int,
    metric: str = "learned",
    seed: int = 0,
) -> Path:
    """Makes a run of a shipped experiment up to its evaluation."""
    changes = (
        f"{{seed: {seed}, babbling: {{num_samples: {touches}}}, "
        f"representation: {{num_targets: {targets}, metric: {metric}, body_model: off}}, "
        f"evaluation: {{num_pairs: {pairs}, shape_metrics: []}}}}"
    )
    assert selftouch("babble", name, "--out", path, "--set", changes, "--workers", 1) == 0
    assert selftouch("learn", path) == 0
    assert selftouch("evaluate", path, "--workers", 1) == 0
    return path


def metrics_of(run: Path) -> dict[str, Any]:
    """What `metrics.json` holds."""
    return json.loads((run / "metrics.json").read_text(encoding="utf-8"))
