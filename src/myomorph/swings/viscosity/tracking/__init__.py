"""From markers and plate of a trial to the joint's motion and its equations.

It identifies no parameters.
"""
