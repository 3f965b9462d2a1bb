"""Rules of a page, the files that do not follow them yet, and the waivers.

`rules` finds what a syntax tree shows, `linter` what ruff finds, `exceptions` reads and writes the
lists of files. `python -m tests.page` takes off the lists what is done.
"""
