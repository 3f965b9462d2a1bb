"""The specimen: base, joint and limb with their bodies and muscles, cut out of a larger model.

Nothing here knows a recording.
"""
