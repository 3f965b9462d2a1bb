"""Models of one body, and the forces inside it, from what a laboratory can measure."""

__version__ = "0.1.0"
