"""Muscle tensions on elastic tendons: activation and tendon dynamics over the whole recording."""
