"""Commands as a user gives them, in this process."""

import contextlib
import io
from pathlib import Path
from typing import NamedTuple

from selftouch_drake.cli import cli, exit_status

#: Fields that make a run small: four walks, and one pair that is planned and executed.
SMALL = (
    "{babbling: {num_samples: 2000, walk_size: 500}, representation: {num_targets: 60}, "
    "evaluation: {num_pairs: 1}}"
)


class Done(NamedTuple):
    status: int
    stdout: str
    stderr: str


def selftouch(*words) -> Done:
    """What a command returns and writes."""
    out, err = io.StringIO(), io.StringIO()
    line = list(map(str, words))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = exit_status(lambda: cli.main(line, prog_name="selftouch", standalone_mode=False))
    return Done(status, out.getvalue(), err.getvalue())


def refused(*words) -> str:
    """The one line that a command writes which is refused for a mistake of the user."""
    done = selftouch(*words)
    assert done.status == 2, done
    assert "Traceback" not in done.stderr
    (line,) = done.stderr.strip().splitlines()
    assert done.stdout == ""
    return line.removeprefix("selftouch: ")


def files_below(folder: Path) -> dict[str, bytes]:
    """The content of every file in a folder and its folders, by its path there."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }
