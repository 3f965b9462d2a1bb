"""Muscles fitted to a person: optimal fiber lengths, tendon slack lengths, strengths and passive
strain.
"""
