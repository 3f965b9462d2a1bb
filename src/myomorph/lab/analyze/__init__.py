"""From raw recordings to a study: what a recording is, its model, and the file that says so."""
