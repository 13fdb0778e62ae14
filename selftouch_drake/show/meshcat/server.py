"""Meshcat's server, opened without log messages; errors have one line."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator

from pydrake.geometry import Meshcat, MeshcatParams


def open_meshcat(port: int | None = None) -> Meshcat:
    """A Meshcat on this machine alone.

    Args:
        port: of the page; by default the first free one from 7000 on.

    Raises:
        ValueError: the port is taken.
    """
    with _quiet():
        try:
            return Meshcat(MeshcatParams(host="localhost", port=port, show_stats_plot=False))
        except RuntimeError:
            raise ValueError(f"--port {port} is in use; give another, or leave it out") from None


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keeps Drake from announcing a server that no user visits."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        logger.setLevel(level)
