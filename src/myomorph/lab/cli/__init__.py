"""The command line: arguments to one call to files. Holds no science, and imports it only when
asked to run it.
"""

from myomorph.lab.cli.program import main

__all__ = ["main"]
