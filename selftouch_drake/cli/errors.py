"""How commands fail: one line on stderr, and an exit status."""

import warnings
from collections.abc import Callable

import click

from selftouch_drake.run.warning_lines import one_line_warnings

#: A user's mistake, and Ctrl-C.
MISTAKE = 2
STOPPED = 130


def exit_status(command: Callable[[], object]) -> int:
    """Runs `command`; turns a user's mistake into one line on stderr instead of a traceback.

    A warning of this package becomes one line too.
    """
    try:
        with warnings.catch_warnings():
            warnings.showwarning = one_line_warnings(warnings.showwarning)
            result = command()
        return result if isinstance(result, int) else 0
    except (KeyboardInterrupt, click.Abort):
        click.echo("selftouch: stopped; give the same command again to resume", err=True)
        return STOPPED
    except click.ClickException as error:
        message = error.format_message()
    except (ValueError, OSError) as error:
        message = str(error)
    click.echo(f"selftouch: {' '.join(message.split())}", err=True)
    return MISTAKE
