"""The command ``murk``: one module a command, each importing what it needs only when it runs."""

from __future__ import annotations

import os
import sys
from importlib.metadata import version
from typing import Annotated

import typer

from dbc.errors import MurkError
from node.cli import (
    bench,
    calibrate,
    decode,
    degrade,
    demo,
    doctor,
    estimate,
    gateway,
    plan,
    play,
    radar,
    run,
    set_parameter,
    train,
    watch,
)

app = typer.Typer(
    name="murk",
    help="Tells how bad each sensor is right now, and makes them worse on purpose.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"murk {version('murk')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    pass


app.command()(run.run)
app.command()(demo.demo)
app.command()(plan.plan)
app.command()(estimate.estimate)
app.command()(decode.decode)
app.command()(bench.bench)
app.command()(doctor.doctor)
app.command()(train.train)
app.command()(calibrate.calibrate)
app.command()(play.play)
app.add_typer(radar.app, name="radar")
app.command()(gateway.gateway)
app.command()(degrade.degrade)
app.command()(watch.watch)
app.command("set")(set_parameter.set_parameter)


def main() -> None:
    """Run the command line; a ``MurkError`` becomes one line on standard error and its exit code.

    Exit codes: 0 done, 1 the run failed, 2 wrong usage or a bad file.
    """
    try:
        app()
    except MurkError as error:
        sys.stderr.write(f"murk: {error}\n")
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
    except OSError as error:
        # Whoever read standard output is gone, or its disk is full: nothing is flushed at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            sys.stderr.write(f"murk: {error.filename or 'standard output'}: {error.strerror}\n")
        sys.exit(1)
