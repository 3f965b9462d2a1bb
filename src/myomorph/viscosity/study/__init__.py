"""From a study file of specimens to its results: files, steps, tables."""
