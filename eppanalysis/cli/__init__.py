"""The command line: a module for each group of commands, and the programme that they make up."""

from eppanalysis.cli.commands import app, main

__all__ = ["app", "main"]
