"""Reads the command line and calls a command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ..errors import NotReached, PlumblineError, Unauthorized
from . import evaluate, mindcraft


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command, and returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="plumbline-client", description="Tools for labs that are graded by plumbline."
    )
    add_service(parser, None)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    evaluate.add_to(commands)
    mindcraft.add_to(commands)
    folder = commands.add_parser("lm-eval", help="print the folder of the tasks for lm-eval's harness (--include_path)")
    folder.set_defaults(run=show_lm_eval)
    for command in set(commands.choices.values()):
        # These may stand before the command and after it.
        add_service(command, argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    try:
        code: int = given.run(given)
    except PlumblineError as error:
        print(f"plumbline-client: {error}{hint_for(error)}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nplumbline-client: interrupted; run the same command again to resume", file=sys.stderr)
        return 130
    return code


def add_service(parser: argparse.ArgumentParser, default: str | None) -> None:
    """Adds the options that say which service."""
    parser.add_argument(
        "--server",
        default=default,
        help="address of the service; by default $PLUMBLINE_SERVER or http://localhost:7586",
    )
    parser.add_argument("--key", default=default, help="key of the service; by default $PLUMBLINE_KEY")


def hint_for(error: PlumblineError) -> str:
    """Says where the address or the key of the service comes from."""
    if isinstance(error, NotReached):
        return "\nthe service's address is that of --server or PLUMBLINE_SERVER; `plumbline serve --open` starts one"
    if isinstance(error, Unauthorized):
        return "\nthe service's key is that of --key or PLUMBLINE_KEY"
    return ""


def show_lm_eval(given: argparse.Namespace) -> int:
    """Prints where the tasks for lm-eval's harness are."""
    print(Path(__file__).parents[1] / "lm_eval")
    return 0
