"""A relaxed living limb that swings at one joint: the passive torque of the joint.

Its masses are known from a model.
"""
