"""From raw recordings to a study: what a recording is, which model it takes, and the study file
that says so.
"""
