"""Comparisons of speed, memory and size; each prints the rows of a table in docs/performance.md."""
