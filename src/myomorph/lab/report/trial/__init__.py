"""The page about one trial and its sections."""
