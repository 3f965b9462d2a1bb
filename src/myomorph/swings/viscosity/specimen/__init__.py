"""The specimen: base, joint and limb with bodies and muscles, cut out of a larger model.

It knows no recording.
"""
