"""Contacts and unmeasured forces."""
