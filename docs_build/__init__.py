"""Build, check and illustrate the documentation site from `docs/`.

Nothing here is part of the package.
"""
