"""Contacts and forces that nobody measured."""
