"""The body of one person: link lengths and marker places, masses, muscles, sensors as mounted. Stands on `core`."""
