"""Warnings of this package in one line, in every process."""

from collections.abc import Callable

import click


def one_line_warnings(others: Callable[..., None]) -> Callable[..., None]:
    """Shows warnings of this package as one line; what is `others` shows the others."""

    def show(message, category, *where, **options) -> None:
        if category.__module__.startswith("selftouch_drake."):
            click.echo(f"selftouch: warning: {message}", err=True)
        else:
            others(message, category, *where, **options)

    return show
