"""Steps of a study that make a model in other bones."""
