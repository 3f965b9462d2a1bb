"""One surface at a time: its nearest points, its round parts, the soft tissue grown around it.

Lives here: what one bone, or one skeleton in one pose, tells by its shape. Never here: a second
bone to compare with.
"""
