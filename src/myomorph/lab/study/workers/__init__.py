"""Processes that do pieces of work for another, on this machine, and what they compile first."""
