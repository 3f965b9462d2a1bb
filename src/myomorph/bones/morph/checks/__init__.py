"""A morphed model compared with its source: paths through bones, moment arms, fibers, joints.

Each warning is one line. Lives here: measures that compare two models over their ranges of motion,
and `clearance.py`, which moves paths out of bones by these measures. Never here: the match of
single bones, which `registration/` checks.
"""
