"""The page on a walk for the clinic."""
