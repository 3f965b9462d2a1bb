"""How the documentation site is made of `docs/`, checked and illustrated; nothing here is part of
the package.
"""
