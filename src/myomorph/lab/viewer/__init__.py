"""Pages that play stored results in three dimensions, and live ones; they compute no value that is
kept.
"""
