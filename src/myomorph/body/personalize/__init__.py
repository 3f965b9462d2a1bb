"""Muscles fitted to a person.

Optimal fiber lengths, tendon slack lengths, strengths and passive strain.
"""
