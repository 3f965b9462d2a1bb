"""A relaxed living limb that swings at one joint, its masses known from a model: what the joint's
passive torque is.
"""
