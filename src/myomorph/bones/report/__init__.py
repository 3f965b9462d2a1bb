"""The page about muscles that were transferred to other bones."""
