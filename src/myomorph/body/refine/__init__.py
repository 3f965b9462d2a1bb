"""Motion, body and masses of a subject in one problem."""
