"""Accuracy of muscles that were transferred to other bones."""
