"""Somebody who walks or runs: feet as planned, a body in balance, and forces that follow."""
