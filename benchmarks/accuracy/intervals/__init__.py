"""Coverage of limits."""
