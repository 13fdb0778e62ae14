"""The command line: `selftouch run` does everything, and each stage is a command of its own.

One file for each group of commands. Slow imports, above all Drake, happen where they are needed,
after all checks that do not need them.
"""

import gc
import sys

import click

from selftouch_drake import __version__
from selftouch_drake.cli import importing, look, make, model, plan, skin, teach
from selftouch_drake.cli.errors import exit_status

__all__ = ["cli", "exit_status", "main"]

#: In the usual order of use, in which help lists them.
COMMANDS = (
    make.run,
    make.babble,
    importing.import_data,
    importing.map_receptors,
    teach.teach,
    make.learn,
    model.model,
    skin.skin,
    plan.plan,
    plan.execute,
    plan.record,
    make.evaluate,
    importing.score,
    make.report,
    look.live,
    look.play,
    make.sweep,
    look.robot,
    look.body,
    look.experiments,
)


class InOrderOfUse(click.Group):
    """Lists the commands in the usual order of use."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Returns the commands in the order in which they were added."""
        return list(self.commands)


@click.group(
    cls=InOrderOfUse,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="selftouch")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """An agent finds out, by touching itself, that it has a body.

    The agent moves a robot at random and remembers what it felt at which joint positions. From that
    alone it builds a graph of its sensations. The graph shows the shape of its body, and the agent
    plans on it from any sensation to any other.

    \b
    selftouch run cube                        do everything, into runs/cube
    selftouch run torus --out runs/my_torus   another body, a run directory of your choice
    selftouch run cube --set '{seed: 1}'      a variant, into runs/cube-seed=1
    selftouch plan runs/cube --from 3 --to 250
    selftouch execute runs/cube --from 3 --to 250
    selftouch model runs/cube                 its joints, as the agent found them
    selftouch skin runs/cube                  which of its receptors are faulty
    selftouch play runs/cube                  watch it live in a browser
    selftouch robot two_arms                  its joints, skins, and what touches what
    selftouch body my_robot.py:MyRobot        try a body of your own
    selftouch import recording.npz            data recorded by another robot
    selftouch map recording.npz               where its receptors are
    selftouch teach log.csv                   a robot that you move by hand
    """  # noqa: D301 - click keeps the lines after a \b as they are
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


for command in COMMANDS:
    cli.add_command(command)


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line: exit 0 on success, 2 on a user's mistake, 130 on Ctrl-C."""
    # Modules that load are no garbage; looking for some in between takes a twentieth of a start.
    gc.set_threshold(50_000)
    sys.exit(exit_status(lambda: cli.main(arguments, prog_name="selftouch", standalone_mode=False)))
