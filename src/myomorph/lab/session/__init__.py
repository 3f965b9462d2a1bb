"""Who was recorded, when, and in which movement: the session of a folder of recordings."""
