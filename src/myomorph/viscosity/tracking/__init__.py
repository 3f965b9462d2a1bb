"""From the markers and the plate of a trial to the joint's motion and the equations of its swings.

Nothing here identifies parameters.
"""
