"""Bodies, markers and forces as pictures and as a scene that a page can play."""
