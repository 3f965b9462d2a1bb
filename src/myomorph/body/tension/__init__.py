"""Tensions of one recording as a whole, with the gains of its EMG."""
