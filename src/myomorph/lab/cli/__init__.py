"""The command line: arguments to one call to files.

It holds no science, and imports it only when a command runs it.
"""

from myomorph.lab.cli.program import main

__all__ = ["main"]
