"""``python -m gonio``: the command line."""

from gonio.cli.program import VERBS, command, main

__all__ = ["VERBS", "command", "main"]

if __name__ == "__main__":
    command()
