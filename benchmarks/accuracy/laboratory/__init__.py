"""Recordings of laboratories as they come."""
