"""Two sessions of walking on one page."""
