"""The pages about a whole study and about groups."""
