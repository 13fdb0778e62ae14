"""The table of a benchmark: from scratch in `build/`, or with `--update` the shipped one."""

from __future__ import annotations

import argparse
import csv
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]


def add_update_option(parser: argparse.ArgumentParser, name: str) -> None:
    """Adds `--update`, which replaces the shipped table `docs/data/NAME.csv`."""
    parser.add_argument(
        "--update",
        action="store_true",
        help=f"replace the shipped docs/data/{name}.csv; by default the table is build/{name}.csv",
    )


@contextmanager
def results(name: str, *, update: bool = False) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Yields a function that adds a row to `build/NAME.csv`, which starts empty.

    Every row is on disk at once, so that a stopped benchmark leaves what it measured. The shipped
    table is replaced only when all rows are there.
    """
    path = ROOT / "build" / f"{name}.csv"
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        table: csv.DictWriter[str] | None = None

        def add(row: dict[str, Any]) -> None:
            nonlocal table
            if table is None:
                table = csv.DictWriter(file, list(row), lineterminator="\n")
                table.writeheader()
            table.writerow(row)
            file.flush()

        yield add
    if update:
        shutil.copy(path, ROOT / "docs" / "data" / path.name)
    print(f"table: {path}")
